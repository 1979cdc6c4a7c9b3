"""The configuration of a measurement, FILE.toml: read, and changed without touching what its user wrote."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit

from hysteresis import InputError
from hysteresis._atomic_file import write_whole

from ..commands._asked import as_fields
from ..intake._own_config import TABLES, option_value, read_config, read_toml
from ..intake._selection import Selection

NAMES = (*TABLES, "parameters")
MOST = 1000
"""Entries of a list, and characters of a text, that a page may set."""


def read(config: Path) -> dict[str, Any]:
    """The tables of a configuration as plain data.

    Raises `InputError` `bad-config`, and `outside-folder` where it names a file that is not in its folder.
    """
    document = read_toml(config) if config.exists() else {}
    if odd := [key for key, one in document.items() if not isinstance(one, dict)]:
        raise InputError("bad-config", f"{odd[0]!r} is not a table.", place=str(config))
    found = {name: dict(document.get(name, {})) for name in NAMES}
    other, folder = found["selection"].get("dialects"), config.parent.resolve()
    if isinstance(other, str) and not (folder / other).resolve().is_relative_to(folder):
        raise InputError(
            "outside-folder", "The file of dialects is not in this folder.", place=str(config),
            fix="Copy it beside the measurement.",
        )  # fmt: skip
    return found


def selection(config: Path) -> Selection:
    """The selection of a configuration. Raises `InputError` `bad-config`, and as `Selection` does."""
    read(config)
    options = as_fields(read_config(config)["selection"] if config.exists() else {})
    if "output" not in options:
        raise InputError(
            "bad-config", "No output column is chosen.", place=str(config),
            fix="Choose the column that answers to the input.",
        )  # fmt: skip
    return Selection(**{"input": None, **options})


def change(config: Path, changes: Mapping[str, Mapping[str, Any]]) -> None:
    """Set keys of `TABLES`, or remove those whose value is None; all else stays as it is.

    Raises `InputError` `bad-config`, `unknown-key`, `bad-option` for a value that the key cannot have.
    """
    read(config)
    document = tomlkit.parse(config.read_text("utf-8")) if config.exists() else tomlkit.document()
    for name, keys in changes.items():
        if name not in document:
            document[name] = tomlkit.table()
        table: Any = document[name]
        for key, value in keys.items():
            if key not in TABLES[name]:
                raise InputError("unknown-key", f"There is no option {key!r}.", place=str(config))
            if not _is_plain(value):
                said = f"{key!r} cannot be {value!r:.80}."
                raise InputError("bad-option", said, place=str(config))
            if value is None:
                table.pop(key, None)
            else:
                option_value(config, TABLES[name][key], value)
                table[key] = value
    write_whole(config, tomlkit.dumps(document))


def _is_plain(value: Any) -> bool:
    """Whether TOML can hold a value as it is, and a list of such."""
    if isinstance(value, list):
        return len(value) <= MOST and all(_is_plain(v) and not isinstance(v, list) for v in value)
    if isinstance(value, str):
        return len(value) <= MOST and not any("\ud800" <= c <= "\udfff" for c in value)
    if isinstance(value, dict):
        return False
    return value is None or abs(value) < (2**63 if isinstance(value, int) else math.inf)
