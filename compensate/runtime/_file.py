"""A compensator's file, or an armor's: what it is checked for before it is used."""

import hashlib
import json
from collections.abc import Callable, Mapping
from math import isfinite
from pathlib import Path
from typing import Any, Protocol, TypeVar, runtime_checkable

SCHEMA = 1
"""The format of force estimators and armors."""
COMPENSATOR_SCHEMA = 3
"""The format of compensators. Format 1 had neither a guard nor an origin, format 2 only the virgin state to
begin in; both are still read."""

DAMAGE = (
    ArithmeticError, AttributeError, ImportError, LookupError, MemoryError, RuntimeError, SyntaxError,
    TypeError, ValueError,
)  # fmt: skip
"""What a document that was made up raises where it is run; for deep nesting it is a `RuntimeError`."""

LONGEST = 1e30
"""Longest time between two readings, of files of earlier versions, which do not name one."""

READING_MISSING = (
    "step(dt, reading): the time since the last reading comes first; models that do not depend on the rate"
    " ignore it"
)
"""Said of a call without a reading, as `step(reading)` is."""

Written = dict[str, Any]
"""What the JSON of a file holds."""

_NEWEST = {"hysid compensator": COMPENSATOR_SCHEMA}


@runtime_checkable
class Resettable(Protocol):
    """What is made of a file."""

    def reset(self) -> None:
        """As before the first reading."""


Used = TypeVar("Used", bound=Resettable)
Replays = Mapping[str, tuple[str, Callable[[Written], tuple[Used, float]]]]
"""By the kind of a file: what is said where it gives something else, "... {:.3g} off"; what makes it of a
document, and finds how far off the worst golden value is."""


class FileError(ValueError):
    """A file that is not used: the message says where, why, and what to do."""


def checksum(document: Mapping[str, Any]) -> str:
    """SHA-256 of all but the checksum itself."""
    rest = {key: value for key, value in document.items() if key != "checksum"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def number(value: Any) -> float | None:
    """None for what is not finite, which JSON does not have."""
    return float(value) if isfinite(value) else None


def replayed(path: str | Path, replays: Replays[Used]) -> Used:
    """What is made of the document of a file, once it gives its golden values again.

    Raises `FileError` as `read` does, and where it cannot be run or gives other values.
    """
    document = read(path, tuple(replays))
    said, replay = replays[document["kind"]]
    try:
        made, worst = replay(document)
        agrees = worst <= document["golden"]["tolerance"]
    except DAMAGE as error:
        raise FileError(f"{path}: cannot be run ({error}). Export it again.") from None
    if not agrees:
        raise FileError(f"{path}: replayed, its own {said.format(worst)}. Export it again.")
    made.reset()
    return made


def read(path: str | Path, kinds: tuple[str, ...]) -> Written:
    """The document of a file. Raises `FileError` where it is of another kind, newer, cut off or changed."""
    try:
        document = json.loads(Path(path).read_bytes())
    except OSError as error:
        raise FileError(f"{path}: {error.strerror}.") from None
    except RecursionError:
        raise FileError(f"{path}: nested too deep. Export it again.") from None
    except (ValueError, MemoryError):
        raise FileError(f"{path}: not whole, or no JSON. Export it again.") from None
    if not isinstance(document, dict) or document.get("kind") not in kinds:
        raise FileError(
            f"{path}: not a compensator, an estimator or an armor. Write one with hysid export DIR"
            " --runtime FILE."
        )
    newest = _NEWEST.get(document["kind"], SCHEMA)
    schema = document.get("schema")
    if type(schema) is not int or schema not in range(1, newest + 1):
        raise FileError(
            f"{path}: written in format {schema}, this version reads {newest}."
            " Update hysid, or export it again."
        )
    try:
        whole = document.get("checksum") == checksum(document)
    except RecursionError:
        raise FileError(f"{path}: nested too deep. Export it again.") from None
    if not whole:
        raise FileError(f"{path}: changed since it was written (checksum). Export it again.")
    return document
