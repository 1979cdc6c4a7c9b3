"""Residuals of presses at known points, for the calibration of sensor, shell and cover."""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import ArrayLike

from hysteresis import InputError, Scalar, parameter
from hysteresis._parameter import as_float

from ._armor import Armor
from ._shapes import dots
from ._wrench import AT_REST, Slip, combined_axes

MATRIX, HYSTERESIS = 0.03, 0.01
"""Prior deviation of an entry of the matrix, and the hysteresis of the data sheet, of full scale."""

FIRST_NOISE, LEAST_NOISE = 1e-3, 1e-9
"""Parts of full scale."""


class Presses(eqx.Module):
    """Presses with a gauge at known points, each from rest.

    **Arguments:**

    - `time` (samples,), in the unit of the cover's model, or (presses, samples).
    - `readings` (presses, samples, 6): of the force sensor.
    - `force` (presses, samples), N: of the gauge, along `direction` (presses, 3), which is of length 1 and
      points inwards.
    - `touched` (presses, 3), m: P^i, on the undeformed surface. `surface` (presses,): its number, from 1.
    - `displacement` (presses, samples), m: d_n, where it was measured; None where not.
    - `gravity` (presses, samples, 3), m/s^2: in the shell's axes, where poses differ, for a sensor whose
      mass is known; by default down the shell's z.

    Raises `InputError` where shapes do not agree, a number is not finite, time goes back, or a direction is
    not of length 1.
    """

    time: Float[Array, "*presses samples"] = eqx.field(converter=as_float)
    readings: Float[Array, "*presses samples 6"] = eqx.field(converter=as_float)
    force: Float[Array, "*presses samples"] = eqx.field(converter=as_float)
    direction: Float[Array, "*presses 3"] = eqx.field(converter=as_float)
    touched: Float[Array, "*presses 3"] = eqx.field(converter=as_float)
    surface: Int[Array, "*presses"] = eqx.field(converter=jnp.asarray)
    displacement: Float[Array, "*presses samples"] | None = eqx.field(
        default=None, converter=as_float
    )
    gravity: Float[Array, "*presses samples 3"] | None = eqx.field(default=None, converter=as_float)

    def __post_init__(self) -> None:
        if np.ndim(self.force) == 2:
            self.time = jnp.broadcast_to(as_float(self.time), np.shape(self.force))

    def __check_init__(self) -> None:
        if self.force.ndim != 2:
            raise _fault(f"force has the shape {self.force.shape}.", "give (presses, samples).")
        presses, samples = self.force.shape
        shapes = {
            "time": (samples,), "force": (samples,), "readings": (samples, 6), "direction": (3,),
            "touched": (3,), "surface": (), "displacement": (samples,), "gravity": (samples, 3),
        }  # fmt: skip
        for name, shape in shapes.items():
            if (given := getattr(self, name)) is None:
                continue
            if given.shape != (presses, *shape):
                raise _fault(f"{name} has the shape {given.shape}.", f"give {(presses, *shape)}.")
            if not np.isfinite(given).all():
                raise _fault(f"{name} is not finite everywhere.", "leave such presses out.")
        if (np.diff(self.time) < 0).any():
            raise _fault("time goes back within a press.", "sort the rows of each press by time.")
        if not np.allclose(np.linalg.norm(self.direction, axis=1), 1, atol=1e-6):
            raise _fault("a direction is not of length 1.", "divide it by its length.")


def planned_presses(
    armor: Armor,
    time: ArrayLike,
    force: ArrayLike,
    direction: ArrayLike,
    touched: ArrayLike,
    surface: ArrayLike,
) -> Presses:
    """Presses that were not made: what the given armor would read, and how deep its cover would be pressed.

    `hysid.choose_presses` chooses among them, and so does `identify.internal.choose`.

    **Arguments:** `armor`, and those of `Presses`.

    **Returns:** the `Presses`, with the computed readings and displacements.

    **Raises:** `InputError` as `Presses` does.

    **Example:**

        >>> at, down = box.centres()[:1], [[0.0, 0.0, -1.0]]
        >>> made = compensate.armor.planned_presses(armor, [0.0, 1.0], [[5.0, 10.0]], down, at, [1])
        >>> made.readings.shape
        (1, 2, 6)
    """
    samples = np.shape(force)
    silent = Presses(
        time, np.zeros((*samples, 6)), force, direction, touched, surface, np.zeros(samples)
    )
    return _planned(armor, silent)


@eqx.filter_jit
def _planned(armor: Armor, presses: Presses) -> Presses:
    def one(press: Presses) -> Presses:
        normal = _normal(armor, press)
        depth = _modelled(armor, press, normal)
        readings = armor.sensor.respond(*_load(press, normal, depth))
        return eqx.tree_at(lambda p: (p.readings, p.displacement), press, (readings, depth))

    return jax.vmap(one)(presses)


