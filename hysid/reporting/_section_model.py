"""Report sections on the model: its channels, its posterior, its density, its compensator."""

from collections import Counter

import numpy as np

from compensate import Status
from compensate.export._header_facts import learnt_on
from hysteresis import InputError, Preisach, Scaled
from hysteresis._escape import shell_word
from hysteresis.preisach import GridDensity
from hysteresis.trees import plain
from identify.internal import excited_cells

from .._compensator import RunIn, error_of, with_compensator
from ..figures import _base as f
from ..figures._format import label, number, plain_name, pretty, quantity
from ._case import Case, Section, Table

MEANINGS = {
    Status.OK: "inside the model's range",
    Status.EXTRAPOLATED: "beyond the trained inputs",
    Status.SATURATED: "beyond the outputs of the model, held at its limit",
    Status.FLAT: "where the model is flat, nearest input kept",
    Status.BELOW_THRESHOLD: "below the contact threshold",
    Status.INVALID: "not a number",
    Status.RUN_IN: "before the memory of the model is known",
}


def channels(case: Case) -> Section:
    """The channel map, which combines several channels into one input."""
    combined, unit = case.fit.channels, case.units[1]
    assert combined is not None
    nodes, values = np.asarray(combined.nodes), np.asarray(combined.values)
    names = [plain_name(*of) for of in zip(combined.names, combined.units, strict=True)]
    axes = [label(*of) for of in zip(names, combined.units, strict=True)]
    what = (
        f"the {case.output} would be without memory"
        if combined.memory is None
        else "the channels tell with a memory, stops and slow states, of their own"
    )
    section = Section("Channels", [
        f"The input is a sum of curves, one for each of {len(names)} channels, in the unit of the"
        f" {case.output}: what {what}. Beyond its ends a curve keeps its end value. Falling curves next to"
        f" rising ones cancel effects that the channels measure and the {case.output} does not contain."
    ])  # fmt: skip
    figure = f.panels(axes, nodes, values, label("part of the input", unit))
    also = "" if combined.memory is None else " but its memory"
    caption = f"Contribution of each channel over its fitted range; a flat curve contributes nothing{also}."
    section.draw(figure, f"Curves of {len(names)} channels", caption)
    share = np.ptp(values, axis=1)
    rows = [
        (names[c], quantity(float(nodes[c, 0]), combined.units[c]),
         quantity(float(nodes[c, -1]), combined.units[c]), quantity(float(share[c]), unit),
         number(float(np.corrcoef(nodes[c], values[c])[0, 1])) if share[c] > 0 else "none")
        for c in np.argsort(-share)
    ]  # fmt: skip
    columns = ("Channel", "From", "To", "Range of its curve", "Sense")
    said = "Sense is the correlation of curve and channel: 1 rises throughout, −1 falls."
    section.tables.append(Table(said, columns, [tuple(row) for row in rows]))
    return section


