"""A monotone network of the Everett function, from reading to force."""

import itertools
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray
from numpy.typing import ArrayLike

from hysteresis import GeneralizedMaxwell, Preisach, Series
from hysteresis._model import AbstractFollowingModel
from hysteresis._parameter import PyTree
from hysteresis.preisach import GridDensity


class EverettNetwork(AbstractFollowingModel[Any, Any]):
    """Force from a reading by a monotone Everett network: sums over the reading's extremum stack.

        F = R(v) - sum_k +-2 E(M_k, m_k),    v = z + sum_j c_j (z - lag_j z),    E(a, b) = mass of mu there

    The network gives the density mu > 0, a softplus, of a leading Preisach model. So E(a, a) = 0, E
    increases with a and decreases with b, and R is steep enough that F increases with v after any history.
    The terms with c_j > 0 subtract the creep from the reading; they are the inverse of a delay.

    All parts are softplus functions of unconstrained parameters, so each gradient step leads to such a
    model.

    **Arguments:** what a training changes, see `random`: `network`, `total`, `rises` of R's cells,
    `relaxing` c_j; and what it keeps: `high` of the reading, `force` to scale by, `times` of the delays.

    **Source:** Kim and Park (2018), equation (2); Zakerzadeh (2011), a network instead of the Everett map.
    """

    network: Float[Array, " count"]
    total: Float[Array, ""]
    rises: Float[Array, " cells"]
    relaxing: Float[Array, " lags"]
    high: float = eqx.field(static=True, converter=float)
    force: float = eqx.field(static=True, converter=float)
    times: tuple[float, ...] = eqx.field(static=True, converter=tuple)
    hidden: tuple[int, ...] = eqx.field(default=(25, 12), static=True, converter=tuple)

    @classmethod
    def random(
        cls,
        key: PRNGKeyArray,
        *,
        high: float,
        force: float,
        times: Sequence[float] = (0.4, 4.0),
        cells: int = 40,
    ) -> "EverettNetwork":
        """One to start a training from: a line from 0 to `force` at the reading `high`, few loops."""
        hidden = (25, 12)
        layers = _layers(hidden)
        # Each layer preserves the size of its inputs.
        matrices = (
            jax.random.normal(one, (outputs, inputs)) / np.sqrt(inputs)
            for one, (inputs, outputs) in zip(
                jax.random.split(key, len(layers)), layers, strict=True
            )
        )
        parts = [part for W in matrices for part in (W.ravel(), jnp.zeros(W.shape[0]))]
        line = float(np.log(np.expm1(1.0)))  # softplus of it is 1
        return cls(
            jnp.concatenate(parts), jnp.asarray(line - 1.0), jnp.full(cells, line),
            jnp.full(len(tuple(times)), line - 1.0), 1.5 * high, 1.5 * force, tuple(times), hidden,
        )  # fmt: skip

    @property
    def model(self) -> Series:
        """The chain of models this is: relaxing, then a leading Preisach model."""
        cells, dtype = len(self.rises), self.network.dtype
        mass = self._masses()
        weights = jnp.tril(0.02 * self.force * jax.nn.softplus(self.total) * mass / mass.sum())
        # The least R with which a leading model rises along every branch; see `Preisach.least_slope`.
        support = 2 * (weights.sum(0) + weights.sum(1))
        rises = support + jax.nn.softplus(self.rises) * (self.force / cells)
        relays = Preisach(GridDensity(0.0, self.high, weights), rises, -weights.sum(), leading=True)
        if not self.times:
            return Series([relays])
        c, tau = 0.05 * jax.nn.softplus(self.relaxing), jnp.array(self.times, dtype)
        return Series([GeneralizedMaxwell(jnp.ones((), dtype), c, tau), relays])

    def _masses(self) -> Float[Array, "cells cells"]:
        """mu ~ softplus(W_d tanh(... tanh(W_1 x + b_1)) + b_d) at the centre of each cell, x in [-1, 1]^2;
        times its area, 1 for a cell and 1/2 for the half cells on the diagonal."""
        cells, dtype, at = len(self.rises), self.network.dtype, 0
        centre = (np.arange(cells) + 0.5) * 2 / cells - 1
        value = jnp.asarray(np.stack(np.meshgrid(centre, centre, indexing="ij")), dtype)
        for k, (inputs, outputs) in enumerate(_layers(self.hidden)):
            W = self.network[at : at + inputs * outputs].reshape(outputs, inputs)
            b = self.network[at + inputs * outputs : at + (inputs + 1) * outputs]
            at += (inputs + 1) * outputs
            value = jnp.tanh(value) if k else value
            value = jnp.tensordot(W, value, 1) + b[:, None, None]
        return jax.nn.softplus(value[0]) * jnp.asarray(np.tri(cells) - np.eye(cells) / 2, dtype)

    def init(self, t0: ArrayLike | None = None, u0: ArrayLike | None = None) -> PyTree:
        return self.model.init(t0, u0)

    def follow(
        self, t: ArrayLike | None, u: ArrayLike, state: PyTree = None
    ) -> tuple[PyTree, Float[Array, " samples"]]:
        return self.model.stream(t, u, state)

    def prepare(
        self,
        t: ArrayLike | None,
        u: ArrayLike,
        state: PyTree = None,
        *,
        starts: tuple[int, ...] = (0,),
    ) -> PyTree:
        return self.model.prepare(t, u, state, starts=starts)

    def evaluate(self, prepared: PyTree) -> Float[Array, " samples"]:
        return self.model.evaluate(prepared)


def _layers(hidden: tuple[int, ...]) -> list[tuple[int, int]]:
    """Inputs and outputs of every layer."""
    return list(itertools.pairwise((2, *hidden, 1)))
