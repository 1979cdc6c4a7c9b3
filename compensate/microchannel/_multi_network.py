"""Forces of several contacts as in the paper: a recurrent network for each, and a search."""

import itertools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray
from numpy.typing import ArrayLike

from hysteresis import InputError

from .._contract import AbstractStreamed, scanned

SEQUENCE = 20
PREOCCUPIED = 10
REACH_N, RESOLUTION_N = 0.4, 0.1
GATES = 4

Network = Callable[[Array], Array]
"""Windows of forces (windows, sequence) -> readings at their ends (windows, layers)."""


class ForceNetwork(eqx.Module):
    """Readings from the last 20 forces of one location: LSTM layers, a dense layer, a linear layer.

        i, f, o = sigmoid(W x + U h + b),  c <- f c + i relu(W x + U h + b),  h <- o relu(c)  in each layer
        z = V relu(D dropout(h_3) + d) + v,      of the last of the sequence

    **Arguments:** the weights, see `random`; `dropout`: the share of the last layer that a training omits;
    `inference`: True omits none.

    **Source:** Kim and Park (2018), section III D: three layers of 70, dropout of 0.5 at the third, a fully
    connected layer of 25, ReLU throughout, sequences of 20.

    **Example:**

        >>> start = compensate.internal.ForceNetwork.random(jax.random.key(0), hidden=6, depth=1)
        >>> start(jnp.zeros((13, 20))).shape
        (13, 2)
    """

    matrices: tuple[Float[Array, "_ gates"], ...]
    biases: tuple[Float[Array, " gates"], ...]
    dense: Float[Array, "hidden dense"]
    dense_bias: Float[Array, " dense"]
    line: Float[Array, "dense layers"]
    line_bias: Float[Array, " layers"]
    dropout: float = eqx.field(default=0.5, static=True)
    inference: bool = False

    @classmethod
    def random(
        cls,
        key: PRNGKeyArray,
        *,
        layers: int = 2,
        hidden: int = 70,
        depth: int = 3,
        dense: int = 25,
    ) -> "ForceNetwork":
        """A network to start a training from; forget gates begin open, as is usual."""
        keys = iter(jax.random.split(key, depth + 2))

        def normal(in_: int, out: int) -> Array:
            return jax.random.normal(next(keys), (in_, out)) / np.sqrt(in_)

        inputs = [1] + [hidden] * (depth - 1)
        matrices = tuple(normal(in_ + hidden, GATES * hidden) for in_ in inputs)
        open_ = jnp.zeros(GATES * hidden).at[hidden : 2 * hidden].set(1.0)
        return cls(
            matrices, (open_,) * depth, normal(hidden, dense), jnp.zeros(dense),
            normal(dense, layers), jnp.zeros(layers),
        )  # fmt: skip

    def __call__(
        self, force: Float[Array, "windows sequence"], key: PRNGKeyArray | None = None
    ) -> Float[Array, "windows layers"]:
        """Readings at the end of windows of forces; `key` for the dropout of a training."""
        rows = jnp.swapaxes(force, 0, 1)[..., None]
        for W, b in zip(self.matrices, self.biases, strict=True):
            rows = _layer(W, b, rows)
        last = rows[-1]
        if not self.inference and key is not None:
            kept = jax.random.bernoulli(key, 1 - self.dropout, last.shape)
            last = jnp.where(kept, last / (1 - self.dropout), 0.0)
        last = jax.nn.relu(last @ self.dense + self.dense_bias[None])
        return last @ self.line + self.line_bias[None]


def _layer(W: Array, b: Array, rows: Float[Array, "sequence windows in_"]) -> Array:
    hidden = W.shape[1] // GATES
    into, round_ = W[:-hidden], W[-hidden:]
    driven = rows @ into + b[None, None]

    def move(carry: tuple[Array, Array], x: Array) -> tuple[tuple[Array, Array], Array]:
        h, c = carry
        i, f, o, g = jnp.split(x + h @ round_, GATES, axis=1)
        c = jax.nn.sigmoid(f) * c + jax.nn.sigmoid(i) * jax.nn.relu(g)
        h = jax.nn.sigmoid(o) * jax.nn.relu(c)
        return (h, c), h

    none = jnp.zeros((rows.shape[1], hidden), rows.dtype)
    return jax.lax.scan(move, (none, none), driven)[1]


def windows(
    force: Float[np.ndarray, " samples"], sequence: int = SEQUENCE
) -> Float[np.ndarray, "samples sequence"]:
    """The last `sequence` forces at every sample, the latest last; before the first they are zero."""
    padded = np.concatenate([np.zeros(sequence - 1), np.asarray(force, float)])
    return np.lib.stride_tricks.sliding_window_view(padded, sequence).copy()


class SearchEstimator(AbstractStreamed[Array, Array]):
    """The paper's inverse: a grid search for the forces whose reading is closest.

        F_n = argmin over F in F_(n-1) + {-0.4, -0.3, ..., 0.4}^contacts of |z_n - sum_k N_k(F_k, past)|^2

    Two contacts have 81 pairs of forces, from two times 9 sequences. The search starts from ten zeros, and
    forces are never negative. It gives no uncertainty, and no force can change faster than 0.4 N a sample.

    **Arguments:** `networks`, one for each location: (windows, sequence) -> (windows, layers).

    **Source:** Kim and Park (2018), section III D.

    **Example:**

        >>> networks = [lambda F: F[:, -1:] * jnp.array([[1.0, 0.5]])]
        >>> search = compensate.internal.SearchEstimator(networks)
        >>> search.simulate(None, np.array([[0.3, 0.15], [0.6, 0.3]])).round(6).tolist()
        [[0.3], [0.6]]
    """

    networks: tuple[Network, ...] = eqx.field(converter=tuple)
    sequence: int = eqx.field(default=SEQUENCE, static=True)
    along = 0

    def __check_init__(self) -> None:
        if not self.networks or self.sequence < PREOCCUPIED:
            raise InputError("bad-option", f"no network, or sequences shorter than {PREOCCUPIED}.")

    def init(self) -> Float[Array, "contacts past"]:
        """The forces found last: the paper's ten zeros, and those before them that fill a sequence."""
        return jnp.zeros((len(self.networks), self.sequence - 1))

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: Array
    ) -> tuple[Array, Float[Array, "samples contacts"]]:
        """Readings (samples, layers)."""
        return scanned(self, None, jnp.asarray(y, float), state)

    def take(self, state: Array, t: ArrayLike | None, reading: ArrayLike) -> tuple[Array, Array]:
        """One reading (layers,) in, forces (contacts,) in N out; `t` does not matter."""
        z = jnp.asarray(reading, state.dtype)
        valid = jnp.isfinite(z).all()
        count = round(REACH_N / RESOLUTION_N)
        away = RESOLUTION_N * jnp.arange(-count, count + 1, dtype=z.dtype)
        tried = jnp.maximum(state[:, -1:] + away[None], 0.0)
        read = []
        for network, past, own in zip(self.networks, state, tried, strict=True):
            same = jnp.broadcast_to(past, (len(away), *past.shape))
            read.append(network(jnp.concatenate([same, own[:, None]], 1)))
        grid = jnp.array(list(itertools.product(range(len(away)), repeat=len(self.networks))))
        whole = sum(r[grid[:, k]] for k, r in enumerate(read))
        best = grid[jnp.argmin(((whole - z[None]) ** 2).sum(1))]
        force = jnp.take_along_axis(tried, best[:, None], 1)
        after = jnp.concatenate([state[:, 1:], force], 1)
        state = jnp.where(valid, after, state)
        return state, state[:, -1]
