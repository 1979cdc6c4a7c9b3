"""What each step of the page is on the command line, and in Python: lines that run as they stand."""

import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import tomlkit

from compensate.export.targets._export_to import TARGETS
from hysteresis import InputError
from hysteresis._escape import shell_word
from hysteresis._files import write_whole

from ..commands import _asked
from ..commands._asked import CHAINS, Command, as_fields
from ..intake._creep_fits import step_options
from ..intake._options import FIELDS, is_given
from ..intake._own_config import TABLES, config_of, folder_of, option_value, read_config, read_toml
from ..intake._selection import Selection


def equivalents(
    file: Path, folder: Path, selection: Selection | None, fit: Mapping[str, Any], value: str = "."
) -> dict[str, dict[str, str]]:
    """Step -> {"command", "python"}, for a terminal and an interpreter that run in the studio's folder.

    `value`: the folder within `folder` of the fit that is shown, where a fit was made of each value.
    """
    name, place = Path(file.name), Path(folder.name)
    out = None if folder.name == folder_of(file).name else place
    steps: dict[str, list[Command]] = {
        "data": [_asked.Init(file=name), _asked.Check(file=name)],
        "fit": [_asked.Fit(file=name, out=out, overwrite=folder.exists())],
        "posterior": [asked_for("sample", place, sampled=(folder / value / CHAINS).exists())],
        "compensator": [asked_for(kind, place, Path("NEW.csv")) for kind in ("qualify", "predict")],
        "export": [asked_for("export", place)],
        "report": [asked_for("report", place)],
    }
    commands = {
        step: "\n".join(" ".join(["hysid", *map(shell_word, one.words)]) for one in asked)
        for step, asked in steps.items()
    }
    if config_of(file).exists():
        commands["data"] = f"# {commands['data']}"
    python = dict.fromkeys(commands, "")
    if selection is not None:
        python = _python(file, folder, selection, fit, value)
    return {step: {"command": commands[step], "python": python[step]} for step in commands}


def asked_for(
    kind: str, place: Path, file: Path = Path(), target: str = "", sampled: bool = False
) -> Command:
    """The command behind a button on the page, about the fit at `place` and another `file`; `sampled`:
    chains of it are there.

    Raises `InputError` `bad-option` for a kind or a target that there is not.
    """
    if kind == "export" and target in TARGETS:
        return _asked.Export(folder=place, to=(target, place / target_name(place, target)))
    known: dict[str, Callable[[], Command]] = {
        "sample": lambda: _asked.Sample(folder=place, resume=sampled),
        "qualify": lambda: _asked.Qualify(folder=place, file=file),
        "predict": lambda: _asked.Predict(folder=place, file=file, inverse=True),
        "report": lambda: _asked.Report(folders=[place]),
        "export": lambda: _asked.Export(
            folder=place, c=place / header_name(place), runtime=place / "compensator.json"
        ),
    }
    if target or kind not in known:
        raise InputError("bad-option", f"There is no command or target {target or kind!r}.")
    return known[kind]()


def _python(
    file: Path, folder: Path, selection: Selection, fit: Mapping[str, Any], value: str
) -> dict[str, str]:
    place = folder.name if value == "." else f"{folder.name}/{value}"
    begin = f"import hysid\nhysid.enable_x64()\nfit = hysid.load({place!r})\n"
    given = {
        name: list(chosen) if isinstance(chosen, tuple) else chosen
        for name, one in FIELDS.items()
        if is_given(one, chosen := getattr(selection, name))
    }
    made = f"pairs = hysid.records({', '.join([repr(file.name), *_words(given)])})"
    each = "for value, (train, test) in pairs.items():"
    if selection.is_step:
        words = _words(step_options(dict(fit)))
        fitted = f"hysid.fit_step({', '.join(['train', 'test=test', *words])})"
    else:
        model = fit.get("model", "auto")
        model = ",".join(model) if isinstance(model, list) else model
        words = _words({key: value for key, value in fit.items() if key != "model"})
        fitted = f"hysid.fit({', '.join(['train', repr(model), 'test=test', *words])})"
    saved = [f"hysid.save(fits[''], {folder.name!r}, overwrite=True)"]
    saved = [] if selection.each is not None else saved
    fits = ["hysid.enable_x64()", "fits = {}", each, f"    fits[value] = {fitted}", *saved]
    return {
        "data": "\n".join(["import hysid", made, each, "    print(value, train)"]),
        "fit": "\n".join(["import hysid", made, *fits]),
        "posterior": f"{begin}posterior = hysid.sample(fit, seed=0)",
        "compensator": f"{begin}compensator = hysid.invert(fit.model, trained=fit.trained)\n"
        "estimate = compensator.simulate(fit.train.time, fit.train.output)",
        "export": f"from compensate import export_c\n{begin}"
        f"export_c(fit.model, {f'{place}/{header_name(folder)}'!r}, fit.train.output,"
        " times=fit.train.time, trained=fit.trained)",
        "report": f"{begin}hysid.report(fit, {place + '/report.html'!r})",
    }


def _words(options: Mapping[str, Any]) -> list[str]:
    return [f"{key}={value!r}" for key, value in options.items()]


def header_name(folder: Path) -> str:
    """A name for the C header of a fit, whose own names begin with it."""
    name = re.sub(r"\W", "_", folder.name, flags=re.ASCII)
    return f"{name if not name[:1].isdigit() else f'fit_{name}'}.h"


def target_name(folder: Path, target: str) -> str:
    """A name for what `hysid export --to TARGET` writes of a fit: a file, or a folder."""
    stem = header_name(folder).removesuffix(".h")
    return {"fmu": f"{stem}.fmu", "fmu3": f"{stem}_fmi3.fmu", "onnx": f"{stem}.onnx"}.get(
        target, f"{stem}_{target}"
    )


# The configuration of a measurement, FILE.toml: read, and changed without touching what its user wrote.

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
