"""Calibration of a whole system: what is believed before, least squares, what is left open."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Bool, Float

from hysteresis import InputError, parameter_at, parameters

from ..parameters._precision import require_double
from ..posterior._chains import Progress
from ..posterior._emcee import sample_ensembles
from ..posterior._posterior import Posterior
from ..posterior._sample import MOST_STEPS, first_walkers, posterior_of, walkers_for
from ..storage._checkpoint import Checkpoint

System = TypeVar("System", bound=eqx.Module)


class Calibrated(NamedTuple):
    """One number: its `value` and its deviations after the data and before them, `prior`."""

    name: str
    value: float
    deviation: float
    prior: float


class Prior(eqx.Module):
    """What is believed of some arrays of a system, and the free space in which that is standard normal:

        x = x_0 + s z                                      where x is not bounded below
        x = low + (x_0 - low) exp(s z / (x_0 - low))       where it is

    - `places`: dotted names in `system`, which holds all x_0. `deviations`: s, of each array's shape.
    """

    system: Any
    places: tuple[str, ...] = eqx.field(static=True)
    lows: tuple[float, ...] = eqx.field(static=True)
    deviations: tuple[Array, ...]

    def at(self, z: Float[Array, " unknowns"]) -> Any:
        """The system of a point in the free space."""
        found, k = [], 0
        for x, low, s in zip(self._means(), self.lows, self.deviations, strict=True):
            away = s * z[k : k + x.size].reshape(x.shape)
            k += x.size
            if low == -float("inf"):
                found.append(x + away)
            else:
                found.append(low + (x - low) * jnp.exp(away / (x - low)))
        return eqx.tree_at(self._values, self.system, found)

    def many(self, z: Float[Array, "points unknowns"]) -> Any:
        """The systems of many points: a leading axis on the free arrays alone."""
        found = jax.vmap(lambda one: self._values(self.at(one)))(z)
        return eqx.tree_at(self._values, self.system, found)

    def values(self, z: Float[Array, " unknowns"]) -> Float[Array, " unknowns"]:
        """All numbers of a point, one after the other."""
        return jnp.concatenate([x.ravel() for x in self._values(self.at(z))])

    @property
    def names(self) -> tuple[str, ...]:
        """Of every number: "matrix[0, 5]"."""
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

    - `system`: with what was found. `parameters`: every free number.
    - `rms`: of the residuals, in their own deviations: 1 where these are true.
    - `converged`: whether the search came to its end, after so many `steps`.
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
    """of the covariance at `point`, both in the free space"""

    @property
    def text(self) -> str:
        """A table for a terminal."""
        lines = [f"{'parameter':32}{'value':>12}{'deviation':>12}{'before':>12}"]
        lines += [f"{n:32}{v:12.5g}{d:12.2g}{p:12.2g}" for n, v, d, p in self.parameters]
        return "\n".join([*lines, f"residuals: {self.rms:.3g} of their deviations"])

    def draws(self, count: int, seed: int = 0) -> System:
        """Systems about the found one, by Laplace's approximation, with a leading axis on free arrays."""
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
        """The posterior by emcee, as `identify.sample`; `model` is the system with a leading draw axis.

        Where the residuals bend little within it, `draws` says the same at once.
        """
        begin = time.perf_counter()
        walkers = walkers_for(None, len(self.point))
        density = _density(self.residuals, self.prior)
        first = first_walkers(density, self.point, self.root, ensembles, walkers, seed)
        tell = progress or (lambda done, total, text: None)
        chains = sample_ensembles(
            density, first, self.point, self.root, seed, steps, MOST_STEPS, Checkpoint(None), tell
        )
        prior_variance = np.ones(len(self.point))
        return posterior_of(
            self.prior.names, chains, self.prior.values, self.prior.many, prior_variance, begin
        )


