"""The configuration of a file: its name, what it says of that file, and its settings of parameters."""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import Field
from difflib import get_close_matches
from pathlib import Path
from types import NoneType
from typing import Any, get_args

from hysteresis import InputError, Note, read_table
from hysteresis._escape import shell_word, visible
from hysteresis._limits import parse_toml

from ._options import FIELDS, FIT_FIELDS, has_shape

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
    name = str(written_for(usual).get("name", file.name))
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
    then, now = written_for(config), facts_of(file)
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


def written_for(config: Path) -> Mapping[str, Any]:
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


TABLES: dict[str, Mapping[str, Field[Any]]] = {"selection": FIELDS, "fit": FIT_FIELDS}
"""Tables of options; [parameters] and [file] stand beside them."""
WORDS = {int: "a whole number", float: "a number", str: "text", bool: "true or false"}


def read_config(file: Path) -> dict[str, dict[str, Any]]:
    """The options in a file by table, as the command line has them: lists for options that repeat, words
    joined by commas.

        [selection]
        input = "force (N)"
        output = "displacement (mm)"

        [fit]
        model = "Burgers"

        [parameters]
        E1 = {start = 2.0, bounds = [0.1, 100.0]}

    Raises `InputError` for a file that does not exist or is not TOML, and for a table, a key or a kind of
    value that there is not.
    """
    found: dict[str, dict[str, Any]] = {name: {} for name in TABLES}
    for table, values in read_toml(file).items():
        if table == "file":  # what the configuration was written for
            continue
        if table not in (*TABLES, "parameters") or not isinstance(values, Mapping):
            raise _unknown(file, f"[{table}]", table, [*TABLES, "parameters"])
        for key, value in values.items() if table in TABLES else ():
            if key not in TABLES[table]:
                raise _unknown(file, f"{key} in [{table}]", key, TABLES[table])
            found[table][key] = option_value(file, TABLES[table][key], value)
    return found


def _unknown(file: Path, what: str, key: str, there: Iterable[str]) -> InputError:
    """For an unknown key: name the nearest known one, or the table to which it belongs."""
    elsewhere = [table for table, known in TABLES.items() if key in known]
    near = get_close_matches(key.replace("-", "_"), there, 1, 0.5)
    if elsewhere:
        fix = f"Move it to the table [{elsewhere[0]}]."
    else:
        fix = f"Did you mean {near[0]}?" if near else f"Use one of {', '.join(there)}."
    said = f"The configuration has an unknown entry: {what}."
    return InputError("unknown-key", said, place=str(file), fix=fix)


def option_value(file: Path, one: Field[Any], value: Any) -> Any:
    """A value of a configuration as the command line has it. Raises `InputError` `bad-config`."""
    said = one.metadata
    repeats, joined = said.get("repeated"), said.get("joined") or one.name == "model"
    of = [str] if repeats or joined else get_args(one.type) or (one.type,)
    kind = next(k for k in of if k is not NoneType)
    kinds = (int, float) if kind is float else (str, int, float) if joined else (kind,)
    listed = value if isinstance(value, list) else [value]
    words = ",".join(map(str, listed))
    choices, least, numbers = said.get("choices"), said.get("least"), one.type == tuple[float, ...]
    fits = " or ".join(choices or [said["metavar"] if numbers else WORDS[kind]])
    fits += "" if least is None else f", {least} or more"
    if (
        (isinstance(value, list) and not (repeats or joined))
        or any(type(x) not in kinds for x in listed)
        or (choices and value not in choices)
        or (least is not None and value < least)
        or (numbers and not has_shape(one, [*filter(None, words.split(","))]))
    ):
        raise InputError("bad-config", f"{one.name} = {value!r} is not {fits}.", place=str(file))
    return listed if repeats else words if joined else value


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
