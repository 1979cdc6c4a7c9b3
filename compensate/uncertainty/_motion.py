"""Which motions an error was learnt on, and how unlike them the present one is."""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from hysteresis.laws.error import ANY_MOTION

from .._contract import Status

NEAR = 0.15
"""Part of the trained range by which a reversal has to be away from those seen for half of the growth."""

DECADES = 0.7
"""How far the speed has to be beyond those seen for half of it: a factor of five."""

GROWTH = 0.3
"""Error of an estimate after a motion unlike all seen, over that of the best curve without a memory.

`benchmarks._trust.bands` measures 0.15 to 0.5 on rigs that no model here is.
"""

FASTER = 5.0
"""A clock that is so much slower tells what speed does to a model's estimates."""

TIMED = 4.0
"""Half widths of the play behind the estimates that a stroke is long before its speed is known."""

SELDOM = 0.02
"""Part of the rows at either end of what was seen that do not count: a slip is no kind of motion."""

NEVER = 1e30
"""Greater than any speed."""


class Motions(NamedTuple):
    """The inputs, reversals and speeds of rows that an error was learnt on, and how it grows beyond them.

    - `inputs`: the least and the greatest.
    - `turns`: on the way down and up, of the last reversal and the one before it, the least and greatest.
    - `speeds`: the least and the greatest mean speed of a stroke so far, in the input's unit over the
      times'; 0 and 1e30 where no speed is known, or there are no times.
    - `ends`: to which estimates are limited, and over which distances are measured.
    - `growth`: the errors far beyond those inputs and reversals, and far beyond those speeds.
    """

    inputs: Float[Array, "2"]
    turns: Float[Array, "2 2 2"]
    speeds: Float[Array, "2"]
    ends: Float[Array, "2"]
    growth: Float[Array, "2"]


class MotionState(NamedTuple):
    """A play behind the estimates, which forgets what is smaller than they are known, and its reversals.

    - `t`, `seen`: of the last sample, `follower`: the play; NaN before the first one.
    - `up`: whether it rose last; `moved`: whether it moved at all.
    - `last`, `before`, `earlier`: reversals, the newest first; of the last two `known` are known. One that
      is passed again is forgotten, with the one after it. The first sample counts as a reversal.
    - `begin`, `elapsed`, `speed`: where the stroke began, the time since, and its mean speed; before it is
      long enough that of the stroke before.
    """

    t: Float[Array, "*samples"]
    seen: Float[Array, "*samples"]
    follower: Float[Array, "*samples"]
    up: Int[Array, "*samples"]
    moved: Int[Array, "*samples"]
    known: Int[Array, "*samples"]
    last: Float[Array, "*samples"]
    before: Float[Array, "*samples"]
    earlier: Float[Array, "*samples"]
    begin: Float[Array, "*samples"]
    elapsed: Float[Array, "*samples"]
    speed: Float[Array, "*samples"]


def at_rest() -> MotionState:
    """Before the first sample."""
    nan, zero = jnp.asarray(jnp.nan, float), jnp.asarray(0)
    none = jnp.zeros_like(nan)
    return MotionState(nan, nan, nan, zero + 1, zero, zero, none, none, none, none, none, none)


def moved(ends: Any, width: float, s: MotionState, sample: tuple[Array, ...]) -> MotionState:
    """The state after a sample (t, value, status); an INVALID one changes nothing."""
    t, value, status = sample
    seen = jnp.clip(value, *ends)
    first = jnp.isnan(s.follower)
    old = jnp.where(first, seen, s.follower)
    follower = jnp.clip(old, seen - width, seen + width)
    elapsed = s.elapsed + jnp.where(first, 0.0, jnp.maximum(t - s.t, 0.0))
    last, begin = jnp.where(first, seen, s.last), jnp.where(first, seen, s.begin)

    up = jnp.where(follower > old, 1, jnp.where(follower < old, 0, s.up))
    turned = (up != s.up) & (s.moved > 0)
    known = jnp.where(turned, jnp.minimum(s.known + 1, 2), s.known)
    earlier = jnp.where(turned, s.before, s.earlier)
    before = jnp.where(turned, last, s.before)
    last = jnp.where(turned, old + jnp.where(s.up > 0, width, -width), last)
    begin, elapsed = jnp.where(turned, old, begin), jnp.where(turned, 0.0, elapsed)

    passed = (known > 0) & jnp.where(up > 0, seen > before, seen < before)
    last = jnp.where(passed & (known > 1), earlier, last)
    known = jnp.where(passed, 0, known)

    span = jnp.abs(follower - begin)
    timed = (span > TIMED * width) & (elapsed > 0)
    speed = jnp.where(timed, span / jnp.where(timed, elapsed, 1.0), s.speed)
    is_moved = jnp.where(follower != old, 1, s.moved)
    after = MotionState(
        t, seen, follower, up, is_moved, known, last, before, earlier, begin, elapsed, speed
    )
    invalid = status == Status.INVALID
    return MotionState(*(jnp.where(invalid, a, b) for a, b in zip(s, after, strict=True)))


