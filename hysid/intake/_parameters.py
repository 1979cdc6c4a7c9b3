"""What is said of parameters, in a configuration file and in words."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hysteresis import InputError
from hysteresis._limits import parse_toml


def parameters_said(file: Path | None, said: Sequence[str] | None = None) -> dict[str, Any]:
    """The settings of parameters for `identify.fit`: the table [parameters], overridden by words such as
    "E1 start=2 bounds=1,4 prior=log-normal(2, 1.5)".

    Raises `InputError` for words without a name and a key.
    """
    found = {} if file is None else dict(read_toml(file).get("parameters", {}))
    for words in said or ():
        name, *parts = re.split(r"\s+(?=[a-z]+=)", words.strip())
        if not name or " " in name or not parts:
            raise InputError(
                "bad-option",
                f"--parameter {words!r} is not a name with settings.",
                fix='Write the name of the parameter, then its settings: "E1 start=2 bounds=1,4".',
            )
        pairs = (part.partition("=") for part in parts)
        found[name] = found.get(name, {}) | {key: _value(key, value) for key, _, value in pairs}
    return found


def _value(key: str, value: str) -> Any:
    """A word as TOML would have it."""
    if key == "bounds":
        return value.split(",")
    if key == "fixed" and value in ("true", "false"):
        return value == "true"
    return value


def read_toml(file: Path) -> dict[str, Any]:
    """The document in a file. Raises `InputError` where it cannot be read or is not TOML."""
    try:
        return parse_toml(file.read_text("utf-8"))
    except OSError as error:
        raise InputError(
            "unreadable-file",
            f"The configuration cannot be read: {error.strerror or error}.",
            place=str(file),
            fix="Name a TOML file (--config FILE).",
        ) from None
    except ValueError as error:  # TOML's and UTF-8's errors are both
        raise InputError(
            "bad-config",
            f"This file is not TOML: {error}.",
            place=str(file),
            cause="Text without quotation marks, or a table that is not closed.",
        ) from None