class PressResiduals(eqx.Module):
    """Residuals of an armor in presses, in standard deviations of their noise, a row for each press:

        (F, M)(reading) - (f u, P^e x f u)        over `noise`,        P^e = P^i + d_n n
        f_k(P^i)                                  over `place`
        d_n(f u.n) - d                            where d was measured

    Each press has a constant error of d, of deviation `scatter`, because the cover is uneven; each sample
    has one of deviation `reading`. S samples with the residuals e and their mean m give
    (e - m)/reading + m/sqrt(S scatter^2 + reading^2), which are independent. Samples below the contact
    threshold are excluded from the residuals of d.

    A residual function for `identify.internal.calibrate`.

    **Arguments:**

    - `noise` (6,), N and N m: of one sample of a wrench; `with_noise_left` estimates it from the residuals.
    - `place`, `scatter`, `reading`, m.
    """

    presses: Presses
    noise: Float[Array, "6"]
    place: Scalar = parameter(1e-3, unit="m", fixed=True)
    scatter: Scalar = parameter(1e-3, unit="m", fixed=True)
    reading: Scalar = parameter(2e-4, unit="m", fixed=True)

    def __call__(self, armor: Armor) -> Float[Array, "presses residuals"]:
        def one(press: Presses) -> Array:
            missed = missed_of(armor, press)
            found = [(missed.wrench / self.noise[None]).ravel(), missed.height[None] / self.place]
            if missed.depth is not None:
                rest = jnp.where(missed.told, missed.depth - missed.mean, 0) / self.reading
                count = jnp.sum(missed.told).astype(rest.dtype)
                common = missed.mean / jnp.sqrt(count * self.scatter**2 + self.reading**2)
                found.append(rest + jnp.where(missed.told, common, 0))
            return jnp.concatenate(found)

        return jax.vmap(one)(self.presses)

    def with_noise_left(self, armor: Armor) -> "PressResiduals":
        """The same with the deviations that an armor leaves of presses: of the wrenches in each channel, of
        d from press to press and from sample to sample; those stay that nothing was measured of."""
        missed = jax.vmap(lambda press: missed_of(armor, press))(self.presses)
        noise = jnp.sqrt(jnp.mean(missed.wrench**2, axis=(0, 1)))
        if missed.depth is None:
            return replace(self, noise=noise)
        rest = jnp.where(missed.told, missed.depth - missed.mean[:, None], 0)
        squares = jnp.mean(missed.mean**2), jnp.sum(rest**2) / missed.told.sum().astype(rest.dtype)
        # What agrees to better than this agrees by chance.
        scatter, reading = (jnp.maximum(jnp.sqrt(square), 1e-5) for square in squares)
        return replace(self, noise=noise, scatter=scatter, reading=reading)


class Missed(NamedTuple):
    """What an armor misses of one press: (F, M), the height of P^i, and d where it is `told`."""

    wrench: Float[Array, "samples 6"]
    height: Float[Array, ""]
    depth: Float[Array, " samples"] | None
    told: Bool[Array, " samples"]
    mean: Float[Array, ""]


@eqx.filter_jit
def loads_of(armor: Armor, presses: Presses) -> tuple[Array, Array]:
    """Forces and moments about P_o (presses, samples, 3) that the gauge exerted: N, N m."""

    def one(press: Presses) -> tuple[Array, Array]:
        normal, depth = _normal(armor, press), press.displacement
        depth = _modelled(armor, press, normal) if depth is None else depth
        return _load(press, normal, depth)

    return jax.vmap(one)(presses)


def with_slip(armor: Armor, presses: Presses, full_scale: ArrayLike, rounds: int = 3) -> Armor:
    """An armor whose sensor's matrix and slip were found from presses, by ridge regression.

    For each axis the true load less the reading is a sum of the six readings and the stops, linear in its
    weights. A priori an entry of the matrix is off by 3 per cent, and all stops together by half of the
    1 per cent of hysteresis that data sheets promise. The noise is that of what is left, from the second
    round on. `calibrate_armor` improves the matrix afterwards, together with the cover.

    **Arguments:** the armor, the presses with their gauge, the ratings (6,) of the sensor's data sheet.

    **Raises:** `InputError` if the armor's sensor has other plays already.

    **Example:**

        >>> found = compensate.internal.with_slip(armor, planned, np.repeat([50.0, 12.0], 3))
        >>> found.sensor.slip.weights.shape
        (6, 36, 3)
    """
    problem = _SlipProblem(armor, presses, full_scale)
    return problem.armor_of(np.ones(len(presses.surface), bool), rounds)


