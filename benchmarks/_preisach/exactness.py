"""How exact the Preisach model on a grid is: against finer sampling, and against a formula."""

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import Preisach

from .._measure import Row, judged
from .inputs import CELLS, grid_model, random_model

SAMPLES = 500
DENSER = 100


@jax.jit
def _simulate(model: Preisach, u: jax.Array) -> jax.Array:
    # `prepare` under the trace: shapes do not depend on the history, so this compiles once.
    return model.simulate(None, u)


def rows(quick: bool) -> list[Row]:
    """Largest differences over random histories, in terms of the range of each one's output."""
    histories = np.random.default_rng(5).random((10 if quick else 200, SAMPLES))
    return [
        judged(
            f"path sampled {DENSER} times denser, difference over the range",
            max(map(_from_denser, histories)),
            1e-12,
        ),
        judged(
            "uniform density, difference from the formula over the range",
            max(map(_from_formula, histories)),
            1e-12,
        ),
    ]


def _from_denser(u: np.ndarray) -> float:
    common = np.arange(SAMPLES) * DENSER
    dense = np.interp(np.arange(common[-1] + 1), common, u)
    model = random_model()
    return _difference(
        _simulate(model, jnp.asarray(dense))[common], _simulate(model, jnp.asarray(u))
    )


def _from_formula(u: np.ndarray) -> float:
    # Half of a cell on the diagonal is above it.
    weights = np.tril(np.full((CELLS, CELLS), 2 / CELLS**2))
    weights[np.diag_indices(CELLS)] /= 2
    return _difference(
        _simulate(grid_model(jnp.asarray(weights)), jnp.asarray(u)), uniform_output(u)
    )


def _difference(one: jax.Array, other: jax.Array | np.ndarray) -> float:
    return float(jnp.abs(one - other).max() / jnp.ptp(one))


def uniform_output(u: np.ndarray) -> np.ndarray:
    """y of relays spread evenly over the triangle of [0, 1], of mass 1, from negative saturation.

    E(a, b) = (a - b)^2, and y = -1 + 2 sum of s_k E(v_k, v_k+1) over the turning points v that are
    remembered, from 0 to the present input, with s_k = +1 where v rises and -1 where it falls.
    """
    remembered, y = [0.0], np.empty(len(u))
    for k, x in enumerate(u.tolist()):
        v = remembered
        if len(v) > 1 and (v[-1] - v[-2]) * (x - v[-1]) >= 0:
            v.pop()  # the branch goes on
        while len(v) > 2 and abs(x - v[-1]) >= abs(v[-1] - v[-2]):
            del v[-2:]  # a loop is closed
        v.append(x)
        change = np.diff(v)
        y[k] = -1 + 2 * np.sum(change * np.abs(change))
    return y
