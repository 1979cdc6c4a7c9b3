"""From the readings of a force sensor to the wrench that the load exerts at P_o."""

from collections.abc import Sequence
from itertools import combinations
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, Scalar, parameter
from hysteresis._law_model import once
from hysteresis._parameter import array_module, as_float, is_concrete

from .._contract import AbstractCompensator, in_few_lengths
from .._invert import invert
from .._readings import latest_of
from ..runtime._contact import ContactStatus

GRAVITY = 9.80665
"""m/s^2."""

Values = Float[Array, "..."] | Any
"""Numbers, kept as an array."""


TRAVELS = (0.02, 0.06, 0.2)
"""Parts of full scale over which a joint may begin to slip."""


class Wrench(NamedTuple):
    """What the load exerts: force (..., 3), N; moment (..., 3) about P_o, N m; and a `ContactStatus`, OK,
    INVALID or SATURATED. `ContactSolver.solve(*wrench)` takes all three."""

    force: Float[Array, "*samples 3"]
    moment: Float[Array, "*samples 3"]
    doubt: Int[Array, "*samples"]


class Motion(NamedTuple):
    """How the shell moves, (..., 3) each in the shell's axes: acceleration of P_o without gravity, m/s^2;
    the direction in which gravity pulls, m/s^2; angular velocity, rad/s; angular acceleration, rad/s^2.

    **Example:**

        >>> compensate.armor.Motion(acceleration=(0.5, 0.0, 0.0)).gravity
        (0.0, 0.0, -9.80665)
    """

    acceleration: Any = 0.0
    gravity: Any = (0.0, 0.0, -GRAVITY)
    velocity: Any = 0.0
    angular_acceleration: Any = 0.0

    def of(self, readings: Float[Array, "*samples 6"]) -> "Motion":
        """One for each of some readings."""
        shape, kind = (*readings.shape[:-1], 3), readings.dtype
        each = ((array_module(v), v) for v in self)
        return Motion(*(xp.broadcast_to(xp.asarray(v, kind), shape) for xp, v in each))


AT_REST = Motion()


class WristState(NamedTuple):
    """The low-pass: its last wrench (6,), the time of that (NaN before the first), the plays' states, the
    slip's."""

    held: Array
    time: Array
    channels: Any
    slip: Any


class SlipState(NamedTuple):
    """The stops (directions, travels), and the combinations (directions,) of the last reading."""

    stop: Array
    last: Array