def posterior(case: Case) -> Section:
    section, posterior, fit = Section("Posterior"), case.posterior, case.fit
    if posterior is None:
        section.text.append(
            "The posterior was not sampled; the standard errors are the only measure of uncertainty."
            f" To sample it, run: hysid sample {shell_word(str(case.folder))}"
        )
        return section
    ensembles, draws, _ = posterior.draws.shape
    believed = "The chains have converged." if posterior.converged else (
        "Not converged: R-hat is above 1.01 or there are fewer than 100 effective draws. Use more steps."
    )  # fmt: skip
    section.text.append(
        f"{ensembles * draws:,} draws by {posterior.method}, in {posterior.seconds:.3g} s. {believed}"
    )
    if fit.detail.is_linear:
        section.text.append(
            "emcee samples the noise, its correlation and the prior's strength alone; the weights are drawn"
            " given those, each draw by non-negative least squares."
        )
    if said := "; ".join(
        f"{s.name} has {' and is '.join(s.words)}" for s in posterior.summaries if s.words
    ):
        section.text.append(f"{said}.")
    columns = ("Parameter", "Mean", "Deviation", "5 %", "95 %", "R-hat", "Effective draws")
    rows = [
        (s.name, *map(number, (s.mean, s.sd, s.q05, s.q95)), f"{s.rhat:.3f}", f"{s.ess:,.0f}")
        for s in posterior.summaries
    ]
    section.tables.append(Table("R-hat should be below 1.01.", columns, rows))
    fitted = {p.name: p.value for p in fit.parameters} | {"sigma": fit.noise.sigma}
    units = {p.name: pretty(p.unit) for p in fit.parameters} | {"sigma": case.units[1]}
    if len(posterior.names) <= 6:
        labels = [label(n, units.get(n, "1")) for n in posterior.names]
        flat = posterior.draws.reshape(-1, len(posterior.names))
        values = [np.nan if (v := fitted.get(n)) is None else v for n in posterior.names]
        figure = f.corner(labels, flat, values)
        caption = (
            "Draws of each parameter and each pair; the lines mark the fit. A narrow slanted"
            " cloud means that two parameters are correlated."
        )
        alt = f"Corner plot of {', '.join(posterior.names)}"
        section.draw(figure, alt, caption)
    else:
        section.notes.append(f"{len(posterior.names)} parameters are too many for a corner plot.")
    return section


def density(case: Case) -> Section:
    model, fit, factor = case.fit.model, case.fit, 1.0
    if isinstance(model, Scaled):
        model, factor = model.inner, float(model.factor)
    assert isinstance(model, Preisach)
    assert isinstance(model.density, GridDensity)
    density, (input_unit, output_unit) = model.density, case.units
    n = density.cells
    edges = density.edges
    width = np.diff(edges)
    lower = np.tri(n, dtype=bool)
    weights = np.asarray(density.weights)
    area = np.outer(width, width) * np.where(np.eye(n, dtype=bool), 0.5, 1.0)
    excited = excited_cells(model, fit.train, fit.used)
    down, up = "switch-down threshold β", "switch-up threshold α"
    labels = label(down, input_unit), label(up, input_unit)
    said = f"{int(excited.sum())} of {int(lower.sum())} cells switched among the fitted rows."
    if (lower & ~excited).any():
        said += " The data do not determine the hatched cells; the smoothness prior does."
    said += (
        " Switching alone does not determine a cell: full loops determine only the sums along rows and"
        " columns, and smaller loops inside them determine the rest."
    )
    if factor < 0:
        said += f" The {case.output} falls where a relay switches up."
    section = Section("Density", [said])
    unit = pretty(f"{output_unit} / {input_unit}²") if input_unit != "1" else output_unit
    figure = f.triangle(edges, edges, np.where(lower, weights / area, np.nan), lower & ~excited,
                        *labels, label("relays per area", unit))  # fmt: skip
    densest = quantity(float((weights / area)[lower].max()), unit)
    caption = (
        "Density of the relays. Weight near the diagonal makes narrow loops, weight far from it wide ones."
        f" The densest cell has {densest}; if the scale ends in an arrow, this is beyond the scale."
    )
    section.draw(figure, "Density over the triangle of thresholds", caption)

    if model.reversible is not None:
        curve = factor * (float(model.offset) + np.append(0.0, np.cumsum(model.reversible)))
        drawn, y_label = f.Curve("", edges, curve, f.BLUE), label("memoryless part", output_unit)
        figure = f.chart([drawn], case.input_label, y_label)
        caption = "Memoryless part of the model; the relays add the loop to it."
        section.draw(figure, "Memoryless part against the input", caption)
    return section


