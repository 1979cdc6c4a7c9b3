"""Contacts in plain Python: the solver of `compensate.armor`, wrench by wrench."""

from collections.abc import Callable, Collection
from math import exp, inf, isfinite, isnan, nan, sqrt
from operator import mul
from typing import Any, NamedTuple

from hysteresis.laws._tree import Running, node_of

from . import _arithmetic as plain
from ._arithmetic import Arithmetic, Numbers, Real
from ._contact import NONE, ContactStatus, Limits, Solver, Touch, cross, dot, square, touched
from ._file import READING_MISSING, Written

KIND = "hysid armor"

Vector = tuple[float, float, float]
Field = Callable[[int, Vector], float]


class Motion(NamedTuple):
    """How the shell moves, in its own axes: acceleration of P_o without gravity, m/s^2; the direction in
    which gravity pulls, m/s^2; angular velocity, rad/s; angular acceleration, rad/s^2."""

    acceleration: Vector = (0.0, 0.0, 0.0)
    gravity: Vector = (0.0, 0.0, -9.80665)
    velocity: Vector = (0.0, 0.0, 0.0)
    angular_acceleration: Vector = (0.0, 0.0, 0.0)


class ArmorContact(NamedTuple):
    """As `compensate.armor.Contact`, of one wrench: m, N, N m."""

    point: Vector
    surface: int
    displacement: float
    status: ContactStatus
    spin: float
    normal: Vector
    normal_force: float
    outside: float


class _Face(NamedTuple):
    """As one of `compensate.armor.Faces`."""

    normal: list[float]
    offset: float
    edge: list[list[float]]
    limit: list[float]
    surface: int


class Armor:
    """Contacts on a robot under a soft cover, reading by reading, without JAX.

    `step` gives the results of `WristSensor.step` and `ContactSolver.step` in JAX, whose times are sums of
    `dt`, to 1e-9 m.
    """

    def __init__(self, document: dict[str, Any]):
        self.title: str = document["title"]
        self._faces = [
            _Face(normal, offset, [edge for edge, _ in sides], [end for _, end in sides], surface)
            for surface, (normal, offset, sides) in enumerate(document["faces"], start=1)
        ]
        given = (document["limits"][name] for name in Limits._fields)
        limits = Limits(*(inf if v is None else float(v) for v in given))
        cover = document["cover"]
        self._solver = Solver(plain, ArmorContact, _Cover(cover), limits, cover["turns"])
        self._sensor = _Sensor(document["sensor"]) if document["sensor"] else None
        self.reset()

    def reset(self) -> None:
        """As before the first reading."""
        if self._sensor:
            self._sensor.reset()
        none = ArmorContact(NONE, 0, 0.0, ContactStatus.NO_CONTACT, 0.0, NONE, 0.0, 0.0)
        self._now, virgin = 0.0, self._solver.cover.init()
        self._touch = Touch(False, 0, NONE, -inf, virgin, none)

    def step(
        self, dt: float, reading: Collection[float] | None = None, motion: Motion | None = None
    ) -> ArmorContact:
        """The contact from a reading (Fx, Fy, Fz, Mx, My, Mz), N and N m, `dt` seconds after the last one.

        The first `dt` does not matter, and one that is negative or not finite is none. Without a sensor in
        the file the reading is the load's wrench about P_o. A reading that is not finite changes nothing:
        the last contact is held, INVALID. `motion`: of the shell, whose weight and inertia the sensor of
        the file feels; None: at rest, gravity down the shell's z.

        Raises `TypeError` where `reading` is left out.
        """
        if reading is None:
            raise TypeError(READING_MISSING)
        if 0.0 < dt < inf:
            self._now += float(dt)
        t, doubt, reading = self._now, 0, [*map(float, reading)]
        if self._sensor:
            reading, doubt = self._sensor.wrench(t, reading, motion)
        fx, fy, fz, mx, my, mz = reading
        force, moment = (fx, fy, fz), (mx, my, mz)
        self._touch, contact = touched(
            self._solver, self._faces, self._touch, t, force, moment, doubt
        )
        return contact


class _Cover:
    """`compensate.armor.Cover` whose states are plain data."""

    def __init__(self, document: dict[str, Any]):
        self._tree, self._is_inverse = document["tree"], document["inverse"]
        self._scale: float = document["scale"]
        # Files of earlier versions have neither of the following.
        self._force_scale: float = document.get("force_scale", 1.0)
        self._time_scale: float = document.get("time_scale", 1.0)
        given = (document.get(key) for key in ("thickness", "most"))
        self.thickness, self._most = (inf if v is None else float(v) for v in given)
        self._factor, even = field(document["factor"])
        self._compliance, stiff = field(document["compliance"])
        self.is_even = even and stiff
        self._states: list[Any] = []
        self._node: Running | None = node_of(self._tree, self._states) if self._tree else None
        self._virgin = _copied(self._states), nan

    def init(self) -> Any:
        """What a place that was never touched remembers, and when a force was last there."""
        return self._virgin

    def press(self, state: Any, t: float, force: float) -> tuple[Any, float, bool]:
        """The state after a force, g(F_n) in metres, and whether that is beyond the fit."""
        if self._node is None:
            return state, 0.0, False
        states, since = state
        _put(self._states, states)
        move = self._node.find if self._is_inverse else self._node.move
        own, dt = self._force_scale * force, 0.0 if isnan(since) else t - since
        found = move(self._time_scale * dt, own)
        beyond = (found if self._is_inverse else own) > self._most
        return (_copied(self._states), t), self._scale * found, beyond

    def displacement(self, pressed: float, force: float, surface: int, point: Vector) -> float:
        """d_n of a surface at a point."""
        return self._factor(surface, point) * pressed + self._compliance(surface, point) * force


