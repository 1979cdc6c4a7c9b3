"""The configuration of a file: its name, what it says of that file, and its settings of parameters."""

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hysteresis import InputError, Note, read_table
from hysteresis._escape import shell_word, visible
from hysteresis._limits import parse_toml

FIRST = 200
"""Bytes of a first line that are kept: enough for a header, and short enough to read."""


def check_there(file: Path) -> None:
    """Raise the reader's `InputError`, which names what is alike, where there is no such file."""
    if not os.path.exists(file):  # False too where the folder may not be looked into
        read_table(file)


def config_of(file: Path) -> Path:
    """The configuration of a file: run.toml; run.csv.toml where that is there, or where run.toml says that
    it is of another file of that stem, such as run.xlsx, which is still beside it."""
    if not file.name:
        return file
    usual, own = file.with_suffix(".toml"), file.with_name(f"{file.name}.toml")
    if own.exists():
        return own
    name = str(_written_for(usual).get("name", file.name))
    shared = name != file.name and Path(name).stem == file.stem and name in os.listdir(file.parent)
    return own if shared else usual


def folder_of(file: Path) -> Path:
    """The folder of a file's fit: the name of its configuration without .toml, with -fit behind where that
    is the file itself."""
    folder = config_of(file).with_suffix("")
    return folder.with_name(f"{folder.name}-fit") if folder.name == file.name else folder


def facts_of(file: Path) -> dict[str, str | int]:
    """What a configuration keeps of its file: name, bytes, and of a text the first line."""
    facts: dict[str, str | int] = {"name": file.name}
    if file.is_file():
        with file.open("rb") as opened:
            head = opened.read(4096)
        first = next(iter(head.splitlines()), b"")[:FIRST]
        text = "" if b"\0" in head else visible(first.decode("utf-8", "backslashreplace"))
        facts |= {"bytes": file.stat().st_size} | ({"first_line": text} if text else {})
    return facts


def compared(config: Path, file: Path, *, chosen: bool) -> Note | None:
    """What to say where the configuration was written for another file, or for another state of this one.

    `chosen`: the user named the configuration, which may be meant for many files.

    Raises `InputError` `other-settings` where it was found by its name alone and the first lines differ.
    """
    then, now = _written_for(config), facts_of(file)
    lines = [str(facts.get("first_line", "")) for facts in (then, now)]
    if all(lines) and lines[0] != lines[1]:
        said = (
            f"{config} was written for a file that begins with {lines[0]!r:.60}, and {file.name} begins"
            f" with {lines[1]!r:.60}."
        )
        if not chosen:
            raise InputError(
                "other-settings",
                said,
                place=str(file),
                cause="The file was exchanged, or its header was edited.",
                fix=f"Run hysid init {shell_word(str(file))} --overwrite, or keep the options as they are:"
                f" --config {shell_word(str(config))}.",
            )
    elif then.get("bytes", now.get("bytes")) != now.get("bytes"):
        said = (
            f"{config} was written for {then.get('name')} of {then['bytes']} bytes; {file} has"
            f" {now.get('bytes')}."
        )
    else:
        return None
    return Note("other-settings", f"{said} Its options are used as they are.")


def _written_for(config: Path) -> Mapping[str, Any]:
    """The table [file] of a configuration; empty where there is none, or none that can be read."""
    try:
        found = parse_toml(config.read_text("utf-8")).get("file", {})
    except (OSError, ValueError):  # said by what reads the options
        return {}
    return found if isinstance(found, Mapping) else {}


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
            fix="Correct it in an editor, or let hysid init write a new one.",
        ) from None
