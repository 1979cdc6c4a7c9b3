"""Gaussian-process regression: the kernel's scales by maximum marginal likelihood."""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Float

from hysteresis import InputError
from hysteresis.numerics._functions import Kernel

from .._levels import AT_ONCE, STEPS


def fit_kernel(
    x: Float[np.ndarray, "rows features"],
    y: Float[np.ndarray, "rows outputs"],
    seed: int = 0,
) -> Kernel:
    """Fit the scales of a squared-exponential kernel by maximum marginal likelihood:

        log p(y) = -sum_o y_o' K^-1 y_o / 2 - (outputs / 2) log det K + const,     K = k(x, x) + noise^2

    The outputs are independent functions with the same kernel.

    **Arguments:**

    - `x`: features, each scaled to about standard deviation 1.
    - `y`: values with their mean subtracted, in any unit.
    - `seed`: draws 600 rows if there are more.

    Returns the kernel: its size and noise in the unit of `y`, one length for each feature.

    Raises `InputError` `too-few-rows` for fewer than ten rows, and `not-finite`.

    Source: Rasmussen and Williams, Gaussian processes for machine learning (2006), equation 5.8.
    """
    if len(x) < 10 or len(x) != len(y):
        raise InputError(
            "too-few-rows",
            f"there are {len(x)} rows of features and {len(y)} of values.",
            fix="give at least ten rows of both.",
        )
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise InputError(
            "not-finite", "a feature or a value is not a finite number.", fix="exclude that row."
        )
    rows = np.arange(len(x))
    if len(x) > AT_ONCE:  # the cost grows with their cube, and more rows change little
        rows = np.sort(np.random.default_rng(seed).choice(len(x), AT_ONCE, replace=False))
    start = np.log(np.concatenate([[y.std()], np.full(x.shape[1], 3.0), [0.1 * y.std()]]))
    return _maximised(jnp.asarray(x[rows]), jnp.asarray(y[rows]), jnp.asarray(start))


def kernel_of(point: Float[Array, " unknowns"]) -> Kernel:
    """The kernel with these logarithms of size, lengths and noise."""
    scales = jnp.exp(point)
    return Kernel(scales[0], scales[1:-1], scales[-1])


def log_marginal_likelihood(
    kernel: Kernel, x: Float[Array, "rows features"], y: Float[Array, "rows outputs"]
) -> Float[Array, ""]:
    """log p(y), see `fit_kernel`."""
    L = jnp.linalg.cholesky(kernel.among(x))
    white = jax.scipy.linalg.solve_triangular(L, y, lower=True)
    of_determinant = y.shape[1] * jnp.log(jnp.diagonal(L)).sum()
    return -0.5 * (white**2).sum() - of_determinant - 0.5 * y.size * jnp.log(2 * jnp.pi)


@jax.jit
def _maximised(x: Array, y: Array, start: Array) -> Kernel:
    def objective(point: Array, given: tuple[Array, Array]) -> Array:
        return -log_marginal_likelihood(kernel_of(point), *given) / y.size

    solver = optimistix.BFGS(rtol=1e-4, atol=1e-4)
    found = optimistix.minimise(objective, solver, start, args=(x, y), max_steps=STEPS, throw=False)
    return kernel_of(found.value)
