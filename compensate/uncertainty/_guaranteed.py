"""Bands that hold whole runs with a stated probability: conformal prediction, a run at a time."""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, Record

from .._contract import AbstractCompensator, Estimate, Status
from .._readings import estimate
from ..inverses._law import UncertainEstimate, looks_of

EXACT = 1e-9
"""Of a rank: 0.9 / (1 - 0.9) is 9, but for rounding."""


def runs_needed(guarantee: float) -> int:
    """The least number of runs that can guarantee a probability p: n with n / (n + 1) >= p.

    Raises `InputError` `bad-option` for a probability that is not between 0 and 1.
    """
    if not 0 < guarantee < 1:
        raise InputError(
            "bad-option",
            f"guarantee={guarantee:g} is no probability.",
            fix="between 0 and 1, as 0.9.",
        )
    return max(math.ceil(guarantee / (1 - guarantee) - EXACT), 1)


class Guaranteed(NamedTuple):
    """A band around estimates that holds a whole new run, with a probability that is guaranteed.

        low, high = value -+ factor shape,     P(every input of a new run is in its band) >= guarantee

    The shape is the deviation of the `compensator` where it has one, else 1. The probability is over the
    runs of the calibration and the new one, which must be exchangeable: the same sensor, used in the same
    way, in no order that matters. Nothing is assumed of the model, the noise, or how samples of one run
    hang together.

    - `factor`: half the width in shapes. `runs`: how many it saw.
    """

    compensator: AbstractCompensator
    factor: float
    guarantee: float
    runs: int

    def around(
        self, found: Estimate | UncertainEstimate
    ) -> tuple[Float[np.ndarray, "*samples"], Float[np.ndarray, "*samples"]]:
        """The ends of the band, of what the compensator has found."""
        value, half = np.asarray(found.value), self.factor * shape_of(found)
        return value - half, value + half

    @property
    def statement(self) -> str:
        """What is guaranteed, in a sentence."""
        chance = 100 * self.guarantee
        most = 100 * rank(self.runs, self.guarantee) / (self.runs + 1)
        said = f"{chance:g}" if most - chance < EXACT else f"{chance:g} to {most:.3g}"
        return (
            f"A new run lies within its band over its whole length with a probability of {said} %, if it is"
            f" exchangeable with the {self.runs} runs of the calibration."
        )


def guaranteed(
    compensator: AbstractCompensator, record: Record, guarantee: float = 0.9, runs: str = "auto"
) -> Guaranteed:
    """A band around estimates of a compensator that holds a whole new run with a guaranteed probability.

    The score of a run is the largest |estimate - input| / shape of its rows, and the band's factor the k-th
    smallest score of n runs,

        k = ceil((n + 1) guarantee),

    so that a new run, if it is exchangeable with them, stays in its band with a probability of k / (n + 1).

    **Arguments:**

    - `record`: runs that neither the model nor `compensator` was fitted to. The rows of its mask count.
    - `guarantee`: the probability.
    - `runs`: "sequence", "cycle" (each complete cycle is a run), or "auto": cycles where there is one
      sequence.

    Raises `InputError` `too-few-runs` where fewer runs than `runs_needed` cannot guarantee it, `bad-option`
    and `no-rows`.

    Source: Vovk, Gammerman and Shafer 2005; Lei and others 2018 (split conformal prediction); the largest
    score of a run makes its band simultaneous.

    **Example:**

        >>> band = compensate.guaranteed(compensate.invert(fit.model), record, 0.75)
        >>> band.runs, band.statement[:35]
        (5, 'A new run lies within its band over')
        >>> low, high = band.around(compensate.estimate(band.compensator, record))
        >>> low.shape
        (101,)
    """
    needed = runs_needed(guarantee)
    scores = run_scores(compensator, record, runs)
    n = len(scores)
    if n < needed:
        raise InputError(
            "too-few-runs",
            f"{n} runs cannot guarantee {100 * guarantee:g} %; they can guarantee"
            f" {100 * n / (n + 1):.3g} % at most.",
            place=record.source,
            fix=f"give {needed} runs or more, or ask for less.",
        )
    factor = np.sort(scores)[rank(n, guarantee) - 1]
    return Guaranteed(compensator, float(factor), float(guarantee), n)


def rank(runs: int, guarantee: float) -> int:
    """Which of the sorted scores is the band's factor, from 1 on."""
    return math.ceil((runs + 1) * guarantee - EXACT)


