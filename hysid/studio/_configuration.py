"""The configuration of a measurement, FILE.toml: read, and changed without touching what its user wrote."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from hysteresis import InputError
from hysteresis._atomic_file import write_whole

from ..intake._selection import Selection, selection_of
from ..intake._selection_options import FIELDS

TABLES = ("selection", "fit", "parameters")


def read(config: Path) -> dict[str, Any]:
    """The tables of a configuration as plain data. Raises `InputError` `bad-config`."""
    document = _document(config).unwrap()
    odd = [name for name, table in document.items() if not isinstance(table, Mapping)]
    if odd:
        raise InputError("bad-config", f"{odd[0]!r} is not a table.", place=str(config))
    return {name: dict(document.get(name, {})) for name in TABLES}


def selection(config: Path) -> Selection:
    """The selection of a configuration. Raises `InputError` `bad-config`, and as `Selection` does."""
    options: dict[str, Any] = {}
    for key, value in read(config)["selection"].items():
        if key not in FIELDS:
            raise InputError(
                "unknown-key", f"The configuration has an unknown entry: {key}.", place=str(config)
            )
        joined = FIELDS[key].metadata.get("joined")
        options[key] = (
            [p for p in value.split(",") if p] if joined and isinstance(value, str) else value
        )
    if isinstance(several := options.get("input"), list) and len(several) == 1:
        options["input"] = several[0]
    if "output" not in options:
        raise InputError(
            "bad-config", "No output column is chosen.", place=str(config),
            fix="Choose the column that answers to the input.",
        )  # fmt: skip
    try:
        return selection_of(options)
    except TypeError as error:
        raise InputError(
            "bad-config", f"The selection cannot be read: {error}.", place=str(config)
        ) from None


def change(config: Path, changes: Mapping[str, Mapping[str, Any]]) -> None:
    """Set keys of the tables, or remove those whose value is None; all else stays as it is.

    Raises `InputError` `bad-config`, `unknown-key`.
    """
    document = _document(config)
    for name, keys in changes.items():
        if name not in TABLES:
            raise InputError(
                "unknown-key", f"A configuration has no table {name}.", place=str(config)
            )
        if name not in document:
            document[name] = tomlkit.table()
        table: Any = document[name]
        for key, value in keys.items():
            if name == "selection" and key not in FIELDS:
                raise InputError("unknown-key", f"There is no option {key}.", place=str(config))
            if value is None:
                table.pop(key, None)
            else:
                table[key] = value
    write_whole(config, tomlkit.dumps(document))


def _document(config: Path) -> Any:
    try:
        return tomlkit.parse(config.read_text("utf-8"))
    except FileNotFoundError:
        return tomlkit.document()
    except (TOMLKitError, UnicodeDecodeError) as error:
        raise InputError(
            "bad-config", f"This file is not TOML: {error}.", place=str(config),
            cause="Text without quotation marks, or a table that is not closed.",
            fix="Correct it in an editor, or delete it: hysid then guesses again.",
        ) from None  # fmt: skip
