"""Which held-out rows lie beyond the inputs, rates and hold times of the fitted ones."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import AbstractModel, Note, Record
from hysteresis._note import warning
from hysteresis.models._viscoelastic import AbstractViscoelastic
from hysteresis.records._cycles import loop_sums, noise_level
from hysteresis.records._excitation import WIDER

from .._levels import HELD, LITTLE, SEAM
from ..results._fit_result import FitResult
from ..results._trained_condition import Extrapolation, RowsBeyond
from ._whiteness import speed

# How wide the loops of a record are, and how much of that the residuals of a fit keep.


class LoopsLeft(NamedTuple):
    """Mean distance between rising and falling branches of the fitted rows, in the output's unit.

    - `width`: of the measured loops. `left`: of the residuals over the same input. NaN without a loop.
    - `noise`: standard deviation of the reading from row to row; two branches with nothing but noise are
      1.1 times that apart. `span`: range of the output.
    """

    width: float
    left: float
    noise: float
    span: float

    @property
    def are_there(self) -> bool:
        """Whether there are loops that the noise cannot make."""
        return self.width > max(WIDER * self.noise, LITTLE * self.span)

    @property
    def share(self) -> float:
        """Part of the width that the fit does not describe."""
        return self.left / self.width


def loops_left(fit: FitResult) -> LoopsLeft:
    """Loops in the measured output and in the residuals, over the rows that were fitted."""
    record, used, y = fit.train, fit.used, fit.train.output
    noise = [noise_level(y[x][used[x]]) for _, x in record.sequences() if used[x].any()]
    return LoopsLeft(
        loop_sums(record, y, used).width,
        loop_sums(record, fit.residuals, used).width,
        float(np.median(noise)) if noise else 0.0,
        float(np.ptp(y[used])) if used.any() else 0.0,
    )


# Time constants that a record cannot show: longer than it lasts, shorter than its sampling steps.


def unseen_time_constants(model: AbstractModel, record: Record) -> list[Note]:
    """A note for every branch whose time constant lies outside the times that the record shows.

    The shortest is the step of the clock that follows a change of the input, the median over all changes: a
    hold whose rows come ever more seldom shows what is over in its first second.

    An element that creeps flows like a dashpot for much less than its time constant, and gives way
    like a spring after much more; one that relaxes the other way round. Of the two parameters of such
    a branch the record knows one.
    """
    if not isinstance(model, AbstractViscoelastic) or record.time is None:
        return []
    sequences = [(record.time[rows], record.input[rows]) for _, rows in record.sequences()]
    span = max(float(np.ptp(t)) for t, _ in sequences)
    # Before its first row a model is at rest.
    changes = np.concatenate([np.abs(np.diff(u, prepend=0.0))[:-1] for _, u in sequences])
    steps = np.concatenate([np.diff(t) for t, _ in sequences])
    order = np.argsort(steps)
    passed = np.cumsum(changes[order])
    step = float(steps[order][np.searchsorted(passed, passed[-1] / 2)])
    found, unit = [], record.time_unit
    with np.errstate(divide="ignore"):
        constants = 1 / np.asarray(model.chain().rates)
    for number, constant in enumerate(constants, start=1):
        if step <= constant <= span:
            continue
        slow = constant > span
        than = f"longer than the record ({span:.3g} {unit})"
        mend = "measure longer holds"
        if not slow:
            than = f"shorter than the sampling steps ({step:.3g} {unit})"
            mend = "sample faster"
        seen = "dashpot" if slow == model.creeps else "spring"
        said = f"Branch {number} has a time constant of {constant:.3g} {unit}, {than}: it is"
        said += f" identifiable only as a {seen}; {mend}, or fit a model without it."
        found.append(warning("unseen-time-constant", said))
    return found


def extrapolation(fit: FitResult, predicted: Float[np.ndarray, " samples"]) -> Extrapolation | None:
    """Count and score the held-out rows beyond what was fitted; None where nothing was held out.

    `predicted`: the fit's prediction of its test record.
    """
    if (test := fit.test) is None:
        return None
    beyond = rows_beyond(fit, test)
    error = test.weights * (predicted - test.output)

    def scored(rows: np.ndarray) -> RowsBeyond:
        rows = rows & test.mask
        rmse = float(np.sqrt(np.mean(error[rows] ** 2))) if rows.any() else None
        return RowsBeyond(int(rows.sum()), rmse)

    inside = ~np.logical_or.reduce([*beyond.values()])
    return Extrapolation(*(scored(rows) for rows in (*beyond.values(), inside)))


def rows_beyond(fit: FitResult, test: Record) -> dict[str, Bool[np.ndarray, " samples"]]:
    """Of each row of `test`: is its input, a channel or a condition, its rate or the time it is held beyond
    that of the fitted rows?"""
    train, used = fit.train, fit.used
    span = float(np.ptp(train.input[used]))
    found = {"input": fit.beyond(test)}
    if train.time is None or test.time is None:
        nothing = np.zeros(len(test), bool)
        return found | {"rate": nothing, "time": nothing}
    for name, of in (
        ("rate", lambda record: np.abs(speed(record))),
        ("time", lambda record: held_for(record, HELD * span)),
    ):
        found[name] = of(test) > (1 + SEAM) * of(train)[used].max(initial=0.0)
    return found


def held_for(record: Record, band: float) -> Float[np.ndarray, " samples"]:
    """For how long the input of each row has stayed within `band` of where it then came to rest."""
    assert record.time is not None
    found = np.zeros(len(record))
    for _, rows in record.sequences():
        t, since, level = record.time[rows], 0, record.input[rows.start]
        for k, x in enumerate(record.input[rows].tolist()):
            if abs(x - level) > band:
                since, level = k, x
            found[rows.start + k] = t[k] - t[since]
    return found
