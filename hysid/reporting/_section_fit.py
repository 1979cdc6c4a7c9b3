"""Report sections on the fit: loops, residuals, parameters, candidates, data."""

import math
from typing import Any

import numpy as np
import scipy

from identify.internal import members_and_questions
from identify.results._detail import GridWeights

from ..figures import _base as f
from ..figures._format import label, number, pretty, quantity
from ._case import Case, Section, Table


def loops(case: Case) -> Section:
    fit, section = case.fit, Section("Loops")
    records = [r for r in (fit.train, fit.test) if r is not None]
    masks = [r.mask for r in records]
    shown = [*(r.output for r in records), *case.predicted.values()]
    limits = (
        np.concatenate([r.input[mask] for r, mask in zip(records, masks, strict=True)]),
        np.concatenate([y[mask] for y, mask in zip(shown, 2 * masks, strict=True)]),
    )
    dropped = fit.train.mask & ~fit.used
    for part, predicted in case.predicted.items():
        record = fit.train if part == "train" else fit.test
        assert record is not None
        keep = record.mask & ~dropped if part == "train" else record.mask
        colour, word = (f.BLUE, "training") if part == "train" else (f.GREEN, "held-out")
        curves = []
        if part == "train" and dropped.any():
            left = f.trace(record.input, record.output, dropped, record.starts)
            curves.append(f.Curve("first cycle, excluded", *left, f.DIM))
        measured = f.trace(record.input, record.output, keep, record.starts)
        model = f.trace(record.input, predicted, keep, record.starts)
        curves += [
            f.Curve(f"measured, {word}", *measured, colour, "under"),
            f.Curve(f"{fit.name} model", *model, f.VERMILLION),
        ]
        figure = f.chart(curves, case.input_label, case.output_label, limits=limits)
        errors = fit.metrics[part]
        assert errors is not None
        caption = f"{word.capitalize()} rows, rms error {quantity(errors.rmse, case.units[1])}."
        caption += " The thin line should lie inside the broad one."
        if part == "train" and dropped.any():
            caption += " The fit excludes the first cycle (grey), which conditions the sample."
        alt = f"{case.output} against {case.input}: measured loop of the {word} rows and the model"
        section.draw(figure, alt, caption)
    if fit.test is None:
        section.notes.append("Nothing was held out, so there is only one panel.")
    return section


def loop_figures(case: Case) -> Section:
    """The figures of the fitted loops, of the readings and of the model."""
    table = case.fit.loops()
    heads, *rows = table.cells()
    caption = (
        f"{int(table.full.sum())} full loops of {len(table)}: means of the readings, with the errors that"
        " noise and sampling leave, beside those of the model. hysid loops tells every loop."
    )
    shown = Table(caption, heads, [(*row[:-2], pretty(row[-2]), row[-1]) for row in rows])
    return Section("Figures of the loops", tables=[shown])


