"""Report section on the diagnostics of a fit."""

import math
from collections.abc import Iterator

import numpy as np

import identify
from hysteresis import InputError, parameters
from identify.internal import profiles, target
from identify.posterior._log_posterior import Target

from ..figures import _diagnostics as f
from ..figures._format import label, number, pretty, quantity
from ._case import Case, Section, Table

MOST_ROWS = 20_000
"""Rows of a record up to which parameters are optimised anew for the report: some seconds of work."""

REFINED = 4
"""Starts that a fit follows to their end."""

WORST = 8
"""Parts of one kind in the table, at most."""


def believed(case: Case) -> Section:
    """Every diagnostic that makes sense for the fit, each under the question it answers."""
    section = Section("Can the results be trusted?", [
        "Each diagnostic below tests the fit. The first sentence under each question answers it."
    ])  # fmt: skip
    section.parts = [part for part in _parts(case) if part is not None]
    return section


def _parts(case: Case) -> Iterator[Section | None]:
    yield _noise(case)
    yield _whiteness(case)
    yield _breakdown(case)
    yield _starts(case)
    try:
        aim = target(case.fit)
    except InputError:
        aim = None
    long = len(case.fit.train) > MOST_ROWS
    if aim is not None and not long:
        yield _profiles(case, aim)
        yield _sloppiness(case)
    if not long or case.posterior is not None:
        yield _predictive(case)
    if aim is not None and not long:
        yield _sensitivity(case)
    if long:
        yield Section("Skipped diagnostics", [
            f"For more than {MOST_ROWS:,} rows the report skips what would be fitted or sampled anew:"
            " profiles, combinations of parameters and fits without single cycles of a model of few"
            " parameters, and predictive bands where no posterior was drawn. identify.profile,"
            " identify.sloppiness, identify.sensitivity and identify.predictive compute them."
        ])  # fmt: skip


def _noise(case: Case) -> Section:
    fit, unit = case.fit, case.units[1]
    noise, model = fit.noise, fit.noise_model
    counts = f"{noise.samples:,} rows count as {noise.effective:,.0f} independent ones"
    section = Section("What is the noise?")
    if model is None:
        section.text.append(
            f"The residuals are {quantity(noise.sigma, unit)} rms, correlated over"
            f" {number(noise.correlation_time)} samples: {counts}, and the standard errors are widened"
            " accordingly. No noise model explains them"
            f"{'' if fit.detail.is_linear else '; treat them as model error'}."
        )
        return section
    section.text.append(f"{model.words[:1].upper()}{model.words[1:]}: {counts}.")
    units: dict[str, str] = dict(zip(("input", "output"), case.units, strict=True))
    rows = [
        (name, number(float(value)), pretty(units.get(info.unit, info.unit)) or "1", info.meaning)
        for name, info, value in parameters(model)
        if value is not None
    ]
    section.tables.append(Table("", ("Part", "Value", "Unit", "Meaning"), rows))
    if len(evidence := fit.noise_evidence) > 1:
        ranked = sorted(evidence.items(), key=lambda item: item[1])
        listed = ", ".join(f"{kind} {number(over)}" for kind, over in ranked[1:4])
        section.notes.append(
            f"Chosen by evidence among {len(ranked)} noise models. Log-evidence below it: {listed}."
            " A model that is 3 or more below is unlikely."
        )
    return section


def _whiteness(case: Case) -> Section:
    found = identify.whiteness(case.fit)
    section = Section("Are the residuals white?", [" ".join(found.said)])
    caption = (
        "Correlation of the residuals with themselves, with the input and with its speed, over the lag in"
        " rows; at negative lags the input comes later. Bars outside the dotted lines are statistically"
        " significant."
    )
    if case.fit.noise_model is not None and case.fit.noise_model.phi is not None:
        caption += (
            " These are one-step-ahead errors: the prediction of the noise model is subtracted."
        )
    alt = "Autocorrelation of the residuals and their correlation with the input and its speed"
    section.draw(f.residual_correlation(found), alt, caption)
    return section


def _breakdown(case: Case) -> Section:
    unit = case.units[1]
    found = identify.breakdown(case.fit)
    section, rows = Section("Where is the model wrong?", [found.said]), []
    for kind in ("branch", "rate", "input", "cycle"):
        parts = found.of(kind)
        shown = sorted(parts, key=lambda part: -part.rmse)[:WORST] if len(parts) > WORST else parts
        for part in shown:
            away = f"{part.excess:+.1f}".replace("-", "−")
            rows.append((
                part.name, f"{part.rows:,}", quantity(part.rmse, unit), quantity(part.bias, unit),
                f"{100 * part.share:.0f} %", away,
            ))  # fmt: skip
        if len(parts) > WORST:
            section.notes.append(f"The worst {WORST} of {len(parts)} parts by {kind} are shown.")
    columns = ("Rows", "Count", "rms error", "Mean error", "Share of squares", "Significance")
    said = (
        "Fitted rows. Significance: difference between the mean squares of the part and of all rows, in"
        " standard deviations."
    )
    section.tables.append(Table(said, columns, rows))
    if case.fit.test is not None:
        held_out = identify.breakdown(case.fit, case.fit.test)
        section.text.append(f"Held-out rows: {held_out.said[:1].lower()}{held_out.said[1:]}")
    return section