def run_scores(
    compensator: AbstractCompensator, record: Record, runs: str = "auto"
) -> Float[np.ndarray, " runs"]:
    """The largest |estimate - input| over the shape of every run that has a counted row."""
    if runs not in ("auto", "sequence", "cycle"):
        raise InputError(
            "bad-option", f"runs={runs!r} is unknown.", fix='give "auto", "sequence" or "cycle".'
        )
    found = estimate(compensator, record)
    value, status = np.asarray(found.value), np.asarray(found.status)
    shape = shape_of(found)
    counted = record.mask & (status != Status.INVALID) & np.isfinite(value)
    by_cycle = runs == "cycle" or (runs == "auto" and len(record.labels) == 1)
    number = np.searchsorted(record.starts, np.arange(len(record)), "right")
    if by_cycle:
        counted &= record.cycle > 0
        number = number * (int(record.cycle.max(initial=0)) + 1) + record.cycle
    if not counted.any():
        raise InputError("no-rows", "No run has a row that counts.", place=record.source)
    tiny = np.finfo(float).tiny
    score = np.abs(value - record.input)[counted] / np.maximum(shape[counted], tiny)
    _, run = np.unique(number[counted], return_inverse=True)
    largest = np.zeros(int(run.max()) + 1)
    np.maximum.at(largest, run, score)
    return largest


def shape_of(found: Estimate | UncertainEstimate) -> Float[np.ndarray, "*samples"]:
    """The deviation of estimates, 1 where they have none."""
    return np.asarray(getattr(found, "deviation", np.ones_like(found.value)))


# How wide the flat places are: all inputs that a reading of a flat model can have come from.


class FlatInterval(NamedTuple):
    """Inputs from `low` to `high` give the output that the estimate gives; `width` is their distance."""

    low: Float[Array, " samples"]
    high: Float[Array, " samples"]

    @property
    def width(self) -> Array:
        return self.high - self.low


def flat_intervals(
    model: AbstractModel,
    t: ArrayLike | None,
    estimate: ArrayLike,
    low: float,
    high: float,
    where: ArrayLike | None = None,
    tolerance: float = 1e-12,
) -> FlatInterval:
    """For each estimate u_k the inputs v within [`low`, `high`] with

        |h(v) - h(u_k)| <= tolerance (h(high) - h(low)),

    h being the model's next output after the estimates before it. The model rises with v, or falls with it
    everywhere, so that they are an interval: what a status FLAT leaves open, to be taken as
    the uncertainty of the nearest input, which is held.

    **Arguments:**

    - `t`, `estimate`: (samples,), as given to and found by `simulate`; `t` may be None without rates. Of a
      model that depends on a condition, estimate and condition, (samples, 2).
    - `where`: (samples,) bool, which estimates to look at, such as `status == Status.FLAT`; all by default.
      The interval of the others is the estimate itself.

    **Example:**

        >>> wide = compensate.flat_intervals(model, t, u, low=-10.0, high=10.0).width
        >>> bool((wide < 1e-6).all())
        True
    """
    driven = np.asarray(estimate, float)
    u = driven if driven.ndim == 1 else driven[:, 0]
    looked = np.ones(len(u), bool) if where is None else np.asarray(where, bool)
    look = looks_of(model, t, driven)

    def outputs(levels: np.ndarray) -> np.ndarray:
        return look(np.where(looked[:, None], levels, np.nan))

    below, above = (np.tile([end, end], (len(u), 1)) for end in (low, high))
    least, greatest, y = outputs(np.stack([below[:, 0], above[:, 0], u], 1)).T
    # Of a model that falls, what is mirrored rises.
    way = np.where(greatest < least, -1.0, 1.0)
    margin = tolerance * np.abs(greatest - least)
    wanted = np.stack([way * y - margin, way * y + margin], 1)
    for _ in range(np.finfo(float).nmant + 2):
        middle = below + (above - below) / 2
        short = way[:, None] * outputs(middle) < wanted
        below, above = np.where(short, middle, below), np.where(short, above, middle)
    first, last = np.minimum(above[:, 0], u), np.maximum(np.maximum(above[:, 0], below[:, 1]), u)
    return FlatInterval(*(jnp.asarray(np.where(looked, end, u)) for end in (first, last)))
