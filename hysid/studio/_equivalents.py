"""What each step of the page is on the command line, and in Python: lines that run as they stand."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hysteresis._escape import shell_word

from ..intake._selection import Selection
from ..intake._selection_options import OF_READING

OPTIONS = (
    "time",
    "dt",
    "input_time",
    "group",
    "condition",
    "nan",
    "segments",
    "input_unit",
    "output_unit",
)
"""Options of `read_csv` that a selection may hold, beside those of reading, in the order of writing."""
USUAL = {"nan": "raise", "decimal": "."}


def equivalents(
    file: Path, folder: Path, selection: Selection | None, fit: Mapping[str, Any]
) -> dict[str, dict[str, str]]:
    """Step -> {"command", "python"}, for a terminal and an interpreter that run in the studio's folder."""
    name, place = shell_word(file.name), shell_word(folder.name)
    own = "" if folder.name == Path(file.stem).name else f" --out {place}"
    commands = {
        "data": f"hysid init {name}\nhysid check {name}",
        "fit": f"hysid fit {name}{own}",
        "posterior": f"hysid sample {place}",
        "compensator": f"hysid qualify {place} NEW.csv\nhysid predict {place} NEW.csv --inverse",
        "export": f"hysid export {place} --c {place}/{header_name(folder)}"
        f" --runtime {place}/compensator.json",
        "report": f"hysid report {place}",
    }
    python = dict.fromkeys(commands, "")
    if selection is not None:
        python = _python(file, folder, selection, fit)
    return {step: {"command": commands[step], "python": python[step]} for step in commands}


def _python(
    file: Path, folder: Path, selection: Selection, fit: Mapping[str, Any]
) -> dict[str, str]:
    lines = ["import hysid"]
    options: dict[str, Any] = {"input": selection.input, "output": selection.output}
    options |= _given(selection, OPTIONS)
    reading = _given(selection, OF_READING)
    source = repr(file.name)
    if reading:
        source = f"hysteresis.read_table({source}, {_said(reading)})"
        lines = ["import hysid, hysteresis"]
    if selection.where:
        pairs = (condition.partition("=") for condition in selection.where)
        options["where"] = {
            name.strip(): [v.strip() for v in values.split(",")] for name, _, values in pairs
        }
    if isinstance(options["input"], tuple):
        options["input"] = list(options["input"])
    double = "hysid.enable_x64()"
    loaded = f"fit = hysid.load({folder.name!r})"
    rest = {
        "posterior": f"import hysid\n{double}\n{loaded}\nposterior = hysid.sample(fit, seed=0)",
        "compensator": f"import hysid\n{double}\n{loaded}\n"
        "compensator = hysid.invert(fit.model, trained=fit.trained)\n"
        "estimate = compensator.simulate(fit.train.time, fit.train.output)",
        "export": f"import hysid\nfrom compensate import export_c\n{double}\n{loaded}\n"
        f"export_c(fit.model, {f'{folder.name}/{header_name(folder)}'!r}, fit.train.output,"
        " times=fit.train.time, trained=fit.trained)",
        "report": f"import hysid\n{double}\n{loaded}\nhysid.report(fit, {folder.name + '/report.html'!r})",
    }
    if selection.is_step or selection.each is not None:
        said = "of a constant input" if selection.is_step else f"of each value of {selection.each}"
        python = f"# The command line makes the records {said} by itself."
        return {"data": python, "fit": python, **rest}
    lines += [f"record = hysid.read_csv({source}, {_said(options)})"]
    if selection.exclude_lines:
        lines += [f"record = record.exclude({_on_lines(selection.exclude_lines)})"]
    test = ""
    if selection.test_cycles is not None:
        lines += [f"train, test = record.split_cycles({selection.test_cycles})"]
    elif selection.test_tail is not None:
        lines += [f"train, test = record.split_tail({selection.test_tail})"]
    elif selection.test_lines:
        lines += [f"train, test = record.split_rows({_on_lines(selection.test_lines)})"]
    elif selection.test_where:
        lines += [
            "# --test-where holds out sequences or rows: record.split_groups, record.split_rows"
        ]
        lines += ["train, test = record, None"]
    else:
        lines += ["train, test = record, None"]
    test = "test=test"
    chosen = {key: value for key, value in fit.items() if key != "model"}
    model = fit.get("model", "auto")
    model = ",".join(model) if isinstance(model, list) else model
    more = "".join(f", {key}={value!r}" for key, value in chosen.items())
    fitted = [
        *lines, double, f"fit = hysid.fit(train, {model!r}, {test}{more})",
        f"hysid.save(fit, {folder.name!r}, overwrite=True)",
    ]  # fmt: skip
    return {"data": "\n".join([*lines, "print(record)"]), "fit": "\n".join(fitted), **rest}


def _given(selection: Selection, names: tuple[str, ...]) -> dict[str, Any]:
    """The options that differ from their defaults."""
    found = {name: getattr(selection, name) for name in names}
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in found.items()
        if value not in (None, (), USUAL.get(name))
    }


def _said(options: Mapping[str, Any]) -> str:
    return ", ".join(f"{key}={value!r}" for key, value in options.items())


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


def _on_lines(ranges: tuple[str, ...]) -> str:
    parts = []
    for one in ranges:
        first, _, last = one.partition("-")
        parts.append(f"(record.line >= {int(first)}) & (record.line <= {int(last or first)})")
    return parts[0] if len(parts) == 1 else " | ".join(f"({part})" for part in parts)
