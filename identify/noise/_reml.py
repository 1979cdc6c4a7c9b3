"""Restricted maximum likelihood (REML) of a noise model of one kind, together with the model's parameters.

Pure JAX, so that `jax.vmap` tries several kinds or records at once.
"""

from itertools import product
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Bool, Float
from scipy.special import logit

from hysteresis import InputError

from ._model import NoiseModel, Rows

PARTS = ("sigma", "growth", "input_sigma", "misfit", "phi", "theta", "tail")
"""The parts a noise model may have, in the order of their unconstrained parameters."""

ABSENT = (0.0, np.log(1e-9), np.log(1e-9), np.log(1e-9), 0.0, 0.0, float(logit(2e-6)))
"""Unconstrained parameters that switch a part off: it is then negligibly small."""

BEGIN = (0.0, *[np.log(0.3)] * 3, float(logit(0.75)), float(logit(0.45)), float(logit(0.4)))
"""Start values of the parts that are on: phi = 0.5, theta = -0.1, five degrees of freedom."""

WITHIN = ((-9.0,) * 4 + (-12.0,) * 3, (3.0,) * 4 + (12.0,) * 3)
"""Bounds of the search, unconstrained: sizes from 1e-4 to 20 times the residuals', phi up to 0.99999."""


class Linearised(NamedTuple):
    """A model linearised about z, and the rows it predicts:

    residuals r(z + d) = residuals + jacobian d,     -log prior(z + d) = pull'd + d'precision d / 2.
    """

    residuals: Float[Array | np.ndarray, " rows"]
    jacobian: Float[Array | np.ndarray, "rows parameters"]
    rows: Rows
    pull: Float[Array | np.ndarray, " parameters"]
    precision: Float[Array | np.ndarray, "parameters parameters"]


class NoiseFit(NamedTuple):
    """The restricted maximum likelihood of one kind of noise.

    - `free`: the noise's parameters in unconstrained space, in the order of `PARTS`; parts of other kinds
      have the values of `ABSENT`.
    - `away`: the change d of the model's parameters that goes with it.
    - `cost`: -log of the restricted likelihood.
    """

    free: Float[Array, " parts"]
    away: Float[Array, " parameters"]
    cost: Float[Array, ""]


def kinds(noise: str) -> tuple[tuple[str, ...], ...]:
    """The parts of every kind of noise to try, the simplest first.

    `noise`: "auto", or any of gaussian, student-t, ar1, arma11, growing, input and misfit, joined by +.

    Raises `InputError` for another word, and for a misfit with Student's t, which has no closed form.
    """
    if noise == "auto":
        correlated = ((), ("phi",), ("phi", "theta"))
        choices = product(correlated, ((), ("tail",)), ((), ("growth",)))
        found = [("sigma", *c, *t, *g) for c, t, g in choices]
        return tuple(sorted(found, key=len))
    meaning = {
        "gaussian": (), "student-t": ("tail",), "ar1": ("phi",), "arma11": ("phi", "theta"),
        "growing": ("growth",), "input": ("input_sigma",), "misfit": ("misfit",),
    }  # fmt: skip
    words = [word.strip() for word in noise.split("+")]
    if odd := [word for word in words if word not in meaning]:
        raise InputError(
            "bad-option",
            f"no noise {odd[0]!r}; have auto, or {', '.join(meaning)} with + between.",
        )
    if {"misfit", "student-t"} <= set(words):
        raise InputError(
            "bad-option", "a misfit goes with Gaussian noise only.", fix="leave out student-t."
        )
    return (("sigma", *dict.fromkeys(part for word in words for part in meaning[word])),)


def lanes(kinds: tuple[tuple[str, ...], ...]) -> Bool[np.ndarray, "kinds parts"]:
    """Whether each kind has each of the `PARTS`."""
    return np.array([[part in kind for part in PARTS] for kind in kinds])


def of_free(
    free: Float[Array, " parts"],
    sizes: Float[Array, " parts"] | float = 1.0,
    with_misfit: bool = False,
) -> NoiseModel:
    """The noise of unconstrained parameters, as in `Transform`; `sizes` multiply the positive ones."""
    sigma, growth, input_sigma, misfit = (sizes * jnp.exp(free))[:4]
    phi, theta = jnp.tanh(free[4:6] / 2)
    tail = 0.5 / (1 + jnp.exp(-free[6]))
    return NoiseModel(sigma, growth, input_sigma, phi, theta, tail, misfit if with_misfit else None)


