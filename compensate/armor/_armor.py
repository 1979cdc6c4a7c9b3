"""A whole armor (sensor, shell and cover): from sensor readings to contacts, with their uncertainty."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key
from numpy.typing import ArrayLike

from hysteresis import Scalar, parameter
from hysteresis._parameter import PyTree

from ..runtime._contact import ContactStatus
from ._solver import Contact, ContactSolver
from ._wrench import AT_REST, Motion, WristSensor


class Armor(eqx.Module):
    """A force sensor and the shell that it carries: what a calibration calibrates as a whole.

    Its numbers have dotted names, "sensor.matrix", "solver.cover.factor.value".

    **Example:**

        >>> contact = armor.solve([10.0, 0.0, 0.0, 0.0, 2.0, 0.0])
        >>> contact.status.shape
        ()
    """

    sensor: WristSensor
    solver: ContactSolver

    def solve(self, readings: ArrayLike, motion: Motion = AT_REST) -> Contact:
        """The contacts behind readings (..., 6), each by itself: no history of sensor or cover.

        `motion`: of the shell, whose weight and inertia the sensor feels.
        """
        return self.solver.solve(*self.sensor.read(readings, motion))

    def simulate(
        self, t: ArrayLike | None, readings: ArrayLike, motion: Motion = AT_REST
    ) -> Contact:
        """The contacts of a stream of readings (samples, 6), with the sensor's and the cover's history."""
        return self.solver.simulate(t, *self.sensor.simulate(t, readings, motion))


FRICTION = 0.5
"""Coefficient that a load is expected to need, as a deviation of tan(angle between F and n)."""


class UncertainContact(NamedTuple):
    """A contact, and those that each draw would have told instead: arrays (draws, ...)."""

    contact: Contact
    draws: Contact

    @property
    def covariance(self) -> Float[Array, "*contacts 3 3"]:
        """Of P^e, m^2, about the mean of the draws that found the same surface as the contact itself.

        Infinite where fewer than two did.
        """
        same = (self.draws.surface == self.contact.surface[None]) & (self.contact.surface > 0)[None]
        count = same.sum(0).astype(self.contact.point.dtype)
        point = jnp.where(same[..., None], self.draws.point, 0)
        mean = point.sum(0) / jnp.maximum(count, 1)[..., None]
        off = jnp.where(same[..., None], point - mean[None], 0)
        squares = jnp.einsum("d...i,d...j->...ij", off, off)
        known = (count > 1)[..., None, None]
        return jnp.where(known, squares / jnp.maximum(count - 1, 1)[..., None, None], jnp.inf)

    @property
    def probability(self) -> Float[Array, "*contacts"]:
        """Part of the draws that found the surface that the contact tells."""
        return (self.draws.surface == self.contact.surface[None]).mean(0)


class Alternative(NamedTuple):
    """A surface that one wrench may have touched: its number, how probable, and the mean P^e there, m."""

    surface: int
    probability: float
    point: Float[np.ndarray, "3"]


class UncertainArmor(eqx.Module):
    """An armor with uncertain parameters, represented by draws, and with noise on its readings.

    Draw d adds its own error to all readings of a record, because what a sensor is off by hardly changes in
    a press, and solves with its own sensor and cover. Its cover is thicker by e_d, of standard deviation
    `scatter`, which is constant throughout a record: P^e moves by e_d F / F_n along the line of action. The
    spread of the draws is the uncertainty of the contact.

    **Arguments:**

    - `armor`: its contact is the estimate.
    - `draws`: the same with a leading axis on what differs, such as `Calibration.draws(200)` or
      `Posterior.model`.
    - `noise` (6,), N and N m: standard deviation of the error of the readings of a press.
    - `scatter`, m: standard deviation of the cover from place to place.
    - `seed`: of noise and scatter.

    **Example:**

        >>> offset = lambda each: each.solver.cover.compensator.b
        >>> draws = eqx.tree_at(offset, armor, jnp.array([6.0, 6.2, 6.4]))
        >>> uncertain = compensate.internal.UncertainArmor(armor, draws, np.full(6, 0.01))
        >>> uncertain.solve([0.0, 0.0, -10.0, 0.0, 0.0, 0.0]).draws.point.shape
        (3, 3)
    """

    armor: Armor
    draws: Armor
    noise: Float[Array, "6"] = parameter(fixed=True)
    scatter: Scalar = parameter(0.0, unit="m", fixed=True)
    seed: int = eqx.field(default=0, static=True)

    def solve(self, readings: ArrayLike, motion: Motion = AT_REST) -> UncertainContact:
        """The contacts behind readings (..., 6), each by itself, as `Armor.solve`."""
        readings = jnp.asarray(readings, float)
        motion = motion.of(readings)
        found = self.armor.solve(readings, motion)
        return UncertainContact(found, _spread(self, None, readings, motion))

    def simulate(
        self, t: ArrayLike | None, readings: ArrayLike, motion: Motion = AT_REST
    ) -> UncertainContact:
        """The contacts of a stream of readings (samples, 6), with history, as `Armor.simulate`."""
        readings = jnp.asarray(readings, float)
        t, motion = jnp.asarray(t, readings.dtype), motion.of(readings)
        found = self.armor.simulate(t, readings, motion)
        return UncertainContact(found, _spread(self, t, readings, motion))

    def alternatives(self, reading: ArrayLike, friction: float = FRICTION) -> list[Alternative]:
        """All that one reading (6,) may mean, the most probable first; nothing where nothing is touched.

        A line of action may cross several surfaces, and no noise tells which: each draw's vote is divided
        among the surfaces that hold their points, by exp(-tan^2 / (2 friction^2)) of the angle between F
        and n, for a load at a slant needs friction. Where none holds its point, it goes to the nearest.
        """
        found, weight = _votes(self, jnp.asarray(reading, float), jnp.asarray(friction, float))
        surface, share = np.asarray(found.surface).ravel(), np.asarray(weight).ravel()
        point = np.asarray(found.point).reshape(-1, 3)
        listed = []
        for k in np.unique(surface[share > 0]):
            mine = np.where(surface == k, share, 0)
            mean = mine @ point / mine.sum()
            listed.append(Alternative(int(k), float(mine.sum()) / len(weight), mean))
        return sorted(listed, key=lambda one: -one.probability)

    def keys(self) -> Key[Array, " draws"]:
        """One for each draw."""
        pairs = zip(jax.tree.leaves(self.armor), jax.tree.leaves(self.draws), strict=True)
        count = next((new.shape[0] for old, new in pairs if new.ndim > old.ndim), 1)
        return jax.random.split(jax.random.key(self.seed), count)

    def axes(self) -> PyTree:
        """Which leaves of `draws` have the leading axis, for `vmap`."""
        return jax.tree.map(
            lambda old, new: 0 if jnp.ndim(new) > jnp.ndim(old) else None, self.armor, self.draws
        )


@eqx.filter_jit
def _spread(uncertain: UncertainArmor, t: Array | None, readings: Array, motion: Motion) -> Contact:
    def one(armor: Armor, key: Key[Array, ""]) -> Contact:
        of_noise, of_scatter = jax.random.split(key)
        noise = uncertain.noise * jax.random.normal(of_noise, (6,), readings.dtype)
        seen = readings + jnp.broadcast_to(noise, readings.shape)
        deeper = uncertain.scatter * jax.random.normal(of_scatter, ())
        contact = armor.solve(seen, motion) if t is None else armor.simulate(t, seen, motion)
        force = armor.sensor.read(seen, motion).force
        along = jnp.where(contact.normal_force > 0, contact.normal_force, jnp.inf)
        ahead = force / along[..., None]
        return contact._replace(
            point=contact.point + deeper * ahead, displacement=contact.displacement + deeper
        )

    return eqx.filter_vmap(one, in_axes=(uncertain.axes(), 0))(uncertain.draws, uncertain.keys())


@eqx.filter_jit
def _votes(uncertain: UncertainArmor, reading: Array, friction: Array) -> tuple[Contact, Array]:
    def one(armor: Armor, key: Key[Array, ""]) -> tuple[Contact, Array]:
        seen = reading + jax.random.normal(key, reading.shape) * uncertain.noise
        wrench = armor.sensor.read(seen)
        found = armor.solver.candidates(wrench.force, wrench.moment)
        pushed = (found.status == int(ContactStatus.OK)) & (found.normal_force > 0)
        holds = pushed & (found.outside <= 0)
        square = jnp.sum(wrench.force**2)
        slant = square / jnp.where(pushed, found.normal_force, 1) ** 2 - 1
        weight = jnp.where(holds, jnp.exp(-slant / (2 * friction**2)), 0)
        nearest = jnp.arange(len(weight)) == 0  # the first listed is the likeliest
        weight = jnp.where(holds.any(), weight, jnp.where(nearest & pushed, 1.0, 0.0))
        return found, weight / jnp.maximum(weight.sum(), jnp.finfo(weight.dtype).tiny)

    return eqx.filter_vmap(one, in_axes=(uncertain.axes(), 0))(uncertain.draws, uncertain.keys())
