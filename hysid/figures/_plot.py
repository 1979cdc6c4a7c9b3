"""How a record, a fit, a posterior and a compensator show themselves: a matplotlib Figure, and HTML."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from compensate import AbstractCompensator, Status
from compensate._readings import conditioned_in
from compensate.guards._guarded import GuardedCompensator
from hysteresis import AbstractModel, InputError, Record
from hysteresis._escape import markup
from hysteresis.records._excitation import check_identifiable
from identify import FitResult
from identify.internal import is_survey
from identify.posterior._posterior import Posterior
from identify.results._data_sheet import DataSheet
from identify.results._detail import DiscreteSpectrum

from . import _base as f
from ._data_sheet import draw_sheet
from ._format import axes_of
from ._survey import master_of

COLOURS = {"PASS": f.GREEN, "CAUTION": f.ORANGE, "FAIL": f.VERMILLION}
CORNER = 6
"""Parameters of a corner plot, where none are named."""
SWEEP = 120
"""Readings of a compensator's picture."""


def plot(thing: Any, **options: Any) -> Figure:
    """The figure of a record, a fit, a posterior or a compensator. Raises `no-picture` for others."""
    for kind, draw in _DRAWN.items():
        if isinstance(thing, kind):
            return draw(thing, **options)
    raise InputError(
        "no-picture", f"A {type(thing).__name__} cannot be drawn.",
        fix="Give a Record, a FitResult, a Posterior or a compensator.",
    )  # fmt: skip


def html(thing: Any) -> str:
    """What `plot` and `print` show, as one `div` that needs nothing else, with a verdict in its colour.

    Raises `InputError` `no-picture` as `plot` does.
    """
    image, width, height = f.png(plot(thing))
    text, colour = str(thing), f.EDGE
    if isinstance(thing, Record):
        try:
            minded = [f"Warning: {said}" for said in check_identifiable(thing)]
        except InputError as error:
            minded = [f"Cannot be used: {error}"]
        text = "\n".join([*minded, text])
    elif isinstance(thing, FitResult):
        colour = COLOURS[thing.verdict.level]
    return (
        f'<div class="hysid"><pre style="border-left: 4px solid {colour}; padding-left: 0.6em;'
        ' white-space: pre-wrap">'
        f"{markup(text)}</pre>"
        f'<img alt="Picture of this {type(thing).__name__}" width="{width}" height="{height}"'
        f' src="data:image/png;base64,{image}"/></div>'
    )


def draw_record(record: Record) -> Figure:
    """Output against input; rows that do not count are grey."""
    others = f.Curve("excluded", *path(record, record.output, ~record.mask), f.GREY)
    counted = f.Curve("used", *path(record, record.output, record.mask), f.BLUE)
    if record.mask.all():
        return f.chart([counted._replace(label="")], *axes_of(record))
    return f.chart([others, counted], *axes_of(record))


def draw_fit(fit: FitResult) -> Figure:
    """Measured loops of training and held-out rows, and the model over the rows it is judged on; of moduli
    and of several temperatures the master curve."""
    if isinstance(fit.detail, DiscreteSpectrum) and is_survey(fit.train):
        return master_of(fit)
    curves = []
    for record, colour, words in ((fit.train, f.BLUE, "training"), (fit.test, f.GREEN, "held out")):
        if record is not None:
            line = path(record, record.output, record.mask)
            curves.append(f.Curve(f"measured, {words}", *line, colour, "under"))
    seen = fit.train if fit.test is None else fit.test
    line = path(seen, fit.predict(seen), seen.mask)
    return f.chart([*curves, f.Curve(fit.name, *line, f.VERMILLION)], *axes_of(seen))


def draw_posterior(posterior: Posterior, names: Sequence[str] | None = None) -> Figure:
    """Histograms of parameters and scatters of their pairs, see `Posterior.plot`."""
    chosen = posterior.names[:CORNER] if names is None else tuple(names)
    for name in chosen:
        if name not in posterior.names:
            known = ", ".join(posterior.names)
            raise InputError("unknown-parameter", f"No parameter {name!r}; have {known}.")
    at = [posterior.names.index(name) for name in chosen]
    draws = posterior.draws.reshape(-1, len(posterior.names))[:, at]
    return f.corner(chosen, draws, [np.nan] * len(at))


def draw_compensator(compensator: AbstractCompensator) -> Figure:
    """Estimates while the reading goes up, down and half way up again; grey where the status is not OK."""
    y, value, status = _swept(compensator)
    ok = status == Status.OK
    curves = [
        f.Curve("held or extrapolated", y, np.where(ok, np.nan, value), f.GREY),
        f.Curve("", y, np.where(ok, value, np.nan), f.BLUE),
    ]
    return f.chart(curves[int(ok.all()) :], "reading", "estimate of the input")


def _swept(compensator: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Readings that go up, down and half way up again, their estimates and statuses."""
    part, guard, conditioned = compensator, None, conditioned_in(compensator)

    def beside(x: np.ndarray) -> np.ndarray:
        """Beside the middle of the conditions, where the model depends on one."""
        if conditioned is None:
            return x
        return np.column_stack([x, np.full(len(x), np.mean(conditioned.knots))])

    while hasattr(part, "inner"):
        part, guard = part.inner, part if isinstance(part, GuardedCompensator) else guard
    model, part = getattr(part, "model", None), getattr(part, "members", part)
    ends = (np.asarray(getattr(part, end, np.nan), float) for end in ("floor", "ceiling"))
    low, high = (float(np.mean(x)) for x in ends)
    if guard is not None and isinstance(model, AbstractModel):
        # The readings of the trained inputs, up and down again.
        u = np.interp(np.linspace(0, 2, SWEEP), [0, 1, 2], [guard.low, guard.high, guard.low])
        y = np.asarray(model.simulate(np.linspace(0, 2, SWEEP), beside(u)))
        low, high = float(y.min()), float(y.max())
    if not (np.isfinite([low, high]).all() and low < high):
        low, high = 0.0, 1.0
    t = np.linspace(0, 3, SWEEP)
    y = np.interp(t, [0, 1, 2, 3], [low, high, low, (low + high) / 2])
    found = compensator.simulate(t, beside(y))
    return y, np.asarray(found.value, float), np.asarray(found.status)


def path(record: Record, y: np.ndarray, keep: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A series over the record's input, of the rows to keep, with gaps."""
    return f.trace(record.input, np.asarray(y, float), keep, record.starts)


_DRAWN: dict[type, Any] = {
    DataSheet: draw_sheet,
    Record: draw_record,
    FitResult: draw_fit,
    Posterior: draw_posterior,
    AbstractCompensator: draw_compensator,
}