def calibrate(
    system: System,
    residuals: Callable[[System], Array],
    deviations: Mapping[str, Any],
    steps: int = 100,
    begin: Float[np.ndarray, " unknowns"] | None = None,
    allow_float32: bool = False,
) -> Calibration[System]:
    """Make a system agree with measurements of the whole of it, without leaving what is known of its parts.

        minimise |residuals(x)|^2 + |z(x)|^2,     z = (x - x_0) / s        (see `Prior`)

    which is the maximum of the posterior where residuals have normal noise of deviation 1. The covariance
    (J'J)^-1 there is finite always: of a number that the residuals do not tell the prior is left.

    **Arguments:**

    - `system`: with the values x_0 believed before.
    - `residuals`: of a system, an array of any length, each divided by its noise's deviation. Compiled.
    - `deviations`: which numbers are free: dotted name of an array in the system -> how far off it may be,
      s, one number or one for each; 0 keeps a number as it is.
    - `steps`: of Levenberg-Marquardt, at most. `begin`: where they begin, the `point` of a calibration with
      the same `deviations`; x_0 by default.

    Raises `InputError` for a name that is not in the system, a deviation that is negative or no number,
    residuals that are not finite, and without double precision.
    """
    require_double(allow_float32)
    prior = prior_of(system, deviations)
    start = jnp.zeros(len(prior.names)) if begin is None else jnp.asarray(begin)
    found = _search(residuals, prior, start, steps)
    if not found.starts:
        raise InputError(
            "not-finite",
            "the residuals of the system as it is given are not all finite.",
            cause="a reading that is no number, or a start outside of what the system can be.",
            fix="leave such readings out; start from values that give numbers.",
        )
    # QR of [J; 1], whose R is a root of the precision: never singular.
    R = np.linalg.qr(np.concatenate([found.jacobian, np.eye(len(start))]), mode="r")
    root = np.linalg.inv(R)
    after = np.linalg.norm(np.asarray(found.slopes) @ root, axis=1)
    before = np.concatenate([np.asarray(s).ravel() for s in prior.deviations])
    rows = zip(prior.names, np.asarray(found.values), after, before, strict=True)
    return Calibration(
        system=found.system, parameters=tuple(Calibrated(n, *map(float, x)) for n, *x in rows),
        rms=float(found.rms), converged=bool(found.done), steps=int(found.steps), prior=prior,
        residuals=residuals, point=np.asarray(found.z), root=root,
    )  # fmt: skip


def prior_of(system: eqx.Module, deviations: Mapping[str, Any]) -> Prior:
    """The prior that `calibrate` is told by its deviations."""
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
                f"{name}: {given} is no deviation of an array of shape {x.shape}.",
                fix="give one number, or one for each, none negative; 0 keeps it as it is.",
            )
        lows.append(known[name].bounds[0])
        spreads.append(jnp.asarray(np.broadcast_to(s, x.shape)))
    return Prior(system, tuple(deviations), tuple(lows), tuple(spreads))


class _Found(NamedTuple):
    """The minimum z with its system, all its numbers and their slopes by z, the residuals' Jacobian and rms
    there; whether it is a minimum, and after how many steps; whether the start had finite residuals."""

    z: Float[Array, " unknowns"]
    system: Any
    values: Float[Array, " unknowns"]
    slopes: Float[Array, "unknowns unknowns"]
    jacobian: Float[Array, "residuals unknowns"]
    rms: Float[Array, ""]
    done: Bool[Array, ""]
    steps: Array
    starts: Bool[Array, ""]


@eqx.filter_jit
def _search(residuals: Callable[[Any], Array], prior: Prior, start: Array, steps: int) -> _Found:
    def missed(z: Array, prior: Prior) -> Array:
        return jnp.ravel(residuals(prior.at(z)))

    def both(z: Array, prior: Prior) -> Array:
        return jnp.concatenate([missed(z, prior), z])

    def twice(z: Array) -> tuple[Array, Array]:
        left = missed(z, prior)
        return left, left

    solver = optimistix.LevenbergMarquardt(rtol=1e-8, atol=1e-8)
    solution = optimistix.least_squares(
        both, solver, start, args=prior, max_steps=steps, throw=False
    )
    z = solution.value
    jacobian, left = jax.jacfwd(twice, has_aux=True)(z)
    return _Found(
        z, prior.at(z), prior.values(z), jax.jacfwd(prior.values)(z), jacobian,
        jnp.sqrt(jnp.mean(left**2)), solution.result == optimistix.RESULTS.successful,
        solution.stats["num_steps"], jnp.isfinite(missed(start, prior)).all(),
    )  # fmt: skip


def _density(
    residuals: Callable[[Any], Array], prior: Prior
) -> Callable[[Float[np.ndarray, "points unknowns"]], np.ndarray]:
    """The log-posterior of many points at once, up to a constant."""

    def one(z: Array) -> Array:
        return -0.5 * (jnp.sum(residuals(prior.at(z)) ** 2) + jnp.sum(z**2))

    many = jax.jit(jax.vmap(one))
    return lambda points: np.asarray(many(jnp.asarray(points)))
