"""Bands that hold whole runs with a stated probability: conformal prediction, a run at a time."""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from hysteresis import InputError, Record, register

from .._contract import AbstractCompensator, State, Status
from .._estimate import estimate

EXACT = 1e-9
"""Of a rank: 0.9 / (1 - 0.9) is 9, but for rounding."""

GAIN = 0.2
"""How far a missed run moves a followed band, in parts of its half width."""


class BandedEstimate(NamedTuple):
    """An estimate with its band.

    - `deviation`: of the inner compensator, NaN where it has none. `low`, `high`: the ends of the band.
    """

    value: Float[Array, "*samples"]
    status: Int[Array, "*samples"]
    deviation: Float[Array, "*samples"]
    low: Float[Array, "*samples"]
    high: Float[Array, "*samples"]


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


@register
class GuaranteedCompensator(AbstractCompensator[State, BandedEstimate]):
    """A compensator with a band that holds a whole new run, with a probability that is guaranteed.

        low, high = value -+ factor shape,     P(every input of a new run is in its band) >= guarantee

    The shape is the deviation of the inner compensator where it has one, else 1. The probability is over
    the runs of the calibration and the new one, which must be exchangeable: the same sensor, used in the
    same way, in no order that matters. Nothing is assumed of the model, the noise, or how samples of one
    run hang together.

    `guaranteed` makes one from a record; `factor` is its half width in shapes, `gain` a fifth of that for
    `follow`, `runs` how many it saw.
    """

    inner: AbstractCompensator
    factor: Float[Array, ""]
    gain: Float[Array, ""]
    guarantee: float = eqx.field(static=True)
    runs: int = eqx.field(static=True)
    followed: int = eqx.field(static=True, default=0)

    def init(self) -> State:
        return self.inner.init()

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: State
    ) -> tuple[State, BandedEstimate]:
        state, found = self.inner.stream(t, y, state)
        return state, self._banded(found)

    @property
    def statement(self) -> str:
        """What is guaranteed, in a sentence."""
        chance = 100 * self.guarantee
        if self.followed:
            return (
                f"Over {self.followed} runs that were followed, the share of those that leave their band is"
                f" kept near {100 - chance:g} % in the long run, whatever drifts."
            )
        most = 100 * rank(self.runs, self.guarantee) / (self.runs + 1)
        said = f"{chance:g}" if most - chance < EXACT else f"{chance:g} to {most:.3g}"
        return (
            f"A new run lies within its band over its whole length with a probability of {said} %, if it is"
            f" exchangeable with the {self.runs} runs of the calibration."
        )

    def follow(self, record: Record, runs: str = "auto") -> "GuaranteedCompensator":
        """The band after runs whose inputs became known, one after the other, as the sensor drifts.

            factor <- factor + gain (missed - (1 - guarantee)),     missed = 1 if the run left its
            band

        Over T runs the share of those that leave their bands is then within
        (largest score / gain + 1) / T of 1 - guarantee, for any sequence of runs.

        Source: Gibbs and Candes 2021; Angelopoulos, Candes and Tibshirani 2023 (quantile tracking).

        **Example:**

            >>> band = compensate.guaranteed(compensate.invert(fit.model), record, 0.75)
            >>> band.follow(record).followed
            5
        """
        scores = run_scores(self.inner, record, runs)
        factor = tracked(float(self.factor), scores, self.guarantee, float(self.gain))[-1]
        seen = self.followed + len(scores)
        return replace(self, factor=jnp.asarray(factor), followed=seen)

    def _banded(self, found: Any) -> BandedEstimate:
        known = getattr(found, "deviation", None)
        half = self.factor * (jnp.ones_like(found.value) if known is None else known)
        deviation = jnp.full_like(found.value, jnp.nan) if known is None else known
        return BandedEstimate(
            found.value, found.status, deviation, found.value - half, found.value + half
        )


def guaranteed(
    compensator: AbstractCompensator, record: Record, guarantee: float = 0.9, runs: str = "auto"
) -> GuaranteedCompensator:
    """A compensator with a band that holds a whole new run with a guaranteed probability.

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
    return GuaranteedCompensator(
        compensator, jnp.asarray(factor), jnp.asarray(GAIN * factor), float(guarantee), n
    )


def tracked(
    factor: float, scores: Float[np.ndarray, " runs"], guarantee: float, gain: float
) -> Float[np.ndarray, " factors"]:
    """The factor before each run, and after the last one."""
    found = [factor]
    for score in scores:
        missed = float(score > found[-1])
        found.append(max(found[-1] + gain * (missed - (1 - guarantee)), 0.0))
    return np.array(found)


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
    deviation = getattr(found, "deviation", None)
    shape = np.ones_like(value) if deviation is None else np.asarray(deviation)
    counted = record.mask & (status != Status.INVALID) & np.isfinite(value)
    by_cycle = runs == "cycle" or (runs == "auto" and len(record.labels) == 1)
    number = np.empty(len(record), int)
    for k, (_, rows) in enumerate(record.sequences()):
        number[rows] = k
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
