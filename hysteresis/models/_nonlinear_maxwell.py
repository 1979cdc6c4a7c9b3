"""Maxwell branches with non-linear springs: rate dependence that changes with the level."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import Tree
from .._parameter import NOT_NEGATIVE, POSITIVE, Scalar, array_module, check_range, parameter
from .._registry import register
from ..trees import AbstractSearchedModel, node


@register
class NonlinearMaxwell(AbstractSearchedModel):
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
        unit="time", **POSITIVE, meaning="relaxation times"
    )
    increments: Float[Array, "branches cells"] | np.ndarray | None = parameter(
        None, unit="output", **NOT_NEGATIVE, meaning="increments of the springs"
    )
    strengths: Float[Array, "*senses branches nodes"] | np.ndarray | None = parameter(
        None, unit="output", **NOT_NEGATIVE, meaning="how much of a branch is felt"
    )
    offset: Scalar = parameter(0.0, unit="output", meaning="constant of the output")
    leading: bool = eqx.field(default=True, static=True, kw_only=True)
    rest: float | None = eqx.field(default=None, static=True, kw_only=True)

    def __check_init__(self) -> None:
        check_range("the springs reach", self.low, self.high)
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

    @property
    def cells(self) -> int:
        """n, the number of cells of the grid."""
        if self.increments is not None:
            return self.increments.shape[-1]
        assert self.strengths is not None
        return self.strengths.shape[-1] - 1

    needs_time = True

    def forwards(self) -> Tree:
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
                "u": self.low if self.rest is None else self.rest, "spring": none, "linear": none,
                "dt": -1.0, "decay": none, "gain": none, "begun": 0, "held": none, "rise": none,
                "rest": 0.0,
            },
        )  # fmt: skip