class Slip(eqx.Module):
    """What slipping joints leave in the readings w of a force sensor:

        correction_i = full_i sum_jk W_ijk s_jk/r_k,    s_jk follows u_j as a stop of travel r_k does
        u_j = sum_i B_ji w_i/full_i

    The beams of a sensor are clamped, and a clamp slips by the load on it, which is a combination of the
    axes: plays of each axis by itself cannot undo that. The axes, and the sum and the difference of every
    two of them, are taken as combinations, without knowledge of how the sensor is built.

    **Arguments:**

    - `full_scale` (6,), N and N m: ratings, from the data sheet.
    - `weights` (6, combinations, travels): W. `travels`: r, as parts of full scale.

    **Example:**

        >>> slip = compensate.internal.Slip(np.full(6, 50.0))
        >>> slip.weights.shape
        (6, 36, 3)
    """

    full_scale: Values = parameter(fixed=True, meaning="ratings of the six axes")
    weights: Values = parameter(None, fixed=True, meaning="of the stops")
    travels: Values = parameter(TRAVELS, fixed=True, meaning="of the stops, of full scale")

    def __post_init__(self) -> None:
        if self.weights is None:
            self.weights = np.zeros((6, len(combined_axes()), np.size(self.travels)))

    def __check_init__(self) -> None:
        shape = (6, len(combined_axes()), len(self.travels))
        if self.full_scale.shape != (6,) or self.weights.shape != shape:
            raise InputError(
                "wrong-shape",
                f"full_scale has the shape {self.full_scale.shape}, weights {self.weights.shape}.",
                fix=f"give (6,) and {shape}.",
            )

    def init(self) -> SlipState:
        """The state of a sensor that was zeroed after a rest."""
        combined = jnp.zeros(len(combined_axes()))
        return SlipState(jnp.zeros(self.weights.shape[1:]), combined)

    def stops(self, readings: ArrayLike) -> Float[Array, "samples stops"]:
        """s/r of a record of readings (samples, 6) that begins at rest."""
        readings = jnp.asarray(readings, float)
        _, found = self.follow(self.init(), readings, jnp.ones(len(readings), bool))
        return found.reshape(len(readings), -1)

    def corrections(self, stops: Float[Array, "samples directions travels"]) -> Array:
        """What to add to the readings (samples, 6), N and N m, for such s/r."""
        return self.full_scale[None] * jnp.einsum("ijk,sjk->si", self.weights, stops)

    @eqx.filter_jit
    def follow(
        self, state: SlipState, readings: Float[Array, "samples 6"], usable: Bool[Array, " samples"]
    ) -> tuple[SlipState, Float[Array, "samples directions travels"]]:
        """The state after readings without their bias, and s/r of each; one that is not usable changes
        nothing."""

        def one(state: SlipState, row: tuple[Array, Array]) -> tuple[SlipState, Array]:
            now = jnp.where(row[1], row[0], state.last)
            moved = state.stop + (now - state.last)[:, None]
            stop = jnp.clip(moved, -self.travels[None], self.travels[None])
            return SlipState(stop, now), stop / self.travels[None]

        combined = (readings / self.full_scale[None]) @ jnp.asarray(combined_axes()).T
        return jax.lax.scan(one, state, (combined, usable))


def combined_axes() -> Float[np.ndarray, "combinations 6"]:
    """B: the six axes, and the sum and the difference of every two."""
    one = np.eye(6)
    pairs = [one[i] + sign * one[j] for i, j in combinations(range(6), 2) for sign in (1, -1)]
    return np.array([*one, *pairs])


SHAPES = {
    "matrix": (6, 6), "bias": (6,), "range": (6,), "rotation": (3, 3), "inertia": (3, 3),
    "offset": (3,), "turn": (3,), "centre": (3,),
}  # fmt: skip


