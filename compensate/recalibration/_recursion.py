"""Recursive least squares with directional forgetting, weights that stay positive, and Page's test."""

from enum import IntEnum
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

TWICE = 0.375
"""(1 - 1 / c^2) / 2 for a deviation that has become c = 2 times what it was."""

MOST = 25.0
"""Squared errors over their variance count as this at most: one reference that is wrong is no change."""


LARGE = 4.0
"""Mean square residual, over that of the fit, from which on the model no longer explains the readings."""

SURE = 3.0
"""Standard errors by which what was learnt has to be better than the fit."""


class Advice(IntEnum):
    """Why a calibration is needed now."""

    NONE = 0
    ZERO = 1
    """Something changed and is being learnt: most of it is the zero."""
    GAIN = 2
    """Most of it is the rise of the output."""
    LOOP = 3
    """Most of it is the width of the loop."""
    SHAPE = 4
    """Errors are large, and neither zero, gain nor width explains them: measure and fit again."""
    STALE = 5
    """The zero may have drifted too far since the last reference: give one."""


class Recursion(NamedTuple):
    """What has been learnt.

    - `share`: how much of what was learnt is used; while it is 0, estimates are those of the fit. `used`:
      zero, drift (per time) and weights behind the others; `theta`: the same as learnt;
      `covariance`: of them, at the last reference.
    - `elapsed`, `idle`: time and samples since the last reference.
    - `before`: `theta` before this run of references, of which `run` independent ones have come; `common`,
      `apart`: what it would have explained of the fit's errors at references, and the square of its
      distance from the fit.
    - `evidence`: of a change since; `excess`, `possible`: the errors that make it, squared, and what a
      change of all unknowns by `spread` would make. `settled`: independent references after the last one;
      `changes`: so many.
    - `loss`: mean square error of the estimates at this run of references; `residual`: that of the readings
      as they are explained now, over the variance of innovations.
    """

    share: Float[Array, ""]
    used: Float[Array, " unknowns"]
    theta: Float[Array, " unknowns"]
    covariance: Float[Array, "unknowns unknowns"]
    elapsed: Float[Array, ""]
    idle: Float[Array, ""]
    before: Float[Array, " unknowns"]
    run: Float[Array, ""]
    common: Float[Array, ""]
    apart: Float[Array, ""]
    evidence: Float[Array, ""]
    excess: Float[Array, ""]
    possible: Float[Array, ""]
    settled: Float[Array, ""]
    loss: Float[Array, ""]
    residual: Float[Array, ""]
    changes: Int[Array, ""]

    @property
    def zero(self) -> Float[Array, ""]:
        """The zero that is used by now."""
        return self.used[0] + self.used[1] * self.elapsed

    @property
    def learnt_zero(self) -> Float[Array, ""]:
        """The zero by now, as learnt."""
        return self.theta[0] + self.theta[1] * self.elapsed


class Settings(eqx.Module):
    """What a recursion starts from and is judged by; see `compensate.runtime._adaptation.adaptive`."""

    zero: Float[Array, ""]
    nominal: Float[Array, " parts"]
    least: Float[Array, " parts"]
    rises: Float[Array, " parts"]
    widths: Float[Array, " parts"]
    start: Float[Array, " unknowns"]
    spread: Float[Array, " unknowns"]
    noise: Float[Array, ""]
    correlation: Float[Array, ""]
    memory: Float[Array, ""]
    settling: Float[Array, ""]
    threshold: Float[Array, ""]
    error: Float[Array, ""]

    def begin(self) -> Recursion:
        """As fitted."""
        none = jnp.zeros_like(self.zero)
        theta = jnp.concatenate([jnp.stack([self.zero, none]), self.nominal])
        return Recursion(
            share=none, used=theta, theta=theta, covariance=jnp.diag(self.start), elapsed=none, idle=none,
            before=theta, run=none, common=none, apart=none, evidence=none, excess=none, possible=none,
            settled=none, loss=self.error**2, residual=jnp.ones_like(none),
            changes=jnp.zeros((), int),  # a weak type would compile twice
        )  # fmt: skip