def _starts(case: Case) -> Section:
    section, starts = Section("Is there a better minimum?"), case.fit.starts
    if starts is None:
        section.text.append(
            "No. The fit of this model is a convex problem, which has one minimum. No starts were needed."
        )
        return section
    errors = np.sqrt(starts.objective)
    # Short runs stop near the minimum, not at it.
    same = int((errors <= 1.01 * errors[0]).sum())
    text = f"{same} of {len(errors)} starts reach the least error, within 1 %."
    failed = int((~np.isfinite(errors)).sum())
    if failed:
        text += f" {failed} gave no finite output."
    if same == 1 < len(errors):
        text += " A minimum that only one start finds may not be the best one. Use more starts."
    section.text.append(text)
    caption = (
        "Error of every start, sorted. If many starts share the lowest error, the minimum is reliable."
        " A low error far from the best parameters is an alternative solution."
    )
    alt = f"Errors of {len(errors)} starts, sorted; {same} of them share the lowest"
    figure = f.waterfall(starts, refined=REFINED, unit=case.units[1])
    section.draw(figure, alt, caption)
    return section


def _profiles(case: Case, aim: Target) -> Section:
    found = profiles(case.fit)
    open_ = [p.said for p in found if p.low is None or p.high is None or p.others]
    text = " ".join(open_) or "The data bound every parameter from both sides."
    section = Section("How precisely is each parameter known?", [text])
    priors = zip(aim.bounds.names, aim.bounds.priors, strict=True)
    if asked := ", ".join(f"{name}: {prior}" for name, prior in priors if not prior.default):
        section.text.append(f"User-specified priors: {asked}.")
    unit = {p.name: pretty(p.unit) or "1" for p in found}
    fitted = {p.name: p for p in case.fit.parameters}
    rows = []
    for p in found:
        error = fitted[p.name].stderr
        ends = [number(end) if end is not None else "none" for end in (p.low, p.high)]
        status = fitted[p.name].status
        rows.append((
            p.name, number(p.best), *ends, unit[p.name],
            f"± {number(error)}" if error is not None and math.isfinite(error) else status,
        ))  # fmt: skip
    columns = ("Parameter", "Maximum likelihood", "Low, 90 %", "High, 90 %", "Unit",
               "Standard error")  # fmt: skip
    section.tables.append(Table("", columns, rows))
    errors = [fitted[p.name].stderr for p in found]
    caption = (
        "Profile likelihood: one parameter is fixed at each value and all others are refitted. The interval"
        " ends where the blue line crosses the red one. Where the blue line departs from the dashed"
        " parabola, the symmetric standard error is misleading. Where it is flat, the data do not"
        " determine the parameter."
    )
    figure = f.profiles(found, errors)
    section.draw(figure, "Profile likelihood of each parameter", caption)
    return section


def _sloppiness(case: Case) -> Section:
    found = identify.sloppiness(case.fit)
    section = Section("Which combinations of parameters are known?", [" ".join(found.said)])
    if len(found.names) > 1:
        condition = number(found.condition) if math.isfinite(found.condition) else "beyond rounding"
        section.text.append(f"Condition number of the Fisher information: {condition}.")
    return section


def _predictive(case: Case) -> Section | None:
    word, record = case.judged
    try:
        found = identify.predictive(case.fit, posterior=case.posterior)
    except InputError as error:  # of weights of a state, or of an earlier version
        if error.code != "no-posterior":
            raise
        return None
    section = Section("Do new readings lie inside the predictive bands?", [found.said])
    levels = [f"{100 * level:.0f} % band" for level in identify.LEVELS]
    rows = [
        (name, *(f"{100 * share:.0f} %" for share in shares))
        for name, shares in found.cycles.items()
    ]
    rows = [*rows[:WORST], (f"all {word}", *(f"{100 * share:.0f} %" for share in found.coverage))]
    caption = "Share of the readings inside each band." + (
        " The bands use Laplace's approximation of the posterior." if case.posterior is None else ""
    )
    section.tables.append(Table(caption, ("Rows", *levels), rows, strong=len(rows) - 1))
    clock = len(record.labels) == 1 and record.time is not None
    x = record.time[found.rows] if clock and record.time is not None else None
    x_label = case.time_label if clock else "row"
    usual = int(np.min(np.diff(found.rows), initial=len(record)))
    inside = np.searchsorted(record.starts, found.rows, side="right")
    gaps = np.flatnonzero((np.diff(found.rows) > 2 * usual) | (np.diff(inside) > 0)) + 1
    words = {"x_label": x_label, "gaps": gaps}
    figure = f.bands(found, x, y_label=case.output_label, **words)
    caption = f"Predictive bands over the {word} rows, including the noise."
    section.draw(figure, f"Predictive bands of {case.output}", caption)
    y_label = label("measured − median", case.units[1])
    figure = f.bands(found, x, y_label=y_label, about=True, **words)
    caption = "The same bands with the median subtracted, which shows their widths."
    section.draw(figure, "Predictive bands around their median", caption)
    return section


def _sensitivity(case: Case) -> Section:
    found = identify.sensitivity(case.fit)
    section = Section("Which rows does the fit depend on?", [" ".join(found.said)])
    rows = []
    for without in found.cases:
        shown = [
            "—" if not math.isfinite(change) else f"{change:+.1f}".replace("-", "−")
            for change in without.changes
        ]
        rows.append((without.said, f"{without.rows:,}", f"± {without.expected:.1f}", *shown))
    if rows:
        said = "Change of each parameter, in its standard errors, when the fit excludes some rows."
        columns = ("Excluded", "Rows", "Expected", *found.names)
        section.tables.append(Table(said, columns, rows))
    return section
