"""A density that is a small neural network."""

import itertools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from .._errors import InputError
from .._parameter import Scalar, parameter
from .._registry import register
from ._density import AbstractGridDensity, as_nodes


@register
class NetworkDensity(AbstractGridDensity):
    """A positive density that is smooth over the thresholds and has far fewer parameters than cells.

        mu(alpha, beta) ~ softplus(W_d tanh(... tanh(W_1 x + b_1)) + b_d),   x = (alpha, beta) on [-1, 1]^2,

    taken at the centre of each cell of a grid and scaled to the mass `total`. By construction E rises with
    a and falls with b, and its table is exact.

    **Arguments:**

    - `low`, `high`: the inputs where all relays are down, and up.
    - `total`: mass of the density, E(high, low).
    - `network`: one vector: each layer's matrix, row by row, followed by its biases.

    **Other arguments:**

    - `resolution`: how many cells the grid has along each threshold.
    - `hidden`: widths of the hidden layers.
    - `nodes`: the n+1 inputs between which the cells lie; None for cells of one width.

    Raises `InputError` for an empty range, nodes that do not fit, a vector of another length.

    **Example:**

        >>> density = hysteresis.preisach.NetworkDensity.random(0.0, 10.0, 5.0, jax.random.key(0))
        >>> y = hysteresis.Preisach(density).simulate(None, np.array([0.0, 10.0, 0.0]))
        >>> np.asarray(y).round(2).tolist()
        [-5.0, 5.0, -5.0]
    """

    low: float = eqx.field(static=True, converter=float)
    high: float = eqx.field(static=True, converter=float)
    total: Scalar = parameter(
        unit="output", bounds=(0.0, float("inf")), meaning="half the output's range"
    )
    network: Float[Array, " count"] | np.ndarray = parameter(meaning="weights of the network")
    resolution: int = eqx.field(default=50, static=True, kw_only=True)
    hidden: tuple[int, ...] = eqx.field(
        default=(16, 16), static=True, kw_only=True, converter=tuple
    )
    nodes: tuple[float, ...] | None = eqx.field(
        default=None, static=True, kw_only=True, converter=as_nodes
    )

    def __check_init__(self) -> None:
        needed = sum((inputs + 1) * outputs for inputs, outputs in _layers(self.hidden))
        if self.network.shape != (needed,):
            raise InputError(
                "length-mismatch",
                f"the network's weights have shape {self.network.shape}, not ({needed},).",
                fix="start from NetworkDensity.random.",
            )

    @classmethod
    def random(
        cls,
        low: float,
        high: float,
        total: Scalar,
        key: PRNGKeyArray,
        *,
        hidden: tuple[int, ...] = (16, 16),
        **options: Any,
    ) -> "NetworkDensity":
        """A density to start a fit from; each layer preserves the size of its inputs.

        `options` are `resolution` and `nodes`.
        """
        layers = _layers(hidden)
        matrices = (
            jax.random.normal(one, (outputs, inputs)) / np.sqrt(inputs)
            for one, (inputs, outputs) in zip(
                jax.random.split(key, len(layers)), layers, strict=True
            )
        )
        parts = [part for W in matrices for part in (W.ravel(), jnp.zeros(W.shape[0]))]
        return cls(low, high, total, jnp.concatenate(parts), hidden=hidden, **options)

    @property
    def cells(self) -> int:
        return self.resolution

    def masses(self) -> Float[Array, "cells cells"]:
        edges = self.edges
        centre = (edges[1:] + edges[:-1] - self.low - self.high) / (self.high - self.low)
        area = np.tril(np.outer(np.diff(edges), np.diff(edges)))
        area[np.diag_indices(self.cells)] /= 2
        alpha, beta = np.meshgrid(centre, centre, indexing="ij")
        x = jnp.asarray(np.stack([alpha, beta]), self.network.dtype)
        mass = jax.nn.softplus(self._output(x)) * jnp.asarray(area, self.network.dtype)
        return self.total * mass / mass.sum()

    def _output(self, x: Float[Array, "2 cells cells"]) -> Float[Array, "cells cells"]:
        at, value = 0, x
        for k, (inputs, outputs) in enumerate(_layers(self.hidden)):
            W = self.network[at : at + inputs * outputs].reshape(outputs, inputs)
            b = self.network[at + inputs * outputs : at + (inputs + 1) * outputs]
            at += (inputs + 1) * outputs
            value = jnp.tanh(value) if k else value
            value = jnp.tensordot(W, value, 1) + b[:, None, None]
        return value[0]


def _layers(hidden: tuple[int, ...]) -> list[tuple[int, int]]:
    """Inputs and outputs of every layer."""
    return list(itertools.pairwise((2, *hidden, 1)))
