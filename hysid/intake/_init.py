"""What `hysid init` writes and says of a guess."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hysteresis import InputError
from hysteresis._escape import shell_word, toml_comment, toml_string
from hysteresis._files import write_whole

from ._options import FIELDS
from ._own_config import check_there, config_of, facts_of, folder_of
from ._selection import selection_of
from .guess._guess import GUESS, LIKELY, SURE, Guess, guess

ROLES = ("input", "output", "time", "input_time", "condition", "step", "hold", "each")
"""What has to be sure before a file is fitted that nobody has looked at; all else changes no column."""
WORDS = {LIKELY: "only likely", GUESS: "only a guess"}


def init(
    file: Path, out: Path | None, given: Mapping[str, Any], *, overwrite: bool = False
) -> dict[str, Any]:
    """Guess, write the configuration, and say what was seen; without an input and output, only say it.

    Raises `InputError` `exists` where a configuration is there already, and as `guess` does.
    """
    check_there(file)
    config = out or config_of(file)
    if config.exists() and not overwrite:
        raise InputError(
            "would-overwrite",
            "This file exists already.",
            place=str(config),
            fix="Name another file (--out FILE.toml), or use --overwrite.",
        )
    found = guess(file, given)
    if found.no_roles and "frequency" not in found.selection:
        return _without_roles(file, found)
    folder = config.with_suffix("") if out else folder_of(file)
    write_whole(config, toml(file, found))
    if folder.exists() and folder.samefile(file):  # a file without a suffix
        folder = folder.with_name(f"{folder.name}-fit")
    said = [shell_word(str(p)) for p in (file, config, folder)]
    command = f"hysid fit {said[0]} --config {said[1]} --out {said[2]}"
    again = f"hysid init {said[0]}{f' --out {said[1]}' if out else ''} --overwrite"
    lines = _lines(file, config, found, command, again)
    return _document(file, found, lines, file=str(config), next=command)


def _document(source: Path, found: Guess, lines: list[str], **more: Any) -> dict[str, Any]:
    told = {k: v for k, v in asdict(found).items() if k != "text" and (v or k != "no_roles")}
    return {"file": None, "source": str(source), **told, "next": None, "lines": lines, **more}


def begun(file: Path, given: Mapping[str, Any], say: Callable[[str], None]) -> Path:
    """Write the configuration of a file that has none, where every role is sure, and say what was seen.

    Raises `InputError` `cannot-decide` where a role is not sure or there is none, and as `guess` does.
    """
    config, found = config_of(file), guess(file, given)
    no_roles = "" if "frequency" in found.selection else found.no_roles
    doubts = [f for f in found.found if f.what in {*ROLES} & {*found.selection} and f.sure != SURE]
    if no_roles or doubts:
        said = [f"{f.what} {f.value!r} is {WORDS[f.sure]} ({f.why})" for f in doubts]
        raise InputError(
            "cannot-decide",
            f"hysid is not sure of the columns: {no_roles or '; '.join(said)}.",
            place=str(file),
            fix=f"Run hysid init {shell_word(str(file))}, which shows what it found and what else it"
            " could be.",
        )
    for line in [*_seen(file, found), *(f"Warning: {w}" for w in found.warnings)]:
        say(line)
    write_whole(config, toml(file, found))
    say(f"Wrote {config}. Change what is wrong in it, and fit again (--overwrite).")
    return config


def _without_roles(file: Path, found: Guess) -> dict[str, Any]:
    """What is said of a table in which no column drives another; no configuration is written."""
    lines = [f"{file}: {found.rows} rows, and no input or output: {found.no_roles}.", ""]
    lines += _findings(found)
    lines += [
        "",
        "No configuration was written. The file that is needed has what drives beside what answers; if one"
        " column did drive another, name both (--input COL --output COL).",
    ]
    return _document(file, found, lines)


def toml(file: Path, found: Guess) -> str:
    """A configuration file: every key with its meaning, how sure it is, and what else could stand there."""
    said = {f.what: f for f in found.found}
    held = said["held out"]
    lines = [
        f"# What hysid init made of {toml_comment(file.name)}. Change what is wrong; hysid fit reads"
        " it with --config.",
        "",
        "# The file it was written for: hysid fit says so where another one is there.",
        "[file]",
        *(f"{key} = {_value(value)}" for key, value in facts_of(file).items()),
        "",
        "[selection]",
    ]
    for key, field in FIELDS.items():
        if key not in found.selection:
            continue
        finding = held if key.startswith("test_") else said.get(key)
        lines.append(f"# {field.metadata['help']}")
        if finding is not None and finding.why:
            lines.append(f"#   {finding.sure}: {toml_comment(finding.why)}")
        lines.append(f"{key} = {_value(found.selection[key])}")
    if not any(key.startswith("test_") for key in found.selection):
        lines += ["# held out: nothing", f"#   {toml_comment(held.why)}", "# test_tail = 0.2"]
    if not {"time", "dt"} & set(found.selection):
        lines += ["# no clock was found: without one, models that depend on speed are left out"]
        lines += ["# dt = 0.01"]
    if found.alternatives:
        lines += ["# other choices:", *(f"#   {toml_comment(a)}" for a in found.alternatives)]
    lines += ["", "[fit]"]
    is_step = selection_of(found.selection).is_step
    if not is_step:
        lines += ['# auto, or names with commas between: "LinearSponge,Preisach,Burgers"']
        lines += ['model = "auto"']
    for key, value in found.fit.items():
        why = said[key].why if key in said else ""
        lines += [f"# {toml_comment(why)}", f"{key} = {_value(value)}"]
    lines += ["seed = 0"]
    if not is_step:
        lines += ["", "# What is known of parameters, as in", "# [parameters]"]
        lines += ["# E1 = {start = 2.0, bounds = [0.1, 100.0]}"]
    return "\n".join(lines) + "\n"


def _value(value: Any) -> str:
    """As TOML writes it: JSON's numbers and truth values are TOML's too."""
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_value, value))}]"
    return toml_string(value) if isinstance(value, str) else json.dumps(value)


def _lines(file: Path, config: Path, found: Guess, command: str, again: str) -> list[str]:
    lines = _seen(file, found)
    lines += ["", *(f"  {line}" for line in found.text.split("\n"))]
    if found.alternatives:
        lines += ["", "It could also be:"]
        lines += [f"  {again} {a}" for a in found.alternatives]
    lines += ["", *(f"Warning: {w}" for w in found.warnings)] if found.warnings else []
    return [*lines, "", f"Wrote {config}: look at it, then", f"  {command}"]


def _seen(file: Path, found: Guess) -> list[str]:
    """The roles, and all that was seen, with how sure it is and why."""
    selection = selection_of(found.selection)
    return [f"{file}: {selection.input_words} -> {selection.output}", "", *_findings(found)]


def _findings(found: Guess) -> list[str]:
    width = max((len(f.what) for f in found.found), default=0)
    return [
        f"  {f.what:{width}}  {f.value} ({f.sure}{f': {f.why}' if f.why else ''})"
        for f in found.found
    ]
