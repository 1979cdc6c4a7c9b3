"""Maxwell branches with non-linear springs: rate dependence that changes with the level."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import Series, Tree, before_each, is_start, time_steps
from .._parameter import Scalar, array_module, is_concrete, parameter
from .._registry import register
from ..numerics._recurrence import linear_recurrence
from ..numerics._relaxation import decay_and_gain
from ..trees import AbstractSearchedModel, node


class BranchState(NamedTuple):
    """Time and input of the last sample and every branch's memory, of its spring and of the input.

    `t` is NaN before the first sample.
    """

    t: Array
    u: Array
    spring: Array
    linear: Array


class BranchInput(NamedTuple):
    """Steps dt, the inputs' places on the grid and those before them, starts, and the first state."""

    dt: Array
    cell: Array
    within: Array
    cell_before: Array
    within_before: Array
    start: Array
    state: BranchState


@register
class NonlinearMaxwell(AbstractSearchedModel[BranchState, BranchInput]):
    """Branches of a spring and a dashpot in series, in parallel with each other:

        y = offset + sum_k Q_k[g_k(u)] + c_k(u) Q_k[v],      Q_k' = -Q_k / tau_k + (its argument)',

    with v = (u - low) / (high - low). Q_k relaxes: it follows a jump at once and forgets it in the time
    tau_k. The spring g_k rises. A strength c_k >= 0 is the weight of a branch at a level of the input. If
    all springs are straight lines, this is the generalised Maxwell model. Springs and strengths are
    piecewise linear between n + 1 even nodes of [low, high]. Beyond, springs continue straight and
    strengths keep their last value. Before the first sample the input has rested at `rest`, so a first
    sample elsewhere is a jump.

    **Arguments:**

    - `low`, `high`: the range of the input.
    - `times`: (branches,) tau_k, positive.
    - `increments`: (branches, n) of the springs, none negative; or None.
    - `strengths`: (branches, n + 1) c_k at the nodes, or (2, branches, n + 1) for Q_k > 0 and for
      Q_k < 0; or None.
    - `offset`: the output's constant.

    **Other arguments:**

    - `leading`: as above: the output leads (displacement -> force). If false, the output lags, and

          y = offset + sum_k g_k(u) - Q_k[g_k(u)] - c_k(u) Q_k[v]:

      each g_k is approached in the time tau_k (creep, force -> displacement).
    - `rest`: where the input is before the first sample, and every branch is relaxed; None for `low`.

    Steps are exact where g_k(u) is linear in time between samples. With `increments` alone, y rises with
    u.

    Raises `InputError` for times that are not positive, increments or strengths that do not fit or
    are negative, and an empty range.

    Source: the strain-dependent relaxation function of Fung's quasi-linear viscoelasticity, one
    function for each time constant; Findley, Lai, Onaran, Creep and Relaxation of Nonlinear
    Viscoelastic Materials (1976), modified superposition.

    **Example:**

        >>> times, springs = np.array([1.0]), np.array([[1.0, 3.0]])
        >>> relax = hysteresis.NonlinearMaxwell(0.0, 2.0, times, increments=springs)
        >>> y = relax.simulate(np.arange(4.0), np.array([1.0, 1.0, 2.0, 2.0]))
        >>> np.asarray(y).round(2).tolist()
        [1.0, 0.37, 2.03, 0.75]
    """

    low: float = eqx.field(static=True, converter=float)
    high: float = eqx.field(static=True, converter=float)
    times: Float[Array, " branches"] | np.ndarray = parameter(
        unit="time", bounds=(0.0, float("inf")), meaning="relaxation times"
    )
    increments: Float[Array, "branches cells"] | np.ndarray | None = parameter(
        None, unit="output", bounds=(0.0, float("inf")), meaning="increments of the springs"
    )
    strengths: Float[Array, "*senses branches nodes"] | np.ndarray | None = parameter(
        None, unit="output", bounds=(0.0, float("inf")), meaning="how much of a branch is felt"
    )
    offset: Scalar = parameter(0.0, unit="output", meaning="constant of the output")
    leading: bool = eqx.field(default=True, static=True, kw_only=True)
    rest: float | None = eqx.field(default=None, static=True, kw_only=True)

    def __check_init__(self) -> None:
        if not self.low < self.high:
            raise InputError(
                "zero-range", f"the springs reach from {self.low:g} to {self.high:g}.",
                fix="give low < high, enclosing the inputs the model will see.",
            )  # fmt: skip
        if is_concrete(self.times) and not (np.asarray(self.times) > 0).all():
            raise InputError("parameter-out-of-bounds", "a relaxation time is not positive.")
        given = enumerate((self.increments, self.strengths))
        shapes = {k: a.shape for k, a in given if a is not None}
        fits = (self.times.shape, (2, *self.times.shape))  # strengths may have two senses
        cells = {shape[-1] - k for k, shape in shapes.items()}
        if len(cells) != 1 or any(s[:-1] not in fits[: k + 1] for k, s in shapes.items()):
            raise InputError(
                "length-mismatch",
                f"{self.times.shape[-1]} times, but springs and strengths of shape"
                f" {tuple(shapes.values())}.",
                fix="give (branches, n) increments, (branches, n + 1) strengths, or one of both.",
            )
        for array in (self.increments, self.strengths):
            if array is not None and is_concrete(array) and not (np.asarray(array) >= 0).all():
                raise InputError(
                    "parameter-out-of-bounds", "springs and strengths are not negative."
                )

    @property
    def cells(self) -> int:
        """n, the number of cells of the grid."""
        if self.increments is not None:
            return self.increments.shape[-1]
        assert self.strengths is not None
        return self.strengths.shape[-1] - 1

    def init(self, t0: Any = None, u0: Any = None) -> BranchState:
        none = jnp.zeros_like(jnp.asarray(self.times))
        t = jnp.asarray(jnp.nan if t0 is None else t0, none.dtype)
        return BranchState(t, jnp.full_like(t, self._rest), none, none)

    def step(self, state: BranchState, t: Any, u: Any) -> tuple[BranchState, Float[Array, ""]]:
        t, u = jnp.asarray(t, state.t.dtype), jnp.asarray(u, state.u.dtype)
        dt = jnp.where(jnp.isnan(state.t), 0.0, t - state.t)
        decay, gain = self._step(dt[None])
        now, before = (
            self._springs(*self._place(u[None])),
            self._springs(*self._place(state.u[None])),
        )
        spring, linear = (
            decay[0] * q + gain[0] * (new - old)[0]
            for q, new, old in zip((state.spring, state.linear), now, before, strict=True)
        )
        y = self._output(self._place(u[None]), now[0], spring[None], linear[None])[0]
        return BranchState(t, u, spring, linear), y

    def prepare(
        self,
        t: Series | None,
        u: Series,
        state: BranchState | None = None,
        *,
        starts: tuple[int, ...] = (0,),
    ) -> BranchInput:
        if t is None:
            raise InputError(
                "no-time",
                "NonlinearMaxwell depends on the rate, and this record has no time.",
                fix="name the time column (--time COL) or the sampling step (--dt SECONDS).",
            )
        u = jnp.asarray(u)
        state = self.init() if state is None else state
        dt = time_steps(jnp.asarray(t, u.dtype), state.t, starts)
        before = before_each(u, state.u.astype(u.dtype), starts)
        start = is_start(u.shape[0], starts)
        return BranchInput(dt, *self._place(u), *self._place(before), start, state)

    def evaluate(self, prepared: BranchInput) -> Float[Array, " samples"]:
        dt, cell, within, cell_before, within_before, start, state = prepared
        decay, gain = self._step(dt)
        now, before = self._springs(cell, within), self._springs(cell_before, within_before)
        start = start[:, None]

        def relaxing(new: Array, old: Array, begin: Array) -> Array:
            drive = gain * (new - old) + start * decay * begin[None]
            rows = linear_recurrence(tuple((decay * (1 - start)).T), tuple(drive.T))
            return jnp.stack(rows, -1)

        spring, linear = (
            relaxing(new, old, begin)
            for new, old, begin in zip(now, before, (state.spring, state.linear), strict=True)
        )
        return self._output((cell, within), now[0], spring, linear)

    def law(self) -> Tree:
        n, cells = len(self.times), self.cells
        increments: Any = np.zeros((n, cells)) if self.increments is None else self.increments
        xp = array_module(increments)
        springs: Any = xp.pad(xp.cumsum(xp.asarray(increments), 1), ((0, 0), (1, 0)))
        strengths = np.zeros((n, cells + 1)) if self.strengths is None else self.strengths
        module = np if self.strengths is None else jnp
        above, below = module.broadcast_to(strengths, (2, n, cells + 1))
        none = np.zeros(n)
        return node(
            "maxwell",
            {
                "branches": n, "cells": cells, "low": self.low,
                "scale": cells / (self.high - self.low), "rates": 1 / self.times,
                "springs": springs if self.increments is None else jnp.asarray(springs),
                "increments": increments, "above": above, "below": below, "offset": self.offset,
                "leading": self.leading, "sprung": self.increments is not None,
            },
            {
                "u": self._rest, "spring": none, "linear": none, "dt": -1.0, "decay": none,
                "gain": none, "begun": 0, "held": none, "rise": none, "rest": 0.0,
            },
        )  # fmt: skip

    @property
    def _rest(self) -> float:
        return self.low if self.rest is None else self.rest

    def _step(self, dt: Array) -> tuple[Array, Array]:
        """exp(-x) and (1 - exp(-x)) / x of x = dt / tau, (samples, branches)."""
        return decay_and_gain(dt[:, None] / jnp.asarray(self.times)[None])

    def _place(self, u: Array) -> tuple[Array, Array]:
        """Cell and fraction of it, below 0 or above 1 beyond the range."""
        position = (u - self.low) * (self.cells / (self.high - self.low))
        cell = jnp.clip(jnp.floor(position), 0, self.cells - 1)
        return cell.astype(jnp.int32), position - cell

    def _springs(self, cell: Array, within: Array) -> tuple[Array, Array]:
        """g_k(u) and, the same for every branch, v: (samples, branches)."""
        v = (cell.astype(within.dtype) + within) / self.cells
        linear = jnp.broadcast_to(v[:, None], (*v.shape, *self.times.shape))
        if self.increments is None:
            return jnp.zeros_like(linear), linear
        step = jnp.asarray(self.increments).T
        return (jnp.cumsum(step, 0) - step)[cell] + within[:, None] * step[cell], linear

    def _output(self, place: tuple[Array, Array], g: Array, spring: Array, linear: Array) -> Array:
        felt = jnp.zeros_like(linear)
        if self.strengths is not None:
            nodes, (cell, within) = jnp.moveaxis(jnp.asarray(self.strengths), -1, 0), place
            part = jnp.clip(within, 0.0, 1.0).reshape(-1, *(1,) * (nodes.ndim - 1))
            felt = nodes[cell] * (1 - part) + nodes[cell + 1] * part
            if felt.ndim == 3:
                felt = jnp.where(linear > 0, felt[:, 0], felt[:, 1])
            felt = felt * linear
        if self.leading:
            return self.offset + (spring + felt).sum(-1)
        return self.offset + (g - spring - felt).sum(-1)