class _Sensor:
    """`compensate.armor.WristSensor` at rest: a linear map; with hysteresis that, and another one."""

    def __init__(self, document: dict[str, Any]):
        self._calibration, self._placement = map(
            _rows, (document["calibration"], document["placement"])
        )
        self._range = [inf if v is None else v for v in document["range"]]
        self._slow: float = document["time_constant"]
        self._trees = document["hysteresis"]
        # Files of earlier versions know no mass.
        self._mass: float = document.get("mass", 0.0)
        self._centre: Vector = tuple(document.get("centre", NONE))
        self._inertia: list[list[float]] = document.get("inertia", [[0.0] * 3] * 3)
        self._gravity: Vector = tuple(document.get("gravity", Motion().gravity))
        self.reset()

    def reset(self) -> None:
        """As before the first reading."""
        self._finds = [node_of(tree).find for tree in self._trees]
        self._held, self._time = [0.0] * 6, nan

    def wrench(
        self, t: float, reading: Collection[float], motion: Motion | None
    ) -> tuple[Collection[float], int]:
        """The load's wrench, and 0 or the status of a reading that is not to be trusted."""
        if not isfinite(sum(reading) + t + (0.0 if motion is None else sum(map(sum, motion)))):
            return self._held, ContactStatus.INVALID
        dt = 0.0 if isnan(self._time) else t - self._time
        wrench = _mapped(self._calibration, reading)
        if self._finds:
            wrench = [find(dt, y) for find, y in zip(self._finds, wrench, strict=True)]
            wrench = _mapped(self._placement, wrench)
        if motion is not None:
            wrench = [w + more for w, more in zip(wrench, self._beyond_rest(motion), strict=True)]
        if self._slow > 0 and not isnan(self._time):
            part = 1.0 - exp(-max(dt, 0.0) / self._slow)
            wrench = [h + part * (w - h) for h, w in zip(self._held, wrench, strict=True)]
        self._held, self._time = wrench, t
        over = any(abs(y) >= end for y, end in zip(reading, self._range, strict=True))
        return wrench, ContactStatus.SATURATED if over else 0

    def _beyond_rest(self, motion: Motion) -> list[float]:
        """What is added to the load's wrench because the shell is not at rest, see `WristSensor`."""
        acceleration, gravity, velocity, spin = motion
        centre, turned = self._centre, cross(velocity, cross(velocity, self._centre))
        off = [
            -self._mass * (g - rest - a - s - c)
            for g, rest, a, s, c in zip(
                gravity, self._gravity, acceleration, cross(spin, centre), turned, strict=True
            )
        ]
        whirled, swung = ([dot(row, v) for row in self._inertia] for v in (velocity, spin))
        more = zip(cross(centre, off), swung, cross(velocity, whirled), strict=True)
        return [*off, *(a + b + c for a, b, c in more)]


def field(document: dict[str, Any]) -> tuple[Field, bool]:
    """A field of the cover, and whether it is the same all over a surface."""
    kind = document["kind"]
    if kind == "uniform":
        value = document["value"]
        if isinstance(value, list):
            return lambda surface, point: value[surface - 1], True
        return lambda surface, point: value, True
    centre = document["centre"]
    if kind == "bumps":
        amplitude, width, base = (document[name] for name in ("amplitude", "width", "base"))

        def bumps(surface: int, point: Vector) -> float:
            k = surface - 1
            return bump(plain, base[k], amplitude[k], width, centre[k], point)

        return bumps, False
    raise ValueError(f"no field {kind!r}")


def bump(
    o: Arithmetic, base: Real, amplitude: Real, width: Real, centre: Numbers, point: Numbers
) -> Real:
    """`compensate.armor.Bumps` on one surface."""
    return base + amplitude * o.exp(-square(point, centre) / (2 * width * width))


def _rows(affine: dict[str, Any] | None) -> list[Any]:
    return list(zip(affine["matrix"], affine["constant"], strict=True)) if affine else []


def _mapped(rows: list[Any], values: Collection[float]) -> list[float]:
    return [sum(map(mul, row, values)) + constant for row, constant in rows]


def _copied(states: list[Any]) -> list[dict[str, Any]]:
    """What is put later; lists as they are, because `_put` puts others in their places."""
    return [dict(vars(state)) for state in states]


def _put(states: list[Any], values: list[dict[str, Any]]) -> None:
    for state, kept in zip(states, values, strict=True):
        vars(state).update({k: v[:] if isinstance(v, list) else v for k, v in kept.items()})


def replay(document: Written) -> tuple[Armor, float]:
    """How far off, m; infinitely where a surface or status differs."""
    armor, golden, worst, before = Armor(document), document["golden"], 0.0, 0.0
    rows = zip(
        golden["t"], golden["reading"], golden["point"], golden["surface"], golden["status"],
        strict=True,
    )  # fmt: skip
    for t, reading, point, surface, status in rows:
        contact = armor.step(t - before, reading)
        before = t
        same = (contact.surface, int(contact.status)) == (surface, status)
        off = sqrt(square(contact.point, point))
        worst = max(worst, off if same and not isnan(off) else inf)
    return armor, worst
