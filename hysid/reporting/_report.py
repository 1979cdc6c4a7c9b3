"""The report of a fit, made anew from the files in its folder, and that of a data sheet: one page each."""

import math
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import identify
from hysteresis import Burgers, InputError, LinearSponge, Preisach
from hysteresis._escape import shell_word, visible
from hysteresis._files import telling, write_figure, write_whole
from hysteresis._limits import damage_told
from hysteresis._precision import in_own_precision
from hysteresis.records._units import name_and_unit
from identify import load_posterior, save_posterior
from identify.results._data_sheet import DataSheet
from identify.results._detail import (
    Composition,
    DiscreteSpectrum,
    GridWeights,
    Motion,
    ReversalCurves,
)

from .._catalogue import is_synthetic
from .._plots_script import script, script_rule, styles
from ..figures import _base as f
from ..figures._data_sheet import PANELS, draw_panel, draw_sheet, subtitle, title
from ..figures._format import measured, pretty, quantity
from ..intake._options import FIELDS, HELD_OUT, option_words
from . import _section_creep as _report_step
from . import _section_motion as _motion
from ._case import TARGET, Case, Section, Table
from ._section_diagnostics import believed
from ._section_fit import baselines, candidates, data, loop_figures, loops, parameters, residuals
from ._section_model import channels, compensator, density, posterior

TEMPLATE, LIVE = "report.html.j2", "live.js"
HEADLINES = {
    "PASS": "The model can be used inside its training range.",
    "CAUTION": "The model can be used with care; read the reasons.",
    "FAIL": "Do not use this model.",
}


TAIL = 0.25
"""The share of a record that is held out where it has no second cycle."""
Tell = Callable[[int, int, str], None]


def write_report(
    folder: str | Path, file: Path | None = None, tell: Tell = lambda done, total, text: None
) -> Path:
    """Write `file`, or `folder`/report.html, about the fit and the posterior that the folder holds.

    A page at another place names its folder as DIR, because the commands on it need a saved fit.
    `tell(done, total, text)` is called for each section.

    Raises `InputError` where the folder holds no fit, or a damaged one, or cannot be written to.
    """
    folder = Path(folder)
    with damage_told("The fit", folder, "Fit again."):
        fitted, document = identify.internal.read_fit(folder)
        named = Path("DIR") if file else folder
        case = Case(named, document, fitted, load_posterior(folder))
        for key in ("candidates", "skipped", "data", "seed", "seconds", "versions"):
            document[key]
    of_step = isinstance(case.fit.detail, DiscreteSpectrum)
    of_motion = isinstance(case.fit.detail, Motion)
    makers = [
        make
        for make in (STEP_SECTIONS if of_step else MOTION_SECTIONS if of_motion else SECTIONS)
        if (make is not density or isinstance(case.fit.detail, GridWeights))
        and (make is not channels or case.fit.channels is not None)
        and (make is not loop_figures or case.fit.channels is None)
        and make is not (parameters if case.fit.detail.is_linear else made_of)
    ]
    sections: list[Section] = []
    for done, make in enumerate(makers, 1):
        sections.append(make(case))
        tell(done, len(makers), sections[-1].title)
    data, name = document["data"], folder.resolve().name
    if of_step:
        heading = _report_step.title(case)
    else:
        conditions = (name_and_unit(name)[0] for name in case.fit.train.conditions)
        given = " and ".join((case.input, *conditions))
        heading = f"{case.output[:1].upper()}{case.output[1:]} from {given}"
        heading += "" if case.fit.detail.is_linear else f" by {case.fit.name}"
    if not file and name != Path(data["source"] or "").stem:
        heading += f" ({name})"  # such as a value of --each
    return render(
        file or folder / TARGET,
        title=heading,
        subtitle=f"{data['source'] or 'arrays'}, {data['rows_train']:,} training and"
        f" {data['rows_test']:,} held-out rows"
        + (", synthetic data of a virtual rig" if is_synthetic(data.get("sha256")) else ""),
        level=case.fit.verdict.level,
        headline=HEADLINES[case.fit.verdict.level],
        reasons=case.fit.verdict.reasons,
        answers=answers(case),
        answers_note="The specimen, by the model over the fitted rows. ± is how far the readings of the"
        " same cycles or holds are from that.",
        facts=facts(case),
        model="" if case.fit.detail.is_linear else in_words(case),
        command=next_command(case),
        sections=sections,
    )


def answers(case: Case) -> list[tuple[str, str, str]]:
    """What the specimen does: name, value with error or why there is none, and what it is told from."""
    # Moduli and steps have no cycles whose absence would tell anything.
    cycles = not isinstance(case.fit.detail, DiscreteSpectrum)
    found = (one for one in case.fit.characteristics if cycles or one.value is not None)
    return [(one.name, measured(one), one.reason or one.basis) for one in found]