def noise_fit(
    at: Linearised, kind: Bool[Array, " parts"], with_misfit: bool = False, steps: int = 100
) -> NoiseFit:
    """Estimate the noise of one kind and the change d of the model by restricted maximum likelihood.

    It minimises -log p(r + J d | noise) - log prior + log det(J'J + precision, whitened) / 2. The last term
    accounts for the degrees of freedom that the model's parameters use. For Gaussian noise the result is
    the marginal likelihood of the noise, integrated over d.

    Source: Patterson, Thompson, Recovery of inter-block information when block sizes are unequal,
    Biometrika 58 (1971).
    """
    r, J, rows, pull, precision = at
    counted = jnp.where(rows.counted, 1.0, 0.0)
    count = counted.sum()
    size = jnp.sqrt(jnp.sum(counted * r**2) / count)
    basis, seen = _basis(J * counted[:, None], size)
    columns, precision = J @ basis, basis.T @ precision @ basis
    sizes = jnp.append(size / _largest(rows), jnp.ones(3))

    def free_of(x: Array) -> Array:
        inside = jnp.clip(x[: len(PARTS)], *(jnp.asarray(ends) for ends in WITHIN))
        return jnp.where(kind, inside, jnp.asarray(ABSENT))

    def cost(x: Array, _: None) -> tuple[Array, Array]:
        noise, d = of_free(free_of(x), sizes, with_misfit), x[len(PARTS) :]
        likelihood = noise.log_likelihood(r + columns @ d, rows)
        open_ways = jnp.diag(jnp.where(seen, 0.0, count))
        information = noise.information_of(columns, rows) + precision + open_ways
        _, log_determinant = jnp.linalg.slogdet(information / count)
        prior = (pull @ basis) @ d + d @ precision @ d / 2
        prior = prior - jnp.sum(jnp.where(kind, log_prior(free_of(x)), 0.0))
        value = (-likelihood + log_determinant / 2 + prior) / count
        return value, value

    start = jnp.append(jnp.where(kind, jnp.asarray(BEGIN), 0.0), jnp.zeros(J.shape[1]))
    solver = optimistix.BFGS(rtol=1e-7, atol=1e-9)
    found = optimistix.minimise(cost, solver, start, has_aux=True, max_steps=steps, throw=False)
    free = free_of(found.value) + jnp.log(sizes)
    return NoiseFit(free, basis @ found.value[len(PARTS) :], count * found.aux)


def _basis(J: Array, size: Array) -> tuple[Array, Array]:
    """Orthogonal changes of the parameters that each move the output by `size`, so that the search is well
    conditioned, and which of them move it at all; the others are zero."""
    gram = J.T @ J
    norm = jnp.sqrt(jnp.diagonal(gram))
    norm = jnp.where(norm > 0, norm, 1.0)
    values, vectors = jnp.linalg.eigh(gram / jnp.outer(norm, norm))
    seen = values > 1e-12
    width = size * jnp.sqrt(len(J) / jnp.where(seen, values, 1.0))
    return vectors / norm[:, None] * jnp.where(seen, width, 0.0)[None], seen


def _largest(rows: Rows) -> Array:
    """1, the largest output, the largest slope, and 1: the scales of the positive parts."""
    found = [jnp.max(jnp.abs(jnp.where(rows.counted, x, 0.0))) for x in (rows.output, rows.slope)]
    return jnp.stack([jnp.ones(()), *(jnp.where(x > 0, x, 1.0) for x in found), jnp.ones(())])


def log_prior(free: Float[Array, " parts"]) -> Float[Array, " parts"]:
    """Weak log-priors of the noise: flat, except near the bounds of phi, theta and tail.

    They are no stronger than that, because the full Jacobian of the transform pulls phi towards 0, which
    makes standard errors too small.
    """
    fence = jax.nn.log_sigmoid(free[4:]) + jax.nn.log_sigmoid(-free[4:])
    return jnp.concatenate([jnp.zeros(4), 0.1 * fence])
