"""A compensator that recalibrates itself from inputs that are known at times."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, register
from hysteresis._type_variables import PyTree

from .._contract import AbstractCompensator, Estimate, Status
from ..inverses._bisection import ROUNDING, BracketedState, bracketed
from . import _recursion
from ._recursion import Recursion, Settings


class AdaptiveState(NamedTuple):
    """The states of the parts that follow estimates, and of those that are `taught` by references; that of
    the compensator as fitted; the last estimate; what has been learnt."""

    parts: tuple[PyTree, ...]
    taught: tuple[PyTree, ...]
    fitted: PyTree
    value: Float[Array, ""]
    learnt: Recursion


class Recalibrated(NamedTuple):
    """Estimates, and at each sample the advice, the accuracy lost and what has been learnt.

    - `value`, `status`: as of `Estimate`, made before a reference was looked at.
    - `advice`: an `Advice`; `lost`: rms error beyond that of the fit, in the input's unit; `changes`: found
      so far; `zero` (in the output's unit), `gain` and `loop`: learnt so far, the latter two over the
      fit's.
    """

    value: Float[Array, "*samples"]
    status: Int[Array, "*samples"]
    advice: Int[Array, "*samples"]
    lost: Float[Array, "*samples"]
    changes: Int[Array, "*samples"]
    zero: Float[Array, "*samples"]
    gain: Float[Array, "*samples"]
    loop: Float[Array, "*samples"]


@register
class AdaptiveCompensator(AbstractCompensator[AdaptiveState, Recalibrated]):
    """A compensator that recalibrates itself, from occasional inputs that are known.

    The model is a sum of parts, each of which rises with the input,

        sign y = zero + drift t + sum_k w_k part_k[u],     w_k >= least_k > 0,

    and the estimate is the input behind the reading: of `fitted`, the compensator of the fit, until
    references have proved something else, then by bisection of that sum. A sample with a `reference`, the
    true input, is one row of a recursive least-squares fit of zero, drift and weights: what is older is
    forgotten only along that row (Kulhavy), so that nothing is forgotten which the references do not say
    anew. A weight that would fall below its least one is held there, so that the inverse exists after every
    update. Each part has two memories. One follows the estimates, and the estimates come from it. The other
    one follows the references, and between them the estimates; what is learnt comes from it. They do not
    depend on the weights, so no update is felt as a jump of the input.

    Page's test watches the errors of the predicted readings: a sum of log-likelihood ratios of errors twice
    as large. If those were normal, and independent after `correlation` samples, it would alarm by chance
    once in exp(`threshold`) independent references, or less often. An alarm opens the covariance, and the
    next references are learnt fast.

    What is learnt is used only as far as it has proved better: what was known before a run of references
    predicts that run. With e the errors of the fit there and d what was learnt less the fit, the share

        2 (sum(d e) / sum(d^2) - 3 sqrt(noise / sum(d^2))),    between 0 and 1,

    of the way from the fit to what was learnt is gone: all of it where what was learnt is surely nearer to
    the readings, none where the share is below 0. So a sensor that has not changed is not made worse by
    what a few references happen to say, and a change is used from the second run of references on.

    `adaptive` makes one from a model and a record.

    **Example:**

        >>> own = compensate.adaptive(fit.model, record)
        >>> known = np.where(record.cycle == 1, record.input, np.nan)
        >>> found = own.simulate(record.time, record.output, references=known)
        >>> compensate.Advice(int(found.advice[-1])).name
        'NONE'
    """

    fitted: AbstractCompensator
    parts: tuple[AbstractModel, ...]
    centres: Float[Array, " parts"]
    sign: float = eqx.field(static=True)
    low: float = eqx.field(static=True)
    high: float = eqx.field(static=True)
    floored: bool = eqx.field(static=True)
    settings: Settings

    def init(self) -> AdaptiveState:
        states = tuple(part.init() for part in self.parts)
        return AdaptiveState(
            states, states, self.fitted.init(), jnp.asarray(self.low, float), self.settings.begin()
        )

    @eqx.filter_jit
    def step(
        self,
        state: AdaptiveState,
        t: ArrayLike | None,
        y: ArrayLike,
        reference: ArrayLike = jnp.nan,
        dt: ArrayLike = 0.0,
    ) -> tuple[AdaptiveState, Recalibrated]:
        """One reading, with the true input where it is known and the time since the last one where the
        zero drifts."""
        y, reference = jnp.asarray(y, float), jnp.asarray(reference, float)
        s = state.learnt
        s = s._replace(elapsed=s.elapsed + jnp.asarray(dt, float), idle=s.idle + 1)

        def outputs(own: tuple[PyTree, ...], u: Array) -> tuple[tuple[PyTree, ...], Array]:
            both = [part.step(one, t, u) for part, one in zip(self.parts, own, strict=True)]
            return tuple(one for one, _ in both), jnp.stack([out for _, out in both]) - self.centres

        def run(own: tuple[PyTree, ...], u: Array) -> tuple[tuple[PyTree, ...], Array]:
            after, each = outputs(own, u)
            total = s.used[2:] @ each
            return after, s.zero + (jnp.maximum(total, 0.0) if self.floored else total)

        def searched() -> tuple[Array, Array]:
            # A reading beyond those the parts can have is taken for the nearest of them: on a floor the
            # last estimate is then held, and not the end of the range.
            reading = self.sign * y
            ends = [run(state.parts, jnp.asarray(end, float))[1] for end in (self.low, self.high)]
            size = jnp.maximum(jnp.abs(ends[0]), jnp.abs(ends[1]))
            margin = ROUNDING * jnp.finfo(y.dtype).eps * size
            beyond = (reading + margin < ends[0]) | (reading - margin > ends[1])
            before = BracketedState(state.parts, state.value)
            near = jnp.clip(reading, *ends)
            _, found = bracketed(run, before, near, self.low, self.high, size)
            return found.value, jnp.where(beyond, Status.SATURATED, found.status)

        fitted, found = self.fitted.step(state.fitted, t, y)
        # The search takes nine tenths of a step, and an unchanged sensor needs none.
        found = Estimate(*jax.lax.cond(s.share > 0, searched, lambda: tuple(found[:2])))
        valid = jnp.isfinite(y)
        known = valid & jnp.isfinite(reference)
        driving = jnp.where(known, reference, found.value)
        taught, each = outputs(state.taught, driving)

        def learnt() -> Recursion:
            at, shown = each, outputs(state.parts, driving)[1]
            if self.floored:  # there the reading says nothing of the parts
                at = jnp.where(s.used[2:] @ at > 0, at, 0.0)
                shown = jnp.where(s.used[2:] @ shown > 0, shown, 0.0)
            off = found.value - reference
            return _recursion.learnt(self.settings, s, self.sign * y, at, shown, off)

        def chosen(yes: PyTree, no: PyTree, where: Array) -> PyTree:
            return jax.tree.map(lambda a, b: jnp.where(where, a, b), yes, no)

        s = jax.lax.cond(known, learnt, lambda: s)
        # A reading that is not a number is no sample; the time still passes.
        s = s._replace(idle=jnp.where(valid, s.idle, state.learnt.idle))
        moved = outputs(state.parts, found.value)[0]
        after = AdaptiveState(
            chosen(moved, state.parts, valid), chosen(taught, state.taught, valid), fitted,
            jnp.where(valid, found.value, state.value), s,
        )  # fmt: skip
        return after, self._said(found, s)

    def simulate(
        self,
        t: ArrayLike | None,
        y: ArrayLike,
        state: AdaptiveState | None = None,
        references: ArrayLike | None = None,
    ) -> Recalibrated:
        """`step` over all samples; `references`: (samples,) true inputs, NaN where they are not known."""
        return self.follow(t, y, references, state)[1]

    def follow(
        self,
        t: ArrayLike | None,
        y: ArrayLike,
        references: ArrayLike | None = None,
        state: AdaptiveState | None = None,
    ) -> tuple[AdaptiveState, Recalibrated]:
        """As `simulate`, with the state after it, from which another log goes on.

        **Example:**

            >>> own = compensate.adaptive(fit.model, record)
            >>> state, _ = own.follow(record.time, record.output, record.input)
            >>> state.learnt.theta.shape
            (3,)
        """
        y = jnp.asarray(y, float)
        u = jnp.full_like(y, jnp.nan) if references is None else jnp.asarray(references, float)
        if u.shape != y.shape:
            raise InputError(
                "length-mismatch", f"{len(u)} references for {len(y)} readings.",
                fix="give one for each reading, NaN where it is not known.",
            )  # fmt: skip
        clock = np.zeros(len(y)) if t is None else np.asarray(t, float)
        dt = np.diff(clock, prepend=clock[:1])
        return _scan(self, jnp.asarray(clock), y, u, jnp.asarray(dt), state or self.init())

    def _said(self, found: Estimate, s: Recursion) -> Recalibrated:
        p = self.settings
        return Recalibrated(
            *found, _recursion.advice(p, s), _recursion.lost(p, s), s.changes,
            self.sign * (s.learnt_zero - p.zero), _recursion.gain(p, s), _recursion.loop(p, s),
        )  # fmt: skip


@eqx.filter_jit
def _scan(
    own: AdaptiveCompensator, t: Array, y: Array, u: Array, dt: Array, state: AdaptiveState
) -> tuple[AdaptiveState, Recalibrated]:
    def step(state: AdaptiveState, now: tuple[Array, ...]) -> tuple[AdaptiveState, Recalibrated]:
        return own.step(state, *now)

    return jax.lax.scan(step, state, (t, y, u, dt))