def facts(case: Case) -> list[tuple[str, str]]:
    unit = case.units[1]
    word, _ = case.judged
    metrics = case.fit.metrics
    judged = metrics["test"] or metrics["train"]
    assert judged is not None
    assert metrics["train"] is not None
    facts = [
        ("verdict for the purpose", case.fit.purpose),
        (f"{word} error, rms", quantity(judged.rmse, unit)),
        (f"{word} error, largest", quantity(judged.max_abs, unit)),
        (f"{word} error, of the range", quantity(judged.nrmse_percent, "%")),
    ]
    if metrics["test"] is not None:
        facts.append(("fitted rows, of the range", quantity(metrics["train"].nrmse_percent, "%")))
    if isinstance(case.fit.detail, DiscreteSpectrum):
        return facts + _report_step.facts(case)
    if isinstance(case.fit.detail, Motion):
        return [*facts, ("chi2 per row", quantity(case.fit.detail.chi2, "1"))]
    if not isinstance(trip := case.round_trip, InputError):
        some = "" if len(trip.record) == len(case.judged[1]) else f" {int(trip.counted.sum()):,}"
        facts.append((f"compensator on{some} {word} rows, rms", quantity(trip.rms, case.units[0])))
    return facts


def made_of(case: Case) -> Section:
    """The technical sum of parts, with the parameters that the data determine."""
    section = parameters(case)
    said = f"{case.fit.name}. {in_words(case)}"
    if not isinstance(case.fit.detail, ReversalCurves):
        said += " Its weights come from non-negative least squares."
    section.text.insert(0, said)
    section.title, section.folded = "What the model is made of", True
    return section


PARTS_IN_WORDS = {
    "curve": "a rising curve",
    "Maxwell": "Maxwell branches, which relax",
    "strengths": "relaxation whose strength depends on the input level",
    "softening": "extra stiffness beyond the largest past input",
    "relays": "relays that remember reversals of the input",
    "plays": "elements that follow the input behind a backlash",
    "stops": "friction elements",
    "stops by position": "friction elements whose strength depends on the input's position",
    "stops by span": "friction elements whose strength depends on the range that the input has covered",
    "friction": "friction that depends on the speed of the input",
    "drift": "a drift with the path that the input has travelled",
    "drift in time": "a drift with the time since the first sample",
}


def in_words(case: Case) -> str:
    model, (input_unit, output_unit) = case.fit.model, case.units
    if isinstance(case.fit.detail, DiscreteSpectrum):
        return _report_step.in_words(case)
    if isinstance(model, LinearSponge):
        slope = quantity(float(model.K), pretty(f"{output_unit} / {input_unit}"))
        text = f"A straight line, {slope} × {case.input} + {quantity(float(model.b), output_unit)}"
        if math.isfinite(float(model.threshold)):
            text += f", above a threshold of {quantity(float(model.threshold), input_unit)}"
        return f"{text}. It has no memory, so no loop."
    if isinstance(model, Burgers):
        return (
            "A Burgers element: a spring and a dashpot in series with a spring and dashpot in parallel."
            f" Its {case.output} creeps and depends on the rate."
        )
    if isinstance(case.fit.detail, Composition):
        composed = case.fit.detail.linear
        said = [PARTS_IN_WORDS[part] for part in composed.meaning.parts]
        text = f"A sum of {', '.join(said)}"
        if not case.fit.detail.rises:
            text += ", whose weights may have either sign"
        if composed.meaning.first:
            text += ", of an input mapped by a curve"
        if composed.meaning.floor is not None:
            text += f", on a floor at {quantity(composed.meaning.floor, output_unit)}"
        if lag := case.fit.clocks.lag:
            text += f"; its input is shifted {quantity(lag, case.fit.train.time_unit)} earlier"
        condition = case.fit.condition
        return f"{text}." if condition is None else f"{text}. {condition}"
    if not isinstance(model, Preisach):
        first = (type(model).__doc__ or type(model).__name__).split("\n")[0]
        return first if first.endswith(".") else f"{first.rstrip(':,')}."
    return (
        "A Preisach model: a density of relays plus a memoryless curve."
        f" Its {case.output} {'leads' if model.leading else 'lags behind'} the {case.input},"
        " remembers its reversals, and does not depend on the rate."
    )


SECTIONS: tuple[Callable[[Case], Section], ...] = (
    loops, loop_figures, channels, residuals, parameters, believed, posterior, density, compensator,
    candidates, made_of, data,
)  # fmt: skip
MOTION_SECTIONS: tuple[Callable[[Case], Section], ...] = (
    _motion.response, _motion.hysteresis, parameters, posterior, _motion.residuals, _motion.classes,
    baselines, data,
)  # fmt: skip
STEP_SECTIONS: tuple[Callable[[Case], Section], ...] = (
    _report_step.curve, _report_step.spectrum, parameters, _report_step.residuals, baselines, data,
)  # fmt: skip


