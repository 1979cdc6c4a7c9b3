"""What each step of the page is on the command line, and in Python: lines that run as they stand."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hysteresis._escape import shell_word

from ..intake._creep_fits import step_options
from ..intake._own_config import config_of, folder_of
from ..intake._selection import OF_RECORD, Selection
from ..intake._selection_options import FIELDS, OF_READING

OPTIONS = tuple(name for name in OF_RECORD if name not in (*OF_READING, "input", "output", "where"))
"""Options of `read_csv` that a selection may hold, beside those of reading, in the order of writing."""
USUAL = {"nan": "raise", "decimal": "."}


def equivalents(
    file: Path,
    folder: Path,
    selection: Selection | None,
    fit: Mapping[str, Any],
    value: str = ".",
) -> dict[str, dict[str, str]]:
    """Step -> {"command", "python"}, for a terminal and an interpreter that run in the studio's folder.

    `value`: the folder within `folder` of the fit that is shown, where a fit was made of each value.
    """
    name, place = shell_word(file.name), shell_word(folder.name)
    own = "" if folder.name == folder_of(file).name else f" --out {place}"
    own += " --overwrite" if folder.exists() else ""
    begun = config_of(file).exists()
    commands = {
        "data": f"{'# ' if begun else ''}hysid init {name}\nhysid check {name}",
        "fit": f"hysid fit {name}{own}",
        "posterior": f"hysid sample {place}",
        "compensator": f"hysid qualify {place} NEW.csv\nhysid predict {place} NEW.csv --inverse",
        "export": f"hysid export {place} --c {place}/{header_name(folder)}"
        f" --runtime {place}/compensator.json",
        "report": f"hysid report {place}",
    }
    python = dict.fromkeys(commands, "")
    if selection is not None:
        python = _python(file, folder, selection, fit, value)
    return {step: {"command": commands[step], "python": python[step]} for step in commands}


def _python(
    file: Path, folder: Path, selection: Selection, fit: Mapping[str, Any], value: str
) -> dict[str, str]:
    options: dict[str, Any] = {"input": selection.input, "output": selection.output}
    options |= _given(selection, OPTIONS)
    if isinstance(options["input"], tuple):
        options["input"] = list(options["input"])
    if columns := sorted({_column(condition) for condition in selection.test_where}):
        options["keep"] = columns
    reading = _given(selection, OF_READING)
    each = selection.each is not None
    source = repr(file.name)
    if reading or each:
        source = f"hysteresis.read_table({_said_first(file.name, reading)})"
    pairs = (condition.partition("=") for condition in selection.where)
    where = [f"{n.strip()!r}: {[v.strip() for v in values.split(',')]!r}" for n, _, values in pairs]
    double = "hysid.enable_x64()"
    place = folder.name if value == "." else f"{folder.name}/{value}"
    loaded = f"fit = hysid.load({place!r})"
    rest = {
        "posterior": f"import hysid\n{double}\n{loaded}\nposterior = hysid.sample(fit, seed=0)",
        "compensator": f"import hysid\n{double}\n{loaded}\n"
        "compensator = hysid.invert(fit.model, trained=fit.trained)\n"
        "estimate = compensator.simulate(fit.train.time, fit.train.output)",
        "export": f"import hysid\nfrom compensate import export_c\n{double}\n{loaded}\n"
        f"export_c(fit.model, {f'{place}/{header_name(folder)}'!r}, fit.train.output,"
        " times=fit.train.time, trained=fit.trained)",
        "report": f"import hysid\n{double}\n{loaded}\nhysid.report(fit, {place + '/report.html'!r})",
    }
    if selection.is_step:
        return _of_constant_input(file, folder, selection, fit) | rest
    chosen = {key: value for key, value in fit.items() if key != "model"}
    model = fit.get("model", "auto")
    model = ",".join(model) if isinstance(model, list) else model
    fitted = f"hysid.fit({', '.join(['train', repr(model), 'test=test', *_words(chosen)])})"
    if not each:
        where = [f"where={{{', '.join(where)}}}"] if where else []
        made = [f"record = hysid.read_csv({', '.join([source, *_words(options), *where])})"]
        made += _held_out(selection)
        top = _imports(made)
        return {
            "data": "\n".join([*top, *made, "print(record)"]),
            "fit": "\n".join([
                *top, *made, double, f"fit = {fitted}",
                f"hysid.save(fit, {folder.name!r}, overwrite=True)",
            ]), **rest,
        }  # fmt: skip
    rows = " & ".join(f"hysteresis.parse_condition({c!r})(table)" for c in selection.where)
    cells = f"table.text[{selection.each!r}]{f'[{rows}]' if rows else ''}"
    where = f"where={{{', '.join([*where, f'{selection.each!r}: [value]'])}}}"
    made = [f"record = hysid.read_csv({', '.join(['table', *_words(options), where])})"]
    made += _held_out(selection)
    begin = ["import hysid, hysteresis", f"table = {source}"]
    loop = f"for value in dict.fromkeys({cells}.tolist()):"
    data = [*begin, loop, *(f"    {line}" for line in [*made, "print(value, record)"])]
    fits = [*begin, double, "fits = {}", loop, *(f"    {line}" for line in made),
            f"    fits[value] = {fitted}"]  # fmt: skip
    return {"data": "\n".join(data), "fit": "\n".join(fits), **rest}


def _of_constant_input(
    file: Path, folder: Path, selection: Selection, fit: Mapping[str, Any]
) -> dict[str, str]:
    """Records and fit of creep or relaxation, of one record or of each value."""
    options = {name: getattr(selection, name) for name in FIELDS}
    given = {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in options.items()
        if value not in (None, (), False, USUAL.get(name))
    }
    made = f"pairs = hysid.records({_said_first(file.name, given)})"
    each = "for value, (train, test) in pairs.items():"
    words = ["train", "test=test", *_words(step_options(dict(fit)))]
    fits = f"    fits[value] = hysid.fit_step({', '.join(words)})"
    one = [] if selection.each is not None else [
        f"hysid.save(fits[''], {folder.name!r}, overwrite=True)"
    ]  # fmt: skip
    double = "hysid.enable_x64()"
    return {
        "data": "\n".join(["import hysid", made, each, "    print(value, train)"]),
        "fit": "\n".join(["import hysid", made, double, "fits = {}", each, fits, *one]),
    }


def _imports(lines: list[str]) -> list[str]:
    return ["import hysid, hysteresis" if "hysteresis." in "".join(lines) else "import hysid"]


def _held_out(selection: Selection) -> list[str]:
    """From `record` to `train` and `test`, as `Selection.records` does it."""
    lines = []
    if selection.exclude_lines:
        lines += [f"record = record.exclude({_on_lines(selection.exclude_lines)})"]
    if selection.test_cycles is not None:
        lines += [f"train, test = record.split_cycles({selection.test_cycles})"]
    elif selection.test_tail is not None:
        lines += [f"train, test = record.split_tail({selection.test_tail})"]
    elif selection.test_lines:
        lines += [f"train, test = record.split_rows({_on_lines(selection.test_lines)})"]
    elif selection.test_where:
        held = (f"hysteresis.parse_condition({c!r})(record)" for c in selection.test_where)
        lines += [
            f"held = {' & '.join(held)}",
            "whole = [label for label, rows in record.sequences() if held[rows].all()]",
            "some = [label for label, rows in record.sequences() if held[rows].any()]",
            "if whole == some and len(whole) < len(record.labels):",
            "    train, test = record.split_groups(whole)",
            "else:",
            "    train, test = record.split_rows(held)",
        ]
    else:
        lines += ["train, test = record, None"]
    if selection.branch is not None or selection.range:
        asked = f"{selection.branch!r}, {tuple(selection.range) or None!r}"
        lines += [f"train, test = (x and x.select({asked}) for x in (train, test))"]
    return lines


def _given(selection: Selection, names: tuple[str, ...]) -> dict[str, Any]:
    """The options that differ from their defaults."""
    found = {name: getattr(selection, name) for name in names}
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in found.items()
        if value not in (None, (), USUAL.get(name))
    }


def _words(options: Mapping[str, Any]) -> list[str]:
    return [f"{key}={value!r}" for key, value in options.items()]


def _said_first(file: str, options: Mapping[str, Any]) -> str:
    return ", ".join([repr(file), *_words(options)])


def _column(condition: str) -> str:
    return condition.partition("=")[0].partition("%")[0].strip()


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
