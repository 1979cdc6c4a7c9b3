"""A compensator's file: what it is checked for before it is used."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

SCHEMA = 1

_WRITTEN_BY = {
    "hysid compensator": "not a compensator. Write one with hysid export DIR --runtime FILE.",
    "hysid armor": "not an armor. Write one with compensate.armor.export_armor.",
}


class FileError(ValueError):
    """A file that is not used: the message says where, why, and what to do."""


def checksum(document: Mapping[str, Any]) -> str:
    """SHA-256 of all but the checksum itself."""
    rest = {key: value for key, value in document.items() if key != "checksum"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def read(path: str | Path, kind: str = "hysid compensator") -> dict[str, Any]:
    """The document of a file. Raises `FileError` where it is of another kind, newer, cut off or changed."""
    try:
        document = json.loads(Path(path).read_bytes())
    except OSError as error:
        raise FileError(f"{path}: {error.strerror}.") from None
    except ValueError:
        raise FileError(f"{path}: not whole, or no JSON. Export it again.") from None
    if not isinstance(document, dict) or document.get("kind") != kind:
        raise FileError(f"{path}: {_WRITTEN_BY[kind]}")
    if document.get("schema") != SCHEMA:
        raise FileError(
            f"{path}: written in format {document.get('schema')}, this version reads {SCHEMA}."
            " Update hysid, or export it again."
        )
    if document.get("checksum") != checksum(document):
        raise FileError(f"{path}: changed since it was written (checksum). Export it again.")
    return document