def without_each(
    armor: Armor, presses: Presses, full_scale: ArrayLike, rounds: int = 3
) -> list[Armor]:
    """For each press, what `with_slip` finds from the others."""
    problem, count = _SlipProblem(armor, presses, full_scale), len(presses.surface)
    return [problem.armor_of(np.arange(count) != k, rounds) for k in range(count)]


class _SlipProblem:
    """The ridge regression of `with_slip`: `known` columns (presses, samples, columns), what is `off`."""

    def __init__(self, armor: Armor, presses: Presses, full_scale: ArrayLike):
        sensor = armor.sensor
        if sensor.hysteresis is not None:
            raise InputError(
                "bad-option", "the sensor has a play on each axis already.",
                fix="give a WristSensor without hysteresis.",
            )  # fmt: skip
        self.armor, self.slip = armor, Slip(full_scale)
        self.full = np.asarray(self.slip.full_scale)
        readings = presses.readings - sensor.bias[None, None]
        force, moment = loads_of(armor, presses)
        wanted = np.asarray(sensor.carried(force, moment)) / self.full
        parts = np.asarray(readings) / self.full
        stops = np.asarray(jax.jit(jax.vmap(self.slip.stops))(readings))
        self.known = np.concatenate([parts, stops], axis=-1)
        each = HYSTERESIS / 2 / np.sqrt(len(combined_axes()))
        prior = [np.full(6, 1 / MATRIX), np.full(stops.shape[-1], 1 / each)]
        self.prior = np.concatenate(prior) ** 2
        self.off = wanted - parts @ (np.asarray(sensor.matrix) * self.full / self.full[:, None]).T

    def armor_of(self, some: Bool[np.ndarray, " presses"], rounds: int) -> Armor:
        """The armor that some of the presses give."""
        known = self.known[some].reshape(-1, self.known.shape[-1])
        off = self.off[some].reshape(-1, 6)
        noise, square = np.full(6, FIRST_NOISE), known.T @ known
        found = np.zeros((known.shape[1], 6))
        for _ in range(rounds):
            for k in range(6):
                normal = square / noise[k] ** 2 + np.diag(self.prior)
                found[:, k] = np.linalg.solve(normal, known.T @ off[:, k] / noise[k] ** 2)
            noise = np.maximum(np.std(off - known @ found, axis=0), LEAST_NOISE)
        full = self.full
        matrix = jnp.asarray(self.armor.sensor.matrix + found[:6].T * full[:, None] / full)
        weights = found[6:].T.reshape(self.slip.weights.shape)
        return eqx.tree_at(
            lambda a: (a.sensor.matrix, a.sensor.slip),
            self.armor,
            (matrix, Slip(full, weights)),
            is_leaf=lambda leaf: leaf is None,
        )


def missed_of(armor: Armor, press: Presses) -> Missed:
    """By how much the armor misses what was read of one press."""
    normal = _normal(armor, press)
    offset = armor.solver.shape.faces().offset[press.surface - 1]
    modelled = _modelled(armor, press, normal)
    measured = press.displacement
    motion = AT_REST if press.gravity is None else AT_REST._replace(gravity=press.gravity)
    found = armor.sensor.simulate(press.time, press.readings, motion)
    load = _load(press, normal, modelled if measured is None else measured)
    wrench = jnp.concatenate([found.force - load[0], found.moment - load[1]], axis=1)
    told = press.force >= armor.solver.threshold
    depth = None if measured is None else jnp.where(told, modelled - measured, 0)
    many = jnp.maximum(told.sum(), 1).astype(modelled.dtype)
    mean = jnp.zeros(()) if depth is None else depth.sum() / many
    return Missed(wrench, offset + dots(normal, press.touched), depth, told, mean)


def _normal(armor: Armor, press: Presses) -> Float[Array, "3"]:
    return armor.solver.shape.faces().normal[press.surface - 1]


def _load(press: Presses, normal: Array, depth: Array) -> tuple[Array, Array]:
    """Force and moment about P_o that the gauge exerts, (samples, 3)."""
    force = press.force[:, None] * press.direction[None]
    return force, jnp.cross(press.touched[None] + depth[:, None] * normal[None], force)


def _modelled(armor: Armor, press: Presses, normal: Array) -> Float[Array, " samples"]:
    """Indentation d_n of the cover at the pressed point, m."""
    cover, along = armor.solver.cover, press.force * dots(press.direction, normal)
    pressed = jax.lax.scan(
        lambda state, now: cover.press(state, *now)[:2], cover.init(), (press.time, along)
    )[1]
    return jax.vmap(lambda g, F: cover.displacement(g, F, press.surface, press.touched))(
        pressed, along
    )


def _fault(problem: str, fix: str) -> InputError:
    return InputError("bad-presses", problem, place="Presses", fix=fix)
