"""Calibration of any system of parameters: Gaussian priors, least squares, the posterior covariance."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from hysteresis import InputError, parameters
from hysteresis._parameter import parameter_at

from ..parameters._settings import require_double
from ..parametric._levenberg_marquardt import least_squares
from ..posterior._emcee import first_walkers, sample_ensembles
from ..posterior._posterior import Posterior, Progress, posterior_of
from ..posterior._sample import MOST_STEPS, walkers_for
from ..storage._checkpoint import Checkpoint

System = TypeVar("System", bound=eqx.Module)


class Calibrated(NamedTuple):
    """One parameter: its `value`, its standard deviation after the data, and that of its `prior`."""

    name: str
    value: float
    deviation: float
    prior: float


class Prior(eqx.Module):
    """The prior of some arrays of a system, and the unconstrained space in which it is standard normal:

        x = x_0 + s z                                      if x has no lower bound
        x = low + (x_0 - low) exp(s z / (x_0 - low))       if it has one

    - `places`: dotted names in `system`, which holds all x_0. `deviations`: s, of each array's shape.
    """

    system: Any
    places: tuple[str, ...] = eqx.field(static=True)
    lows: tuple[float, ...] = eqx.field(static=True)
    deviations: tuple[Array, ...]

    def at(self, z: Float[Array, " unknowns"]) -> Any:
        """The system of a point in the unconstrained space."""
        found, k = [], 0
        for x, low, s in zip(self._means(), self.lows, self.deviations, strict=True):
            step = s * z[k : k + x.size].reshape(x.shape)
            k += x.size
            if low == -float("inf"):
                found.append(x + step)
            else:
                found.append(low + (x - low) * jnp.exp(step / (x - low)))
        return eqx.tree_at(self._values, self.system, found)

    def many(self, z: Float[Array, "points unknowns"]) -> Any:
        """The systems of many points: a leading axis on the free arrays alone."""
        found = jax.vmap(lambda one: self._values(self.at(one)))(z)
        return eqx.tree_at(self._values, self.system, found)

    def values(self, z: Float[Array, " unknowns"]) -> Float[Array, " unknowns"]:
        """All parameters of a point, one after the other."""
        return jnp.concatenate([x.ravel() for x in self._values(self.at(z))])

    @property
    def names(self) -> tuple[str, ...]:
        """Of every parameter: "matrix[0, 5]"."""
        return tuple(
            f"{place}{list(index)}" if index else place
            for place, x in zip(self.places, self._means(), strict=True)
            for index in np.ndindex(x.shape)
        )

    def _means(self) -> list[Array]:
        return self._values(self.system)

    def _values(self, system: Any) -> list[Any]:
        return [parameter_at(system, place) for place in self.places]


@dataclass(frozen=True)
class Calibration(Generic[System]):
    """A calibrated system.

    - `system`: with the calibrated values. `parameters`: every free one, with its standard deviation.
    - `rms`: of the residuals, divided by their standard deviations: 1 if these are right.
    - `converged`: whether the search converged, after so many `steps`.
    - `point`, `root`: the mode in the unconstrained space, and a root of the covariance there.
    - `prior`, `residuals`: what it was calibrated with. `jacobian`: of the residuals, by z, at the mode.

    In the example: one parameter, measured as 2.1 with a standard deviation of 0.1; expected was 2 ± 0.5.
    """

    system: System
    parameters: tuple[Calibrated, ...]
    rms: float
    converged: bool
    steps: int
    prior: Prior
    residuals: Callable[[System], Array]
    point: Float[np.ndarray, " unknowns"]
    root: Float[np.ndarray, "unknowns unknowns"]
    jacobian: Float[np.ndarray, "residuals unknowns"]

    @property
    def text(self) -> str:
        """A table for a terminal."""
        lines = [f"{'parameter':32}{'value':>12}{'deviation':>12}{'before':>12}"]
        lines += [f"{n:32}{v:12.5g}{d:12.2g}{p:12.2g}" for n, v, d, p in self.parameters]
        return "\n".join([*lines, f"residuals: {self.rms:.3g} of their deviations"])

    def draws(self, count: int, seed: int = 0) -> System:
        """Draws of the system by Laplace's approximation; the free arrays get a leading axis of `count`."""
        random = np.random.default_rng(seed)
        normal = random.normal(size=(count, len(self.point)))
        return self.prior.many(jnp.asarray(self.point + normal @ self.root.T))

    def sample(
        self,
        steps: int | None = None,
        ensembles: int = 4,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> Posterior:
        """Sample the posterior by emcee, as `identify.sample`; its `model` has a leading axis of draws.

        If the residuals are nearly linear within the posterior, `draws` gives the same at once.

        **Arguments:** as those of `identify.sample`.
        """
        begin = time.perf_counter()
        walkers = walkers_for(None, len(self.point))
        density = _density(self.residuals, self.prior)
        first = first_walkers(density, self.point, self.root, ensembles, walkers, seed)
        tell = progress or (lambda done, total, text: None)
        chains = sample_ensembles(
            density, first, self.point, self.root, seed, steps, MOST_STEPS, Checkpoint(None), tell
        )
        values, prior_variance = jax.jit(jax.vmap(self.prior.values)), np.ones(len(self.point))
        return posterior_of(
            self.prior.names, chains, values, self.prior.many, prior_variance, begin
        )


def calibrate(
    system: System,
    residuals: Callable[[System], Array],
    deviations: Mapping[str, Any],
    steps: int = 100,
    begin: Float[np.ndarray, " unknowns"] | None = None,
    allow_float32: bool = False,
) -> Calibration[System]:
    """Calibrate a whole system against measurements, given what is known of its parts:

        minimise |residuals(x)|^2 + |z(x)|^2,     z = (x - x_0) / s        (see `Prior`)

    This is the mode of the posterior if the residuals have normal noise of standard deviation 1. The
    covariance (1 + J'J)^-1 is always finite: a parameter that no residual depends on keeps
    its prior.

    **Arguments:**

    - `system`: an `equinox.Module` with the expected values x_0.
    - `residuals`: function of a system that JAX can compile; returns an array of any length, each residual
      divided by the standard deviation of its noise.
    - `deviations`: the free parameters: dotted name of an array in the system -> its prior standard
      deviation s, one number or one for each entry, in the array's unit; 0 keeps an entry fixed.
    - `steps`: most steps of Levenberg-Marquardt.
    - `begin`: where the search begins: the `point` of a calibration with the same `deviations`; by default
      x_0.
    - `allow_float32`: calibrate although JAX's double precision is off.

    Raises `InputError` `unknown-parameter` for a name that is not in the system, `bad-deviation`,
    `not-finite`, and without double precision.

    Source: Gelman and others, Bayesian Data Analysis (2013), section 4.1, for the normal approximation.

    In the example: three readings of a line, with a noise of 0.1 mm.
    """
    require_double(allow_float32)
    prior = prior_of(system, deviations)
    start = jnp.zeros(len(prior.names)) if begin is None else jnp.asarray(begin)
    found, best, values, slopes, is_finite = _search(residuals, prior, start, steps)
    if not is_finite:
        raise InputError(
            "not-finite",
            "the residuals of the given system are not all finite.",
            cause="a reading is not a number, or the system starts outside its domain.",
            fix="exclude such readings, or start from values with finite residuals.",
        )
    # QR of [J; 1], whose R is a root of the precision: never singular.
    measured = len(found.residuals) - len(start)
    J, left = (np.asarray(x)[:measured] for x in (found.jacobian, found.residuals))
    R = np.linalg.qr(np.concatenate([J, np.eye(len(start))]), mode="r")
    root = np.linalg.inv(R)
    after = np.linalg.norm(np.asarray(slopes) @ root, axis=1)
    before = np.concatenate([np.asarray(s).ravel() for s in prior.deviations])
    rows = zip(prior.names, np.asarray(values), after, before, strict=True)
    return Calibration(
        system=best, parameters=tuple(Calibrated(n, *map(float, x)) for n, *x in rows),
        rms=float(np.sqrt(np.mean(left**2))), converged=bool(found.converged), steps=int(found.steps),
        prior=prior, residuals=residuals, point=np.asarray(found.free), root=root, jacobian=J,
    )  # fmt: skip


def prior_of(system: eqx.Module, deviations: Mapping[str, Any]) -> Prior:
    """The prior given by the deviations of `calibrate`."""
    known = {name: info for name, info, value in parameters(system) if value is not None}
    lows, spreads = [], []
    for name, given in deviations.items():
        if name not in known:
            raise InputError(
                "unknown-parameter",
                f"{type(system).__name__} has no {name!r}.",
                fix=f"one of {', '.join(known)}.",
            )
        x, s = parameter_at(system, name), np.asarray(given, float)
        if s.shape not in ((), x.shape) or not (np.isfinite(s) & (s >= 0)).all():
            raise InputError(
                "bad-deviation",
                f"{name}: {given} is not a standard deviation for an array of shape {x.shape}.",
                fix="give one number, or one for each entry, none negative; 0 keeps an entry fixed.",
            )
        lows.append(known[name].bounds[0])
        spreads.append(jnp.asarray(np.broadcast_to(s, x.shape)))
    return Prior(system, tuple(deviations), tuple(lows), tuple(spreads))


@eqx.filter_jit
def _search(
    residuals: Callable[[Any], Array], prior: Prior, start: Array, steps: int
) -> tuple[Any, Any, Array, Array, Array]:
    """The minimum; its system, all values and their derivatives by z; whether the start was finite."""

    def residuals_at(z: Array, prior: Prior) -> Array:
        return jnp.ravel(residuals(prior.at(z)))

    def both(z: Array, prior: Prior) -> tuple[Array, None]:
        return jnp.concatenate([residuals_at(z, prior), z]), None

    first = residuals_at(start, prior)
    found = least_squares(both, start, prior, first.size + start.size, steps)
    slopes = jax.jacfwd(prior.values)(found.free)
    is_finite = jnp.isfinite(first).all()
    return found, prior.at(found.free), prior.values(found.free), slopes, is_finite


def _density(
    residuals: Callable[[Any], Array], prior: Prior
) -> Callable[[Float[np.ndarray, "points unknowns"]], np.ndarray]:
    """The log-posterior of many points at once, up to a constant."""

    def one(z: Array) -> Array:
        return -0.5 * (jnp.sum(residuals(prior.at(z)) ** 2) + jnp.sum(z**2))

    many = jax.jit(jax.vmap(one))
    return lambda points: np.asarray(many(jnp.asarray(points)))