def compensator(case: Case) -> Section:
    section, trip, unit = Section("Compensator"), case.round_trip, case.units[0]
    if isinstance(trip, InputError):
        said = f"This model has no compensator. {trip.problem} {trip.cause} {trip.fix}"
        section.text.append(said)
        return section
    word, whole = case.judged
    record = trip.record
    span = float(np.ptp(whole.input[whole.mask])) or 1.0
    some = "the" if len(record) == len(whole) else f"{int(trip.counted.sum()):,}"
    section.text.append(
        f"From the measured {case.output} of {some} {word} rows it estimates the {case.input} with an error"
        f" of {quantity(trip.rms, unit)} rms, {quantity(trip.largest, unit)} at most"
        f" ({number(100 * trip.rms / span)} % of its range)."
    )
    section.text.append(
        "From the model's own output it reproduces that output, without its limits, to"
        f" {number(trip.exactness)} of its range"
        + (": exact." if trip.exactness < 1e-9 else ", which is not exact.")
    )
    counts = Counter(int(s) for s in trip.status[trip.counted])
    said = [f"{k:,} {MEANINGS[Status(s)]}" for s, k in counts.most_common()]
    section.text.append(f"Status of the {int(trip.counted.sum()):,} rows: {'; '.join(said)}.")
    _beside(case, section)
    if len(record) < len(whole):
        last = trip.first + len(record) - 1
        section.notes.append(
            f"This section uses rows {trip.first:,} to {last:,} of {len(whole):,}."
            + (" The compensator starts there without what came before." if trip.first else "")
        )
    u, starts = record.input, record.starts
    colour = f.GREEN if word == "held-out" else f.BLUE
    path = f.trace(u, trip.estimate, trip.counted, starts)
    estimated = label(f"{case.input}, estimated", unit)
    measured = label(f"{case.input}, measured", unit)
    figure = f.chart([f.Curve(word, *path, colour)], measured, estimated, diagonal=True)
    caption = (
        "Estimated against measured input. The dashed line is an exact estimate; a loop around it"
        " is uncompensated hysteresis."
    )
    section.draw(figure, "Estimated against measured input", caption)
    clock = record.time is not None and len(record.labels) == 1
    x = record.time if clock and record.time is not None else np.arange(len(u), dtype=float)
    path = f.trace(x, trip.estimate - u, trip.counted, starts)
    x_label = case.time_label if clock else "row"
    y_label = label("estimated − measured", unit)
    figure = f.chart([f.Curve(word, *path, colour)], x_label, y_label, zero=True)
    alt = "Error of the estimated input in the order of the rows"
    section.draw(figure, alt, f"{alt}.")
    return section


def _beside(case: Case, section: Section) -> None:
    """The errors of simple inverses, what the band holds, and for which motions it was learnt."""
    fit, unit = with_compensator(case.fit), case.units[0]
    found = fit.compensator
    assert found is not None
    if found["refused"] is not None:
        return
    figures = {"rmse": unit, "nrmse_percent": "%", "max_abs": unit}
    rows = [
        (one.get("name", "compensator"), *(quantity(one[k], u) for k, u in figures.items()))
        for one in (found, *found["baselines"])
    ]
    caption = "Simple inverses on the same rows, fitted to the training rows."
    columns = ("Inverse", "Error, rms", "Of the range", "At most")
    section.tables.append(Table(caption, columns, rows, strong=0))
    if found["better"]:
        better, verb = " and ".join(found["better"]), "are" if found["better"][1:] else "is"
        section.notes.append(f"Backwards, {better} {verb} better than the model.")
    if "band" not in found:
        return
    band = error_of(fit)
    known = learnt_on(plain(band.law())["parameters"])
    said = f"Its deviation was learnt {known}. Where the last two turns or the speed are others, it grows."
    if np.isfinite(band.coverage):
        said += f" 1.645 deviations hold {number(100 * band.coverage)} % of the held-out rows."
    if band.coverage_before < band.coverage:
        said += f" It was widened, because before it held {number(100 * band.coverage_before)} %."
    section.text.append(said)
    if "ok_share" in found:  # no long record is sent through
        run_in = RunIn.of(found)
        section.text.append(f"{run_in.sentence(fit.train.time_unit)} That is on the training rows.")