def learnt(
    p: Settings, s: Recursion, y: Array, output: Array, shown: Array, off: Array
) -> Recursion:
    """After one reference: `output` of the parts whose memories follow references, `shown` of those whose
    memories follow estimates, the reading y, and how far the estimate was off."""
    weight = jnp.minimum(s.idle / p.correlation, 1.0)
    move = jnp.eye(len(s.theta)).at[0, 1].set(s.elapsed)
    theta, covariance = move @ s.theta, move @ s.covariance @ move.T
    # What was learnt before a run of references is tried on it.
    new_run = (s.idle > p.correlation) | (s.run >= p.settling + 1)
    before = jnp.where(new_run, theta, move @ s.before)
    run = jnp.where(new_run, 0.0, s.run) + weight
    h = jnp.concatenate([jnp.array([1.0, 0.0]), output])
    missed = y - h @ theta
    loss = s.loss + weight / run * (off**2 - s.loss)

    square = jnp.minimum(missed**2 / (p.noise + h @ covariance @ h), MOST)
    evidence = jnp.maximum(s.evidence + weight * (TWICE * square - jnp.log(2.0)), 0.0)
    excess = jnp.where(evidence > 0, s.excess + weight * missed**2, 0.0)
    possible = jnp.where(evidence > 0, s.possible + weight * (p.spread @ h**2), 0.0)
    changed = evidence > p.threshold
    size = jnp.minimum(excess / possible, 1.0)
    covariance = covariance + jnp.where(changed, size, 0.0) * jnp.diag(p.spread)
    # Until it has settled, another alarm is of the same change.
    new = changed & ((s.changes == 0) | (s.settled >= p.settling))

    total = p.noise / weight
    along = covariance @ h
    seen = along @ h / total
    kept = 1 - weight / p.memory
    less = (kept * seen - 1 + kept) / (kept * seen * (1 + seen) * total)
    informed = seen > 0
    theta = theta + jnp.where(informed, along * missed / (total * (1 + seen)), 0.0)
    covariance = covariance - jnp.where(informed, less * jnp.outer(along, along), 0.0)
    theta = bounded(p.least, theta, covariance)

    fitted = jnp.concatenate([jnp.stack([p.zero, jnp.zeros_like(p.zero)]), p.nominal])
    g = jnp.concatenate([jnp.array([1.0, 0.0]), shown])
    apart = g @ (before - fitted)
    common = kept * s.common + weight * apart * (y - g @ fitted)
    distance = kept * s.apart + weight * apart**2
    part = share(p.noise, common, distance)
    used = fitted + part * (theta - fitted)
    # A third of a run forgets what was before.
    left = jnp.minimum((y - h @ used) ** 2 / p.noise, MOST)
    residual = s.residual + jnp.minimum(3 * weight / p.settling, 1.0) * (left - s.residual)
    return Recursion(
        share=part, used=used, theta=theta, covariance=covariance,
        elapsed=jnp.zeros_like(s.elapsed), idle=jnp.zeros_like(s.idle),
        before=before, run=run, common=common, apart=distance,
        evidence=jnp.where(changed, 0.0, evidence), excess=jnp.where(changed, 0.0, excess),
        possible=jnp.where(changed, 0.0, possible),
        settled=jnp.where(changed, 0.0, s.settled + weight), loss=loss, residual=residual,
        changes=s.changes + new.astype(int),
    )  # fmt: skip


def share(noise: Array, common: Array, apart: Array) -> Array:
    """How much of what was learnt is used: all where it has proved better than the fit at later references,
    nothing where it has not, and a part between."""
    some = common > 0
    divisor = jnp.where(some, apart, 1.0)
    part = 2 * (common - SURE * jnp.sqrt(noise * divisor)) / divisor
    return jnp.where(some, jnp.clip(part, 0.0, 1.0), 0.0)


def bounded(least: Array, theta: Array, covariance: Array) -> Array:
    """Weights below their least ones are put there, and the others to where they then are likeliest."""
    indices = jnp.arange(len(theta))

    def hold(_: Array, at: tuple[Array, Array]) -> tuple[Array, Array]:
        theta, left = at
        short = jnp.where(jnp.diagonal(left)[2:] > 0, least - theta[2:], 0.0)
        worst = 2 + jnp.argmax(short)
        most, along, own = short[worst - 2], left[worst], left[worst, worst]
        at_worst = indices == worst
        held = at_worst[:, None] | at_worst[None, :]
        after = jnp.where(held, 0.0, left - jnp.outer(along, along) / own)
        any_ = most > 0
        return jnp.where(any_, theta + along / own * most, theta), jnp.where(any_, after, left)

    theta, _ = jax.lax.fori_loop(0, len(least), hold, (theta, covariance))
    return theta.at[2:].max(least)


def gain(p: Settings, s: Recursion) -> Array:
    """The rise of the output as learnt, over that of the fit."""
    return s.theta[2:] @ p.rises / (p.nominal @ p.rises)


def loop(p: Settings, s: Recursion) -> Array:
    """The width of the loop over the rise as learnt, over that of the fit; 1 where the fit has no loop."""
    fitted = p.nominal @ p.widths
    there = fitted > 0
    now = s.theta[2:] @ p.widths / jnp.where(there, fitted, 1.0) / gain(p, s)
    return jnp.where(there, now, 1.0)


def open_zero(s: Recursion) -> Array:
    """The variance of the zero by now."""
    P, t = s.covariance, s.elapsed
    return P[0, 0] + 2 * t * P[0, 1] + t**2 * P[1, 1]


def advice(p: Settings, s: Recursion) -> Array:
    """An `Advice`."""
    moved = jnp.abs(s.learnt_zero - p.zero)
    steeper = jnp.abs(gain(p, s) - 1) * (p.nominal @ p.rises) / 2
    wider = jnp.abs(loop(p, s) - 1) * (p.nominal @ p.widths) / 2
    effects = jnp.stack([moved, steeper, wider])
    which = jnp.where((effects < jnp.sqrt(p.noise)).all(), Advice.SHAPE, 1 + jnp.argmax(effects))
    later = jnp.where(
        s.residual > LARGE,
        Advice.SHAPE,
        jnp.where(open_zero(s) > 3 * p.noise, Advice.STALE, Advice.NONE),
    )
    return jnp.where((s.changes > 0) & (s.settled < p.settling), which, later)


def lost(p: Settings, s: Recursion) -> Array:
    """The rms error that estimates have beyond that of the fit, in the input's unit."""
    before = p.error**2
    more, unknown = s.loss - before, before * open_zero(s) / p.noise
    more = jnp.where(unknown > 3 * before, jnp.maximum(more, unknown), more)
    return jnp.sqrt(jnp.maximum(more, 0.0))
