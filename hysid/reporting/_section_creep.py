"""Report sections on creep, relaxation and moduli: the curve, its spectrum, predictions of later times."""

from collections.abc import Iterator

import numpy as np

import identify
from hysteresis import GeneralizedKelvinVoigt
from identify.results._detail import DiscreteSpectrum
from identify.spectra._superposition import Shifts

from ..figures import _base as f
from ..figures._format import label, number, pretty, quantity
from ..figures._survey import clock_of, master_of, pieces_of, shift_factors
from ..figures._survey import spectrum as drawn
from ._case import Case, Section, Table

LATER = (1.5, 3.0, 10.0, 30.0, 100.0)
"""Times of the table, in spans of the record."""
SHOWN = 3.0
"""Spans of the record that the pictures show, at least."""
WORDS = {"creep": "Creep", "relaxation": "Relaxation"}


def curve(case: Case) -> Section:
    """The measured answer, the model and its range, over linear and logarithmic time."""
    if identify.internal.is_survey(case.fit.train):
        return _master_curve(case)
    found, step = detail_of(case).spectrum, step_of(case)
    drawn = []
    for word, colour, t, y in _records(case):
        # Evenly in log time, so that the first seconds of a day are seen.
        picks = np.searchsorted(t, np.geomspace(t[t > 0][0], t[-1], f.MOST // 8))
        at = np.unique(np.append(np.linspace(0, len(t) - 1, min(len(t), 300)).astype(int), picks))
        drawn.append(f.Curve(f"measured, {word}", t[at], y[at], colour, "dots"))
    last = max(SHOWN * found.span, *(c.x[-1] for c in drawn))
    unit, begin = case.fit.train.time_unit, quantity(step, case.units[0])
    section = Section(WORDS[found.kind], [
        f"{case.output} after a step of the input to {begin}, from {quantity(found.step, unit)} to"
        f" {quantity(found.span, unit)} after the step."
    ])  # fmt: skip
    # Creep spans decades in both; a range of relaxation may reach down to 0.
    for log in ("", "xy" if found.kind == "creep" and step > 0 else "x"):
        t = np.geomspace(found.step, last, 200) if log else np.linspace(found.step, last, 200)
        value, low, high = (step * part for part in found.predict(t))
        curves = [*drawn, f.Curve("model", t, value, f.VERMILLION)]
        band = f.Band("range, 90 %", t, low, high)
        figure = f.chart(
            curves, case.time_label, case.output_label, band=band, end=found.span, log=log
        )
        how = "logarithmic" if log else "linear"
        caption = (
            f"{how.capitalize()} time axis. The fitted rows end at the dashed line. Beyond it the range"
            " covers every slow process that the fitted rows cannot exclude."
        )
        alt = f"{case.output} over {how} time: measured, model and range"
        section.draw(figure, alt, caption)
    t = found.span * np.array(LATER)
    table = []
    for when, value, low, high in zip(t, *found.predict(t), strict=True):
        ends = sorted((step * low, step * high))
        cells = [quantity(float(x), case.units[1]) for x in (step * value, *ends)]
        table.append((quantity(float(when), case.fit.train.time_unit), *cells))
    columns = (case.time.capitalize(), "Model", "At least", "At most")
    said = "Predictions of later times with their 90 % range."
    section.tables.append(Table(said, columns, table))
    return section


def spectrum(case: Case) -> Section:
    """Strengths over time constants, and what other orders would have given."""
    found, model, unit = detail_of(case).spectrum, case.fit.model, case.fit.train.time_unit
    unit = "s" if identify.internal.is_moduli(case.fit.train) else unit
    creep = isinstance(model, GeneralizedKelvinVoigt)
    known = {p.name: p for p in case.fit.parameters}
    order = range(1, found.order + 1)
    E = np.array([known[f"E{k}"].value for k in order])
    error = np.array([known[f"E{k}"].stderr or np.nan for k in order])
    other = np.array([known[f"{'eta' if creep else 'tau'}{k}"].value for k in order])
    section = Section("Spectrum")
    if found.order:
        tau, strength = (other / E, 1 / E) if creep else (other, E)
        error = error / E**2 if creep else error
        of_strength = case.units[1]
        if not identify.internal.is_moduli(case.fit.train):
            of_strength = " / ".join(case.units[::-1]).removesuffix(" / 1")
        figure = drawn(
            tau, strength, error, (found.step, found.span),
            label("time constant", unit), label("compliance" if creep else "stiffness", of_strength),
        )  # fmt: skip
        caption = (
            "Strength and time constant of each delayed element. The grey times lie outside the record:"
            " an element there acts as a spring or a dashpot, and its time constant is unknown."
        )
        section.draw(figure, "Strengths over time constants", caption)
    stiff = next(p.unit for name, p in known.items() if name.startswith("E"))
    told = f"E in {stiff}, tau in {unit}, V in {stiff} {unit}^alpha"
    section.text.append(f"In a few numbers, with the ranges that the rows leave ({told}):")
    section.text += [f"A {one}." for one in found.fractional()]
    least = min(row.evidence for row in found.table)
    tests = {c.name: c.metrics["test"] for c in case.fit.candidates}
    held_out = {k: quantity(t.nrmse_percent, "%") if t else "none" for k, t in tests.items()}
    rows = [
        (f"{row.order}", f"{row.parameters}", quantity(100 * row.rms, "%"),
         number(row.evidence - least), held_out[f"{type(model).__name__} {row.words}"])
        for row in found.table
    ]  # fmt: skip
    said = (
        "Orders tried. The lowest Bayesian information criterion is best; an order that is ten above it has"
        " very little support."
    )
    columns = ("Time constants", "Parameters", "Relative error, rms", "Criterion above the best",
               "Held-out error, of the range")  # fmt: skip
    section.tables.append(Table(said, columns, rows, strong=found.table.index(found.row)))
    return section


def residuals(case: Case) -> Section:
    """Residuals relative to the output, over logarithmic time."""
    if identify.internal.is_survey(case.fit.train):
        return _master_residuals(case)
    found, step = detail_of(case).spectrum, step_of(case)
    curves = []
    for word, colour, t, y in _records(case):
        relative = 100 * (step * found.predict(t).value / y - 1)
        at = f.thin(f.MOST // 2, relative)
        curves.append(f.Curve(word, np.log10(np.maximum(t[at], found.step)), relative[at], colour))
    x_label = f"log10 of {case.time} ({pretty(case.fit.train.time_unit) or 'no unit'})"
    figure = f.chart(curves, x_label, "predicted / measured − 1 (%)", zero=True)
    noise = found.noise
    text = (
        f"Residuals relative to the {case.output}, as the fit weights them: {number(100 * noise.sigma)} %"
        f" rms over the fitted rows, correlated over {number(noise.correlation_time)} rows."
    )
    caption = (
        "Residuals should look like noise. A wave means a missing time constant or a rig effect."
    )
    section = Section("Residuals", [text])
    section.draw(figure, "Relative residuals over time", caption)
    return section


def in_words(case: Case) -> str:
    """The model in a sentence."""
    found, model = detail_of(case).spectrum, case.fit.model
    count = f"{found.order} time constant{'s' if found.order != 1 else ''}"
    names = {p.name for p in case.fit.parameters if p.value}
    if isinstance(model, GeneralizedKelvinVoigt):
        parts = ["a spring"] * ("E0" in names) + ["a dashpot"] * ("eta0" in names)
        kind = "creeps: Kelvin-Voigt elements in series"
    else:
        parts, kind = ["a spring"] * ("E_inf" in names), "relaxes: Maxwell elements side by side"
    beside = f" and {' and '.join(parts)}" if parts else ""
    return f"The {case.output} {kind}, {count}{beside}."


def facts(case: Case) -> list[tuple[str, str]]:
    """The figures under the verdict, besides the errors."""
    found = detail_of(case).spectrum
    decades = np.log10(found.span / found.step)
    return [
        ("time constants", f"{found.order}"),
        ("decades of time", number(float(decades))),
        ("relative error, rms", quantity(100 * found.row.rms, "%")),
    ]


def title(case: Case) -> str:
    """Of the page."""
    if identify.internal.is_moduli(case.fit.train):
        return f"{case.output} over frequency"
    step = quantity(step_of(case), case.units[0])
    return f"{WORDS[detail_of(case).spectrum.kind]} of {case.output} under {step}"


def detail_of(case: Case) -> DiscreteSpectrum:
    assert isinstance(case.fit.detail, DiscreteSpectrum)
    return case.fit.detail


def step_of(case: Case) -> float:
    """The constant input."""
    return float(case.fit.train.input[-1])


def _records(case: Case) -> Iterator[tuple[str, str, np.ndarray, np.ndarray]]:
    """Of the training and the held-out rows a word, a colour, times and outputs."""
    both = ((case.fit.train, "training", f.BLUE), (case.fit.test, "held-out", f.GREEN))
    for record, word, colour in both:
        if record is not None:
            rows = record.mask & np.isfinite(record.output)
            assert record.time is not None
            yield word, colour, record.time[rows], record.output[rows]


def _master_curve(case: Case) -> Section:
    """The master curve with its pieces; with temperatures the shifts, their law and what is left over."""
    shifts = detail_of(case).shifts
    moduli = identify.internal.is_moduli(case.fit.train)
    section = Section("Moduli" if moduli else "Master curve")
    caption = "Measured rows, and lines of the spectrum."
    if shifts is not None:
        caption += " Every temperature is shifted along the axis by its factor."
    section.draw(master_of(case.fit), f"{case.output}: measured rows and the spectrum", caption)
    if shifts is not None:
        _shifts(section, shifts)
    return section


def _shifts(section: Section, shifts: Shifts) -> None:
    names = ("C1", "C2 in K") if shifts.law == "WLF" else ("activation energy in kJ/mol",)
    told = ", ".join(f"{n} {number(x)}" for n, x in zip(names, shifts.constants, strict=True))
    caption = (
        f"Shift factors with standard errors. {shifts.law}: {told}, from {number(shifts.reference)} °C."
        f" The factors lie {number(shifts.law_error)} decades rms from it."
    )
    section.draw(shift_factors(shifts), "Shift factors over temperature", caption)
    columns = shifts.temperature, shifts.log_a, shifts.error, shifts.left, shifts.alone
    rows = [
        (number(T), number(a), number(e), quantity(100 * left, "%"), quantity(100 * alone, "%"))
        for T, a, e, left, alone in zip(*columns, strict=True)
    ]
    said = "Shift factors, and what the spectrum of all temperatures leaves beside one of each."
    heads = ("Temperature, °C", "log10 a", "Standard error", "Left over",
             "By a spectrum of its own")  # fmt: skip
    section.tables.append(Table(said, heads, rows))


def _master_residuals(case: Case) -> Section:
    """Residuals in per cent of the reading over the reduced clock."""
    colours = {"storage": f.BLUE, "loss": f.VERMILLION}
    curves: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for piece, residual in pieces_of(case.fit):
        curves.setdefault(piece.part, []).append((np.log10(piece.x), 100 * residual))
    drawn = []
    for part, parts in curves.items():
        x, y = (np.concatenate(one) for one in zip(*parts, strict=True))
        drawn.append(f.Curve(part, x, y, colours.get(part, f.BLUE), "dots"))
    x_label, y_label = f"log10 of {clock_of(case.fit)}", "residual / size of the modulus (%)"
    figure = f.chart(drawn, x_label, y_label, zero=True)
    section = Section("Residuals")
    caption = "Pieces that lie beside each other are not described by one spectrum."
    section.draw(figure, "Relative residuals", caption)
    return section