def next_command(case: Case) -> tuple[str, str]:
    """What to do next, and the command, which runs as it stands where the fit was made from a file."""
    folder, fit = shell_word(str(case.folder)), case.fit
    inputs = [fit.train.input_name] if fit.channels is None else fit.channels.names
    by_name = {"input": tuple(inputs), "output": fit.train.output_name}
    chosen = dict(case.document.get("selection", by_name))
    words = option_words([one for name, one in FIELDS.items() if name not in HELD_OUT], chosen)
    looked_at = " ".join(map(shell_word, words))
    source = shell_word(fit.train.source or "FILE")
    if not fit.trusted:
        return "Check the data, then fit again", f"hysid check {source} {looked_at}"
    if fit.test is None:
        count = 0 if chosen.get("step") else int(fit.train.cycle_counts.min())
        held = "--test-cycles 1" if count > 1 else f"--test-tail {TAIL}"
        if isinstance(fit.detail, Motion):
            held = f"--model {shell_word(fit.name)} --test-tail {TAIL}"
        elsewhere = shell_word(f"{case.folder}-held-out")
        return (
            "Hold out some rows and fit again",
            f"hysid fit {source} {looked_at} {held} --out {elsewhere}",
        )
    if isinstance(fit.detail, DiscreteSpectrum):
        what = "Predict the times of this file, or of another, with their range"
        return what, f"hysid predict {folder} {source}"
    if isinstance(fit.detail, Motion):
        steady = " --steady" if fit.detail.recorded.period else ""
        return "Predict the motion under another force", f"hysid predict {folder} {source}{steady}"
    if case.posterior is None:
        return "Sample the posterior to quantify the uncertainty", f"hysid sample {folder}"
    if fit.channels is not None:
        return "Run the model over this file, or over new data", f"hysid predict {folder} {source}"
    return (
        "Run the compensator over this file, or over new data",
        f"hysid predict {folder} {source} --inverse",
    )


def _visible(value: Any) -> Any:
    """What the template fills in: text of others without marks of direction; macros are text already."""
    return visible(value, keep="\n\t") if type(value) is str else value


def render(file: Path, **words: Any) -> Path:
    """Fill the template. Raises `InputError` `cannot-write`."""
    import jinja2

    loader = jinja2.FileSystemLoader(Path(__file__).parent)
    page = jinja2.Environment(
        loader=loader, autoescape=True, finalize=_visible, trim_blocks=True, lstrip_blocks=True
    )
    parts = [part for section in words["sections"] for part in (section, *section.parts)]
    if any(picture.curves for part in parts for picture in part.pictures):
        words |= {"script": script(LIVE), "styles": styles()}
    text = page.get_template(TEMPLATE).render(script_rule=script_rule(LIVE), **words)
    with telling(file, "Make the folder writable, or copy it and report on the copy."):
        write_whole(file, text)
    return file


FIRST = (
    "sensitivity", "non-linearity, best line", "hysteresis", "repeatability", "creep", "zero return",
)  # fmt: skip
"""Lines that stand large on the page."""


@in_own_precision
def write_data_sheet(sheet: DataSheet, path: str | Path) -> Path:
    """Write a data sheet: an HTML file that needs no other, or one page of PDF, by the file's name.

    **Arguments:**

    - `sheet`: what `data_sheet` returned.
    - `path`: the file, which is overwritten; .pdf, .png or .svg is the printed page, anything else HTML.

    **Returns:** the path of the file.

    **Raises:** `InputError` `cannot-write` where the file cannot be written.

    **Example:**

        >>> sheet = identify.data_sheet(record)
        >>> hysid.write_data_sheet(sheet, folder / "sensor.html").name
        'sensor.html'
    """
    path = Path(path)
    if path.suffix.lower() in (".pdf", ".png", ".svg"):
        with telling(path):
            f.styled(write_figure)(draw_sheet(sheet), path, dpi=150)
        return path
    pictures, lines = Section("Pictures"), Section("Lines")
    for draw, caption in PANELS:
        pictures.draw(draw_panel(sheet, draw), caption, caption)
    rows = [
        (row.name, measured(row), row.basis or row.reason, row.definition) for row in sheet.rows
    ]
    lines.tables.append(Table("", ("line", "value", "from", "definition"), rows))
    first = [sheet[name] for name in FIRST]
    return render(
        path,
        title=title(sheet),
        subtitle=subtitle(sheet),
        level="",
        headline="In short",
        answers=[(row.name, measured(row), row.basis or row.reason) for row in first],
        answers_note="± is the standard error that the noise of the readings leaves.",
        sections=[lines, pictures],
    )


@in_own_precision
def report(
    fit: identify.FitResult,
    path: str | Path = TARGET,
    posterior: identify.internal.Posterior | None = None,
) -> Path:
    """Write the report of a fit, and of its posterior, as one HTML file that needs no other.

    **Arguments:**

    - `fit`: what `fit` or `fit_step` returned.
    - `path`: the file, which is overwritten.
    - `posterior`: what `sample` returned for this fit.

    **Returns:** the path of the file.

    **Raises:** `InputError` `cannot-write` where the file cannot be written.

    **Example:**

        >>> hysid.report(fit, folder / "fit.html").name
        'fit.html'
    """
    with TemporaryDirectory() as folder:
        identify.save(fit, folder, overwrite=True)
        if posterior is not None:
            save_posterior(posterior, folder)
        return write_report(folder, Path(path))