def residuals(case: Case) -> Section:
    fit, unit = case.fit, case.units[1]
    train, rows = fit.train, case.rows
    y_label = label("predicted − measured", unit)
    errors = fit.metrics["train"]
    assert errors is not None
    section = Section("Residuals", [
        f"Residuals are predicted minus measured {case.output}."
        f" Over the fitted rows they are {quantity(errors.rmse, unit)} rms."
    ])  # fmt: skip
    colours = {"training": f.BLUE, "held-out": f.GREEN, "excluded": f.GREY}

    x = train.time if case.one_clock else np.arange(len(rows.input), dtype=float)
    assert x is not None
    curves = [
        f.Curve(word, *f.trace(x, rows.residual, rows.word == word, rows.starts), colour)
        for word, colour in colours.items()
        if (rows.word == word).any()
    ]
    x_label = case.time_label if case.one_clock else "row"
    counted = np.isin(rows.word, ["training", "held-out"])
    most = np.abs(rows.residual[counted]).max()
    left = float(np.abs(rows.residual[~counted & (rows.word != "")]).max(initial=0.0))
    shown = rows.residual[counted if left > 3 * most else rows.word != ""]
    figure = f.chart(curves, x_label, y_label, zero=True,
                     limits=(x[rows.word != ""], shown), breaks=x[rows.starts[1:]])  # fmt: skip
    caption = "Residuals should look like noise. A slope means drift, a wave a missing effect."
    if left > 3 * most:
        caption += f" The excluded cycle reaches {quantity(left, unit)}, outside the picture."
    section.draw(figure, "Residuals in the order of the rows", caption)

    curves, means = [], []
    for sign, word, colour in ((1, "loading", f.ORANGE), (-1, "unloading", f.SKY)):
        at = np.flatnonzero((rows.branch == sign) & counted)
        if not len(at):
            continue
        shown = at[f.thin(f.MOST // 2, rows.residual[at])]
        curves.append(f.Curve("", rows.input[shown], rows.residual[shown], colour, "dots"))
        curves.append(
            f.Curve(f"{word}, mean", *_binned(rows.input[at], rows.residual[at]), colour, "bold")
        )
        means.append(f"{quantity(float(rows.residual[at].mean()), unit)} while {word}")
    figure = f.chart(curves, case.input_label, y_label, zero=True)
    caption = (
        f"Residuals of all these rows by branch: on average {' and '.join(means)}. Lines that are apart"
        " mean that the loop's width is wrong; lines that bend together mean that its curve is wrong."
    )
    section.draw(figure, "Residuals against input by branch", caption)

    return section


LISTED = 40
"""Parameters in the table: a dense spectrum has hundreds, and its figure tells them better."""


def parameters(case: Case) -> Section:
    fit = case.fit
    rows, listed = [], list(fit.determined)
    hidden = len(fit.parameters) - len(listed)
    further, listed = max(len(listed) - LISTED, 0), listed[:LISTED]
    repeats = any(p.repeatability is not None for p in fit.parameters)
    for p in listed:
        known = p.value is not None and math.isfinite(p.value)
        error = "unknown" if p.status == "free" else p.status
        if p.stderr is not None and math.isfinite(p.stderr):
            error = f"± {number(p.stderr)}"
        elif p.status == "inseparable":
            ends = ("none" if end is None else number(end) for end in (p.low, p.high))
            error = "open, {} to {}".format(*ends)
        value = number(p.value, p.stderr) if known else "none"
        cells = [p.name, value, pretty(p.unit) or "1", error, p.status]
        if repeats:
            cells.insert(3, "" if p.repeatability is None else f"± {number(p.repeatability)}")
        rows.append(tuple(cells))
    # The noise, which the posterior has too.
    noise = ["sigma", number(fit.noise.sigma), pretty(case.units[1]) or "1", "not fitted", "noise"]
    rows.append((*noise[:3], *[""] * repeats, *noise[3:]))
    columns = ["Parameter", "Value", "Unit", "Standard error", "Status"]
    if repeats:
        columns.insert(3, "From cycle to cycle")
    section = Section("Parameters", tables=[Table("", tuple(columns), rows)])
    if hidden:
        why = "the data do not determine them one by one. fit.json has them all."
        section.notes.append(f"{hidden} further sums are left out: {why}")
    if further:
        section.notes.append(f"{further} more are in fit.json.")
    if repeats:
        left = np.abs(fit.residuals[fit.used & np.isfinite(fit.residuals)])
        sizes = np.sqrt(np.mean(left**2)), np.quantile(left, 0.9)
        rms, most = (quantity(float(x), case.units[1]) for x in sizes)
        section.text.append(
            "Two errors answer two questions. How well the best values are known is seen from what differs"
            " between cycles: that is the error of a comparison with the same specimen, later. The standard"
            " error takes what the model misses for noise. It misses the fitted rows by"
            f" {rms} rms, and nine of ten by less than {most}."
        )
    if isinstance(fit.detail, GridWeights):
        meaning = fit.detail.linear.meaning
        section.text.append(
            f"The grid has {len(meaning.block)} weights in {meaning.block.max() + 1} blocks of even"
            f" density, and {meaning.cells} increments of the memoryless curve. The table lists their"
            " sums; the map below shows the weights. Relays whose thresholds are nearly equal act as the"
            " memoryless curve does, so offset, reversible rise and mass are not separable: the data leave"
            " them open between the ends of a range, and determine the sums above them."
        )
    section.notes += [*fit.notes]
    return section


COLUMNS = ("Model", "Score", "Training error", "Held-out error", "Held-out rms")


def candidates(case: Case) -> Section:
    fit, unit = case.fit, case.units[1]
    rows = [
        (c.name, quantity(c.score, "%"), *_errors(c, unit), c.verdict.level, quantity(c.seconds, "s"))
        for c in fit.candidates
    ]  # fmt: skip
    rows += _baseline_rows(case)
    columns = (*COLUMNS, "Verdict", "Time")
    said = "Errors in per cent of the measured range."
    if (fit.train.mask & ~fit.used).any():
        said += " The training error leaves out the first cycle, as the fit does."
    section = Section("Candidates", [
        "Models are ranked by their score, the cross-validation error within the training rows."
        " The held-out rows play no part in the choice. Baselines are scored on the same rows."
    ], tables=[Table(said, columns, rows, strong=0)])  # fmt: skip
    tests = {c.name: t.nrmse_percent for c in fit.candidates if (t := c.metrics["test"])}
    best = min(tests, key=tests.__getitem__, default=fit.name)
    if tests and tests[best] < 0.95 * tests.get(fit.name, 0.0):
        section.notes.append(
            f"{best} predicts the held-out rows better ({number(tests[best])} % instead of"
            f" {number(tests[fit.name])} %). With more data the choice may change."
        )
    section.notes += [f"{name} was skipped: {why}" for name, why in fit.skipped.items()]
    asked = members_and_questions(fit)
    said = "What the model was asked on rows that it was not fitted to; of an average its members, too."
    if any(one.key == "amplitude" and one.error is None for one in asked):
        said += (
            " Half of virtual rigs at one amplitude had 4 to 18 times that error at smaller ones."
        )
    rows = [
        (one.what, one.share, "not known" if one.error is None else quantity(one.error, unit))
        for one in asked
    ]
    section.tables.append(Table(said, ("Question or member", "Asked by", "Error, rms"), rows))
    return section


def baselines(case: Case) -> Section:
    """Of a hold, whose orders have a table of their own: the fit and its baselines on the same rows."""
    own = (case.fit.name, "", *_errors(case.fit, case.units[1]))
    rows = [own, *(row[:5] for row in _baseline_rows(case))]
    return Section("Baselines", [
        "Baselines predict without a spectrum, on the same rows. Their score is the error on held-out parts"
        " of the training rows."
    ], tables=[Table("Errors in per cent of the measured range.", COLUMNS, rows, strong=0)])  # fmt: skip


def _baseline_rows(case: Case) -> list[tuple[str, ...]]:
    """Cells of the candidates' table."""
    unit = case.units[1]
    return [
        (one.name, quantity(one.score, "%"), *_errors(one, unit), "baseline", "")
        for one in case.fit.baselines
    ]


def _errors(of: Any, unit: str) -> tuple[str, str, str]:
    """Of the training rows and of the held-out ones, in per cent of their ranges, and the rms error."""
    train, test = of.metrics["train"], of.metrics["test"]
    percent, rms = "none", "none"
    if test is not None:
        percent, rms = quantity(test.nrmse_percent, "%"), quantity(test.rmse, unit)
    return quantity(train.nrmse_percent, "%"), percent, rms


def data(case: Case) -> Section:
    data, document, train = case.document["data"], case.document, case.fit.train
    rows = [
        ("File", data["source"] or "arrays"),
        ("SHA-256", data["sha256"]),
        ("Rows", f"{data['rows']:,} in {data['sequences']} sequence{'s'[: data['sequences'] > 1]}"),
        ("Training rows", f"{data['rows_train']:,}"),
        ("Held-out rows", f"{data['rows_test']:,}"),
        ("Input", f"{data['input']['name']}, unit {data['input']['unit']}"),
        ("Output", f"{data['output']['name']}, unit {data['output']['unit']}"),
        ("Time", "none" if train.time is None else f"{train.time_name}, unit {data['time_unit']}"),
        *((f"Step {k}", said) for k, said in enumerate(train.history or ("nothing",), 1)),
        ("Seed", str(document["seed"])),
        ("Fitted in", quantity(document["seconds"], "s")),
        ("Versions", ", ".join(f"{k} {v}" for k, v in document["versions"].items())),
    ]
    return Section("Data", tables=[Table("", ("Item", "Value"), rows)])


def _binned(x: np.ndarray, y: np.ndarray, bins: int = 24) -> tuple[np.ndarray, np.ndarray]:
    """Means of x and y in those bins of x that have rows."""
    u, mean = scipy.stats.binned_statistic(x, [x, y], bins=bins).statistic
    return u[np.isfinite(u)], mean[np.isfinite(u)]
