"""A smooth function of several variables from scattered values: the scales of a Gaussian process."""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Float

from hysteresis import InputError, Kernel

from ..parameters._precision import require_double

MOST = 600
"""Rows by which the scales are chosen: evidence takes the cube of their number, and more say little."""

STEPS = 200


def fit_kernel(
    x: Float[np.ndarray, "rows features"],
    y: Float[np.ndarray, "rows outputs"],
    seed: int = 0,
    allow_float32: bool = False,
) -> Kernel:
    """The kernel under which values are likeliest, outputs being independent functions of one kind:

        log p(y) = -sum_o y_o' K^-1 y_o / 2 - (outputs / 2) log det K + const,     K = k(x, x) + noise^2

    **Arguments:** `x`: each feature on a scale of its own, say of deviation 1. `y`: about their mean. Of
    more rows than 600 that many are drawn by `seed`.

    Raises `InputError` for less than ten rows, values that are not finite, and without double precision.

    Source: Rasmussen and Williams, Gaussian processes for machine learning (2006), equation 5.8.
    """
    require_double(allow_float32)
    if len(x) < 10 or len(x) != len(y):
        raise InputError(
            "too-few-rows", f"{len(x)} rows of features, {len(y)} of values.", fix="ten of both."
        )
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise InputError("not-finite", "a feature or a value is no number.", fix="leave it out.")
    rows = np.arange(len(x))
    if len(x) > MOST:
        rows = np.sort(np.random.default_rng(seed).choice(len(x), MOST, replace=False))
    start = np.log(np.concatenate([[y.std()], np.full(x.shape[1], 3.0), [0.1 * y.std()]]))
    return _likeliest(jnp.asarray(x[rows]), jnp.asarray(y[rows]), jnp.asarray(start))


def kernel_of(point: Float[Array, " unknowns"]) -> Kernel:
    """From the logarithms of size, lengths and noise."""
    found = jnp.exp(point)
    return Kernel(found[0], found[1:-1], found[-1])


def evidence(
    kernel: Kernel, x: Float[Array, "rows features"], y: Float[Array, "rows outputs"]
) -> Float[Array, ""]:
    """log p(y), see `fit_kernel`."""
    L = jnp.linalg.cholesky(kernel.between(x, x) + kernel.noise**2 * jnp.eye(len(x)))
    white = jax.scipy.linalg.solve_triangular(L, y, lower=True)
    of_determinant = y.shape[1] * jnp.log(jnp.diagonal(L)).sum()
    return -0.5 * (white**2).sum() - of_determinant - 0.5 * y.size * jnp.log(2 * jnp.pi)


@jax.jit
def _likeliest(x: Array, y: Array, start: Array) -> Kernel:
    def unlikely(point: Array, given: tuple[Array, Array]) -> Array:
        return -evidence(kernel_of(point), *given) / y.size

    solver = optimistix.BFGS(rtol=1e-4, atol=1e-4)
    found = optimistix.minimise(unlikely, solver, start, args=(x, y), max_steps=STEPS, throw=False)
    return kernel_of(found.value)