class WristSensor(eqx.Module):
    """A six-axis force sensor under a shell. Its reading w = (F, M), N and N m, says of the load

        v = p(C (w - bias) + slip)           C: calibration;  p: each axis's hysteresis undone
        F_s, M_s = sign v                    sign = -1 for a sensor that reports reactions
        F_l = R F_s,     M_l = R M_s + r x F_l               the sensor stands at r from P_o, turned by R
        F   = F_l - m (g - a_c),     M = M_l - c x m (g - a_c) + I alpha + omega x I omega

    with the weight m of all that the sensor carries, its centre c and its inertia I about c, where the
    shell accelerates: a_c = a + alpha x c + omega x (omega x c). At rest only m g is left, which a bias
    taken in one pose holds already: give either.

    **Arguments:**

    - `matrix` (6, 6): C, from readings in (N, N m) to wrenches.
    - `bias` (6,): the reading without load.
    - `rotation` (3, 3), `offset` (3,), m: R, from the sensor's axes to the shell's, and r, in the shell's.
    - `turn` (3,), rad: a small turn about the shell's axes after R, for a calibration to find.
    - `reports`: what the reading is: "load", what the load exerts on the shell; or "reaction", what the
      sensor exerts on it. The paper's text calls its moment a reaction, and its equations use the load's.

    **Other arguments:**

    - `range` (6,): readings at or beyond it, N and N m, are SATURATED.
    - `mass`, kg, `centre` (3,), m, `inertia` (3, 3), kg m^2: of all that the sensor carries.
    - `time_constant`, s: of a low-pass, for the vibration of the arm that carries it; 0: none.
    - `hysteresis`: six models from true to shown value, one per axis, undone in a stream; None: none.
    - `slip`: a `Slip`, which corrects streams for the hysteresis of joints; see `with_slip`.

    Raises `InputError` where R is no rotation, a shape is wrong, or the matrix cannot be inverted.

    **Example:**

        >>> wrench = compensate.armor.WristSensor().read([1.0, 2.0, 3.0, 0.0, 0.0, 0.0])
        >>> wrench.force.tolist()
        [1.0, 2.0, 3.0]
    """

    matrix: Values = parameter(None, meaning="calibration of the wrench")
    bias: Values = parameter(0.0, meaning="reading without load")
    rotation: Values = parameter(None, fixed=True, meaning="from the sensor's axes to the shell's")
    offset: Values = parameter(0.0, unit="m", meaning="from P_o to the sensor")
    turn: Values = parameter(0.0, unit="rad", meaning="small turn after that rotation")
    range: Values = parameter(float("inf"), fixed=True, meaning="end of each channel's range")
    mass: Scalar = parameter(0.0, unit="kg", meaning="of all that the sensor carries")
    centre: Values = parameter(0.0, unit="m", meaning="centre of that mass, from P_o")
    inertia: Values = parameter(None, unit="kg m^2", meaning="about that centre")
    time_constant: Scalar = parameter(0.0, unit="s", fixed=True, meaning="of the low-pass")
    hysteresis: Sequence[AbstractModel] | None = eqx.field(
        default=None, converter=lambda given: given if given is None else tuple(given)
    )
    slip: Slip | None = None
    reports: str = eqx.field(default="load", static=True)

    def __post_init__(self) -> None:
        whole = {"matrix": np.eye(6), "rotation": np.eye(3), "inertia": np.zeros((3, 3))}
        for name, shape in SHAPES.items():
            value = getattr(self, name)
            if name in whole:
                value = as_float(whole[name]) if value is None else value
            elif np.ndim(value) == 0:
                value = jnp.full(shape, value)
            setattr(self, name, value)

    def __check_init__(self) -> None:
        if self.reports not in ("load", "reaction"):
            raise InputError(
                "bad-option", f"a sensor that reports {self.reports!r}.",
                fix="load: what touches the shell exerts; reaction: what holds the shell exerts.",
            )  # fmt: skip
        if self.hysteresis is not None and len(self.hysteresis) != 6:
            raise InputError(
                "wrong-shape", f"{len(self.hysteresis)} models of hysteresis for six channels.",
                fix="one for each of Fx, Fy, Fz, Mx, My, Mz.",
            )  # fmt: skip
        for name, shape in SHAPES.items():
            if (found := jnp.shape(getattr(self, name))) != shape:
                said = f"the sensor's {name} has the shape {found}."
                raise InputError("wrong-shape", said, fix=f"give {shape}.")
        if is_concrete(self.rotation):
            self._check_rotation(np.asarray(self.rotation))
        if is_concrete(self.matrix) and not np.linalg.cond(np.asarray(self.matrix)) < 1e6:
            raise InputError(
                "not-invertible", "the sensor's matrix cannot be inverted: a direction is lost.",
                fix="calibrate with loads in all six directions.",
            )  # fmt: skip

    def _check_rotation(self, rotation: np.ndarray) -> None:
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4):
            raise InputError(
                "not-a-rotation", "the sensor's rotation is none: its axes are not of length 1 and square.",
                cause="angles instead of a matrix, or frames mixed.",
                fix="scipy.spatial.transform.Rotation.from_euler(...).as_matrix().",
            )  # fmt: skip
        if np.linalg.det(rotation) < 0:
            raise InputError(
                "not-a-rotation", "the sensor's rotation is a mirror: left-handed axes.",
                cause="an axis counted backwards in one of the frames.", fix="reverse one column.",
            )  # fmt: skip

    def read(self, readings: ArrayLike, motion: Motion = AT_REST) -> Wrench:
        """The load's wrenches behind readings (..., 6), one by one: no low-pass, no hysteresis undone."""
        readings = self._readings(readings)
        return self._wrench(readings, self._calibrated(readings), motion)

    def init(self) -> WristState:
        """The state before the first reading."""
        plays = tuple(inverse.init() for inverse in self._inverses)
        none = jnp.full((6,), jnp.nan, self.matrix.dtype)
        return WristState(none, none[0], plays, () if self.slip is None else self.slip.init())

    def step(
        self, state: WristState, t: ArrayLike | None, reading: ArrayLike, motion: Motion = AT_REST
    ) -> tuple[WristState, Wrench]:
        """One reading of a stream, at the time `t` in s.

        A reading that is not finite is INVALID: the last wrench is held, and nothing else changes.
        """
        times = jnp.asarray(t, self.matrix.dtype)[None]
        after, found = self.stream(times, self._readings(reading)[None], motion, state)
        return after, Wrench(*(x[0] for x in found))

    def simulate(
        self, t: ArrayLike | None, readings: ArrayLike, motion: Motion = AT_REST
    ) -> Wrench:
        """`step` over all readings (samples, 6); each of `motion` is (samples, 3), or one for all."""
        return self.stream(t, readings, motion, self.init())[1]

    def stream(
        self, t: ArrayLike | None, readings: ArrayLike, motion: Motion, state: WristState
    ) -> tuple[WristState, Wrench]:
        """All readings at once: the state after them, and the wrenches."""
        readings = self._readings(readings)
        t, motion = jnp.asarray(t, readings.dtype), motion.of(readings)
        return in_few_lengths(WristSensor._followed, self, state, t, readings, motion)

    def _followed(
        self, state: WristState, t: Array, readings: Array, motion: Motion
    ) -> tuple[WristState, Wrench]:
        sound = self._calibrated(readings)
        now = self._wrench(readings, sound, motion)
        usable = (now.doubt != int(ContactStatus.INVALID)) & jnp.isfinite(t)
        slip, channels = state.slip, []
        if self.slip is not None:
            slip, stops = self.slip.follow(slip, readings - self.bias[None], usable)
            sound = sound + self.slip.corrections(stops)
        if self.hysteresis is not None:
            seen = jnp.where(usable[:, None], sound, jnp.nan)
            # The time of the last reading, before the first one its own.
            at = latest_of(usable)
            clock = t[jnp.where(at < 0, jnp.argmax(usable), at)]
            axes = zip(self._inverses, state.channels, seen.T, strict=True)
            each = [inverse.stream(clock, y, own) for inverse, own, y in axes]
            channels = [own for own, _ in each]
            sound = jnp.stack([found.value for _, found in each], 1)
        if self.slip is not None or self.hysteresis is not None:
            now = self._wrench(readings, sound, motion)
        whole = jnp.concatenate([now.force, now.moment], 1)
        (held, time), slow = _slowed(
            self.time_constant, (state.held, state.time), (whole, t, usable)
        )
        told = jnp.where(jnp.isnan(slow), 0, slow)
        doubt = jnp.where(usable, now.doubt, int(ContactStatus.INVALID))
        after = WristState(held, time, tuple(channels), slip)
        return after, Wrench(told[:, :3], told[:, 3:], doubt)

    def reading_of(self, force: ArrayLike, moment: ArrayLike) -> Float[Array, "*samples 6"]:
        """The readings at rest that loads (..., 3) make: `read` run backwards."""
        return self._shown(self.carried(force, moment))

    def respond(self, force: ArrayLike, moment: ArrayLike) -> Float[Array, "samples 6"]:
        """The readings at rest of a record of loads (samples, 3): `simulate` backwards, without slip."""
        sound = self.carried(force, moment)
        if self.hysteresis is not None:
            axes = (m.simulate(None, y) for m, y in zip(self.hysteresis, sound.T, strict=True))
            sound = jnp.stack(list(axes), axis=1)
        return self._shown(sound)

    def carried(self, force: ArrayLike, moment: ArrayLike) -> Float[Array, "*samples 6"]:
        """Of loads what the sensor carries at rest, in its own axes and sign."""
        force = jnp.asarray(force, self.matrix.dtype)
        moment = jnp.asarray(moment, self.matrix.dtype)
        weight = self.mass * jnp.asarray(AT_REST.gravity, self.matrix.dtype)
        force = force + _along(weight, force)
        moment = moment + _along(jnp.cross(self.centre, weight), moment)
        moment = moment - jnp.cross(_along(self.offset, force), force)
        turned = [v @ self.turned() for v in (force, moment)]
        return jnp.concatenate(turned, axis=-1) * (1 if self.reports == "load" else -1)

    def _shown(self, sound: Array) -> Array:
        readings = sound @ jnp.linalg.inv(self.matrix).T
        return readings + _along(self.bias, readings)

    def turned(self) -> Float[Array, "3 3"]:
        """From the sensor's axes to the shell's: the turn, whose angle is 2 atan(|turn| / 2), after R."""
        x, y, z = self.turn / 2
        zero = jnp.zeros_like(x)
        skew = jnp.stack([jnp.stack(row) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))])
        turn = jnp.eye(3, dtype=x.dtype) + 2 / (1 + x * x + y * y + z * z) * (skew + skew @ skew)
        return turn @ self.rotation

    def _readings(self, readings: Any) -> Array:
        readings = jnp.asarray(readings, self.matrix.dtype)
        if readings.shape[-1:] != (6,):
            raise InputError(
                "wrong-shape", f"readings of shape {readings.shape} are no wrenches.",
                fix="give (..., 6): Fx, Fy, Fz, Mx, My, Mz.",
            )  # fmt: skip
        return readings

    def _calibrated(self, readings: Array) -> Array:
        return (readings - _along(self.bias, readings)) @ self.matrix.T

    @once
    def _inverses(self) -> tuple[AbstractCompensator, ...]:
        return tuple(map(invert, self.hysteresis or ()))

    @eqx.filter_jit
    def _wrench(self, readings: Array, sound: Array, motion: Motion) -> Wrench:
        sound = sound * (1 if self.reports == "load" else -1)
        rotation = self.turned().T
        force, moment = sound[..., :3] @ rotation, sound[..., 3:] @ rotation
        moment = moment + jnp.cross(_along(self.offset, force), force)
        acceleration, gravity, velocity, spin = motion.of(readings)
        centre, inertia = _along(self.centre, force), self.inertia.T
        middle = acceleration + jnp.cross(spin, centre)
        middle = middle + jnp.cross(velocity, jnp.cross(velocity, centre))
        weight = self.mass * (gravity - middle)
        swung = spin @ inertia + jnp.cross(velocity, velocity @ inertia)
        force, moment = force - weight, moment - jnp.cross(centre, weight) + swung
        finite = jnp.isfinite(readings).all(axis=-1) & jnp.isfinite(force + moment).all(axis=-1)
        saturated = (jnp.abs(readings) >= _along(self.range, readings)).any(axis=-1)
        doubt = jnp.where(saturated, int(ContactStatus.SATURATED), int(ContactStatus.OK))
        return Wrench(force, moment, jnp.where(finite, doubt, int(ContactStatus.INVALID)))


@eqx.filter_jit
def _slowed(time_constant: Any, state: Any, rows: tuple[Array, Array, Array]) -> Any:
    """The low-pass over wrenches (samples, 6) at their times, where they are usable."""

    def one(own: tuple[Array, Array], row: tuple[Array, Array, Array]) -> Any:
        (held, time), (whole, t, usable) = own, row
        dt = jnp.where(jnp.isnan(time), jnp.inf, jnp.maximum(t - time, 0))
        slow, first = time_constant > 0, jnp.isnan(held)
        part = jnp.where(slow, -jnp.expm1(-dt / jnp.where(slow, time_constant, 1)), 1)
        moved = held + part * (whole - jnp.where(first, 0, held))
        held = jnp.where(usable, jnp.where(first, whole, moved), held)
        return (held, jnp.where(usable, t, time)), held

    return jax.lax.scan(one, state, rows)


def _along(values: Array, beside: Array) -> Array:
    """Components beside arrays (..., components)."""
    return jnp.broadcast_to(values, beside.shape)
