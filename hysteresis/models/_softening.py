"""First-cycle conditioning: what an input has never reached is stiffer than what it has."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import Series, Tree, is_start, time_steps
from .._parameter import Scalar, array_module, is_concrete, parameter
from .._registry import register
from ..trees import AbstractSearchedModel, node


class SofteningState(NamedTuple):
    """Time of the last sample, NaN before the first, and how far each cell is conditioned, 0 to 1."""

    t: Array
    reached: Array


class SofteningInput(NamedTuple):
    """Steps dt, how much of each cell the input fills (samples, cells), starts, the first state."""

    dt: Array
    filled: Array
    start: Array
    state: SofteningState


@register
class Softening(AbstractSearchedModel[SofteningState, SofteningInput]):
    """Conditioning by the largest input so far (Mullins effect), with recovery at rest:

        y = sum_{i <= j} d_ij r_i(u) S_j,
        S_j(t) = max over s <= t of r_j(u(s)) exp(-(t - s) / recovery)

    r_i(u) is 0 below cell i of an even grid on [low, high], 1 above it and a ramp within. After an input
    has reached cell j, each cell i below it gives way by d_ij more, so the output lags.

    **Arguments:**

    - `low`, `high`: the range of the input.
    - `weights`: (n, n), entries j >= i are used (row i, column j), none negative.
    - `recovery`: the time constant with which conditioning is forgotten; infinite for never.

    **Other arguments:**

    - `leading`: for an output that leads (displacement -> force), cells that the input has never reached
      resist more: y = sum_{i <= j} d_ij [r_i(u) (1 - S_j) + r_j(u)]. The last term makes y rise with u on
      the first loading.

    In both cases y never falls while u rises.

    Raises `InputError` for weights of the wrong shape or sign, a recovery time that is not positive, and
    an empty range.

    Source: the largest deformation so far, as in Ogden and Roxburgh, Proc. R. Soc. A 455 (1999).

    **Example:**

        >>> foam = hysteresis.Softening(0.0, 2.0, np.triu(np.ones((2, 2))))
        >>> foam.simulate(None, np.array([0.0, 1.0, 2.0, 1.0, 2.0])).tolist()
        [0.0, 2.0, 3.0, 1.0, 3.0]
    """

    low: float = eqx.field(static=True, converter=float)
    high: float = eqx.field(static=True, converter=float)
    weights: Float[Array, "cells cells"] | np.ndarray = parameter(
        unit="output", bounds=(0.0, float("inf")), meaning="softening of a cell by another"
    )
    recovery: Scalar = parameter(
        float("inf"), unit="time", bounds=(0.0, float("inf")), fixed=True,
        meaning="time in which conditioning is forgotten",
    )  # fmt: skip
    leading: bool = eqx.field(default=True, static=True, kw_only=True)

    def __check_init__(self) -> None:
        if not self.low < self.high:
            raise InputError("zero-range", f"cells reach from {self.low:g} to {self.high:g}.")
        if self.weights.ndim != 2 or self.weights.shape[0] != self.weights.shape[1]:
            raise InputError("wrong-shape", f"weights of shape {self.weights.shape}.")
        if is_concrete(self.weights) and np.triu(np.asarray(self.weights)).min() < 0:
            raise InputError("parameter-out-of-bounds", "softening is not negative.")
        if is_concrete(self.recovery) and not np.all(np.asarray(self.recovery) > 0):
            raise InputError("parameter-out-of-bounds", "the recovery time is not positive.")

    def init(self, t0: Any = None, u0: Any = None) -> SofteningState:
        none = jnp.zeros_like(jnp.asarray(self.weights[0]))
        return SofteningState(jnp.asarray(jnp.nan if t0 is None else t0, none.dtype), none)

    def step(
        self, state: SofteningState, t: Any, u: Any
    ) -> tuple[SofteningState, Float[Array, ""]]:
        t = jnp.asarray(t, state.t.dtype)
        dt = jnp.where(jnp.isnan(state.t), 0.0, t - state.t)
        filled = self._filled(jnp.asarray(u, state.t.dtype)[None])
        reached = jnp.maximum(state.reached * jnp.exp(-dt / self.recovery), filled[0])
        return SofteningState(t, reached), self._output(filled, reached[None])[0]

    def prepare(
        self,
        t: Series | None,
        u: Series,
        state: SofteningState | None = None,
        *,
        starts: tuple[int, ...] = (0,),
    ) -> SofteningInput:
        u = jnp.asarray(u)
        if t is None:
            if is_concrete(self.recovery) and bool(jnp.isfinite(self.recovery)):
                raise InputError(
                    "no-time",
                    "recovery takes time, and this record has none.",
                    fix="name the time column (--time COL), or recovery=inf.",
                )
            t = jnp.zeros_like(u)
        state = self.init() if state is None else state
        dt = time_steps(jnp.asarray(t, u.dtype), state.t, starts)
        return SofteningInput(dt, self._filled(u), is_start(u.shape[0], starts), state)

    def evaluate(self, prepared: SofteningInput) -> Float[Array, " samples"]:
        return self._output(prepared.filled, self.reached(prepared))

    def reached(self, prepared: SofteningInput) -> Float[Array, "samples cells"]:
        """S_j at every sample: a running maximum that decays."""
        dt, filled, start, state = prepared
        kept = jnp.exp(-dt / self.recovery)[:, None]
        begin = start[:, None] * kept * state.reached[None]
        pairs = kept * (1 - start)[:, None], jnp.maximum(filled, begin)
        pairs = jnp.broadcast_to(pairs[0], filled.shape), pairs[1]

        def then(first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
            # max(b2, a2 max(b1, a1 x)) = max(max(b2, a2 b1), a2 a1 x), since a >= 0
            return first[0] * second[0], jnp.maximum(second[1], second[0] * first[1])

        return jax.lax.associative_scan(then, pairs)[1]

    def law(self) -> Tree:
        xp = array_module(self.weights)
        weights = xp.triu(xp.asarray(self.weights))
        n = len(weights)
        return node(
            "softening",
            {
                "cells": n, "low": self.low, "scale": n / (self.high - self.low),
                "weights": jnp.asarray(weights), "columns": jnp.asarray(weights.sum(0)),
                "forgetting": 1 / self.recovery, "leading": self.leading,
            },
            {"reached": np.zeros(n)},
        )  # fmt: skip

    def _filled(self, u: Array) -> Array:
        n = self.weights.shape[-1]
        position = (u - self.low) * (n / (self.high - self.low))
        return jnp.clip(position[:, None] - jnp.arange(n, dtype=position.dtype)[None], 0.0, 1.0)

    def _output(self, filled: Array, reached: Array) -> Array:
        weights = jnp.triu(jnp.asarray(self.weights))
        if not self.leading:
            return ((filled @ weights) * reached).sum(-1)
        unreached = ((filled @ weights) * (1 - reached)).sum(-1)
        return unreached + filled @ weights.sum(0)