@eqx.filter_jit
def path(
    ends: Any,
    width: float,
    s: MotionState,
    samples: tuple[Array, ...],
    fresh: Bool[Array, " samples"],
) -> MotionState:
    """The state after every sample (t, value, status); where one is `fresh`, nothing was before it."""

    def step(s: MotionState, sample: Any) -> tuple[MotionState, MotionState]:
        *rest, first = sample
        start = MotionState(*(jnp.where(first, a, b) for a, b in zip(at_rest(), s, strict=True)))
        after = moved(ends, width, start, tuple(rest))
        return after, after

    return jax.lax.scan(step, s, (*samples, fresh))[1]


def unlike(motions: Motions, s: MotionState) -> tuple[Array, Array]:
    """How unlike those seen the reversals are, and the speed, each from 0 to 1:

        x / (1 + x),    x = (d0^2 + d1^2 + d2^2) / NEAR^2,    x = (log10(speed / nearest speed) / DECADES)^2

    d0, d1, d2: how far the estimate and the last two reversals are from those seen, over the range.
    """
    turns = jnp.moveaxis(motions.turns[jnp.asarray(s.up)], (-2, -1), (0, 1))
    now = _outside(s.seen, *motions.inputs)
    last = _outside(s.last, *turns[0])
    before = jnp.where(s.known > 0, _outside(s.before, *turns[1]), 0.0)
    reach = jnp.maximum(NEAR * (motions.ends[1] - motions.ends[0]), 1e-30)
    away = (now**2 + last**2 + before**2) / reach**2
    slow, fast = motions.speeds
    v = jnp.where(s.speed > 0, s.speed, fast)
    off = jnp.log10(jnp.where(v < slow, slow / v, jnp.where(v > fast, v / fast, 1.0)))
    rate = jnp.where(s.speed > 0, (off / DECADES) ** 2, 0.0)
    return away / (1.0 + away), rate / (1.0 + rate)


def growth_of(motions: Motions, s: MotionState) -> Float[Array, "*samples"]:
    """The variance that the error has beyond that on the motions seen."""
    away, rate = unlike(motions, s)
    return motions.growth[0] ** 2 * away + motions.growth[1] ** 2 * rate


def error_parameters(motions: Motions | None, width: float) -> dict[str, Any]:
    """What the element of an error holds of the motions that it was learnt on."""
    if motions is None:
        return ANY_MOTION
    (low, high), (least, most), (slow, fast) = (
        np.asarray(x).tolist() for x in (motions.ends, motions.inputs, motions.speeds)
    )
    growth, hurry = np.asarray(motions.growth).tolist()
    return {
        "low": low, "high": high, "least": least, "most": most, "turns": motions.turns, "slow": slow,
        "fast": fast, "near": max(NEAR * (high - low), 1e-30), "factor": DECADES * math.log(10.0),
        "timed": TIMED * width, "growth": growth, "hurry": hurry,
    }  # fmt: skip


def _outside(at: Array, low: Array, high: Array) -> Array:
    return jnp.maximum(jnp.maximum(low - at, at - high), 0.0)


def seen(
    s: MotionState,
    rows: Bool[np.ndarray, " samples"],
    ends: tuple[float, float],
    growth: tuple[float, float],
) -> Motions:
    """The motions of some rows of a path, all but the most seldom."""
    up, known, speed, at = (np.asarray(part)[rows] for part in (s.up, s.known, s.speed, s.seen))
    turns = np.empty((2, 2, 2))
    for way in (0, 1):
        for k, (part, have) in enumerate(
            ((s.last, up == way), (s.before, (up == way) & (known > 0)))
        ):
            found = np.asarray(part)[rows][have]
            # Where no row went this way, none is known to be unlike.
            turns[way, k] = _between(found) if len(found) else ends
    timed = speed[speed > 0]
    speeds = _between(timed) if len(timed) else [0.0, NEVER]
    inputs = at.min(), at.max()
    return Motions(*(jnp.asarray(part, float) for part in (inputs, turns, speeds, ends, growth)))


def _between(found: np.ndarray) -> np.ndarray:
    return np.quantile(found, [SELDOM, 1 - SELDOM])
