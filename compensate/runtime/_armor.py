"""Contacts in plain Python: the solver of `compensate.armor`, wrench by wrench."""

from collections.abc import Collection
from math import exp, inf, isfinite, isnan, nan, sqrt
from pathlib import Path
from typing import Any, NamedTuple

from hysteresis.laws._tree import Running, node_of

from ._armor_geometry import Vector, cross, crossing, dot, field, moved, outside, square
from ._contact_status import ContactStatus
from ._file import READING_MISSING, replayed

KIND = "hysid armor"

_ZERO: Vector = (0.0, 0.0, 0.0)
_STATUSES = tuple(ContactStatus)


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


class Armor:
    """Contacts on a robot under a soft cover, reading by reading, without JAX.

    `step` gives the results of `WristSensor.step` and `ContactSolver.step` in JAX, whose times are sums of
    `dt`, to 1e-9 m.

    **Example:**

        >>> file = compensate.armor.export_armor(solver, folder / "armor.json")
        >>> runtime = compensate.runtime.load_armor(file)
        >>> runtime.step(0.01, (0.0, 0.0, -10.0, 0.0, 0.0, 0.0)).status.name
        'OK'
    """

    def __init__(self, document: dict[str, Any]):
        self.title: str = document["title"]
        self._faces = [
            (tuple(normal), offset, [(*edge, limit) for edge, limit in sides], surface)
            for surface, (normal, offset, sides) in enumerate(document["faces"], start=1)
        ]
        self._limits: dict[str, float] = {
            k: inf if v is None else float(v) for k, v in document["limits"].items()
        }
        self._sensor = _Sensor(document["sensor"]) if document["sensor"] else None
        self._cover = _Cover(document["cover"])
        self.reset()

    def reset(self) -> None:
        """As before the first reading."""
        if self._sensor:
            self._sensor.reset()
        self._cover.reset()
        self._touching, self._surface, self._place, self._time = False, 0, _ZERO, -inf
        self._now = 0.0
        self._contact = ArmorContact(_ZERO, 0, 0.0, ContactStatus.NO_CONTACT, 0.0, _ZERO, 0.0, 0.0)

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
            self._now += dt
        t, doubt = self._now, 0
        if self._sensor:
            reading, doubt = self._sensor.step(t, reading, motion)
        fx, fy, fz, mx, my, mz = reading
        if doubt == ContactStatus.INVALID or not isfinite(t + fx + fy + fz + mx + my + mz):
            return self._contact._replace(status=ContactStatus.INVALID)
        contact = self._found(t, (fx, fy, fz), (mx, my, mz), doubt)
        self._contact, self._touching = contact, contact.surface > 0
        return contact

    def _found(self, t: float, force: Vector, moment: Vector, doubt: int) -> ArmorContact:
        limits, cover = self._limits, self._cover
        threshold = limits["release"] if self._touching else limits["threshold"]
        fx, fy, fz = force
        strength = fx * fx + fy * fy + fz * fz
        size = sqrt(strength)
        if not strength:
            cover.rest(t)
            return self._none(ContactStatus.NO_CONTACT, 0.0)
        mx, my, mz = moment
        foot = (
            (fy * mz - fz * my) / strength,
            (fz * mx - fx * mz) / strength,
            (fx * my - fy * mx) / strength,
        )
        spin = (fx * mx + fy * my + fz * mz) / size
        least = 1e-9 * size
        found: list[Any] = []
        for normal, offset, sides, surface in self._faces:
            nx, ny, nz = normal
            along = nx * fx + ny * fy + nz * fz
            if along < threshold or along <= least:
                continue
            point, ahead, aside = crossing(normal, offset, force, foot, along)
            is_fresh = surface != self._surface or (
                not self._touching
                and (
                    square(point, self._place) > limits["same_place"] ** 2
                    or t - self._time > limits["recovery"]
                )
            )
            pressed = cover.trial(t, along, is_fresh)
            d = cover.settled(pressed, along, surface, point, aside)
            far = cover.is_beyond(d)
            touched = moved(point, d, aside)
            beyond = outside(sides, touched)
            point = moved(point, d, ahead)
            found.append((beyond, along, surface, point, d, normal, touched, is_fresh, far))
        rounding = limits["rounding"]
        costs = [0.0 if f[0] <= rounding else f[0] for f in found]
        cost = min(costs, default=inf)
        if not found or cost > max(limits["tolerance"], rounding):
            cover.rest(t)
            weak = size < threshold / 10
            code = self._missed(force, foot, size, threshold, bool(found))
            if doubt and not weak:
                code = doubt
            none = self._none(ContactStatus.NO_CONTACT if weak else _STATUSES[code], spin)
            if not found:
                return none
            best = max(zip(costs, found, strict=True), key=lambda c: (-c[0], c[1][1]))[1]
            return none._replace(
                point=best[3], displacement=best[4], normal=best[5], normal_force=best[1],
                outside=best[0],
            )  # fmt: skip
        best = max((f for f, c in zip(found, costs, strict=True) if c <= cost), key=lambda f: f[1])
        beyond, along, surface, point, d, normal, touched, is_fresh, far = best
        cover.keep(t, along, is_fresh)
        self._surface, self._place, self._time = surface, touched, t
        if doubt:
            status = _STATUSES[doubt]
        elif abs(spin) > limits["spin"] * along:
            status = ContactStatus.SECOND_SUPPORT
        elif any(
            f[0] <= rounding and square(f[3], point) > (f[4] + d + rounding) ** 2 for f in found
        ):
            status = ContactStatus.AMBIGUOUS
        elif far:
            status = ContactStatus.EXTRAPOLATED
        else:
            status = ContactStatus.OK
        return ArmorContact(point, surface, d, status, spin, normal, along, beyond)

    def _missed(
        self, force: Vector, foot: Vector, size: float, threshold: float, is_pushed: bool
    ) -> int:
        """Why there is no contact, for a force that is not 0."""
        if size < threshold:
            return ContactStatus.BELOW_THRESHOLD
        faced, least = False, 1e-9 * size
        for normal, offset, sides, _ in self._faces:
            along = dot(normal, force)
            faced = faced or along > least
            if along <= -threshold and along < -least:
                point, _, _ = crossing(normal, offset, force, foot, along)
                if outside(sides, point) <= self._limits["tolerance"]:
                    return ContactStatus.PULLING
        if not faced:
            return ContactStatus.PULLING
        return ContactStatus.MISSED if is_pushed else ContactStatus.BELOW_THRESHOLD

    def _none(self, status: ContactStatus, spin: float) -> ArmorContact:
        return ArmorContact(_ZERO, 0, 0.0, status, spin, _ZERO, 0.0, 0.0)


class _Cover:
    """`compensate.armor.Cover` with the state of the place that was touched last."""

    def __init__(self, document: dict[str, Any]):
        self._tree, self._is_inverse = document["tree"], document["inverse"]
        self._scale: float = document["scale"]
        # Files of earlier versions have neither of the following.
        self._force_scale: float = document.get("force_scale", 1.0)
        self._time_scale: float = document.get("time_scale", 1.0)
        self._thickness, self._most = (
            inf if document.get(key) is None else float(document[key])
            for key in ("thickness", "most")
        )
        self._factor, self._factor_even = field(document["factor"])
        self._compliance, self._compliance_even = field(document["compliance"])
        self._turns: int = document["turns"]
        self.reset()

    def reset(self) -> None:
        """As before the first touch."""
        self._states: list[Any] = []
        self._node: Running | None = node_of(self._tree, self._states) if self._tree else None
        self._virgin = self._kept = _copied(self._states)
        self._since, self._is_used, self.beyond = nan, False, False

    def is_beyond(self, d: float) -> bool:
        """Whether the last trial is beyond the fit, or this displacement beyond the thickness."""
        return self.beyond or d > self._thickness

    def trial(self, t: float, force: float, is_fresh: bool) -> float:
        """g(F_n) in metres; the state stays."""
        if self._node is None:
            return 0.0
        found = self._moved(t, force, is_fresh)
        _put(self._states, self._kept)
        return found

    def keep(self, t: float, force: float, is_fresh: bool) -> None:
        """The state goes on to this force."""
        if self._node is not None:
            self._moved(t, force, is_fresh)
            self._kept, self._since, self._is_used = _copied(self._states), t, True

    def rest(self, t: float) -> None:
        """The state goes on without a force, if anything was touched yet."""
        if self._is_used:
            self.keep(t, 0.0, False)

    def _moved(self, t: float, force: float, is_fresh: bool) -> float:
        assert self._node is not None
        if is_fresh:
            _put(self._states, self._virgin)
        dt = 0.0 if is_fresh or isnan(self._since) else t - self._since
        move = self._node.find if self._is_inverse else self._node.move
        own = self._force_scale * force
        found = move(self._time_scale * dt, own)
        self.beyond = (found if self._is_inverse else own) > self._most
        return self._scale * found

    def settled(
        self, pressed: float, force: float, surface: int, point: Vector, aside: Vector
    ) -> float:
        """d_n of a surface, see `ContactSolver.settle`."""
        d = self._factor(surface, point) * pressed + self._compliance(surface, point) * force
        for _ in range(0 if self._factor_even and self._compliance_even else self._turns):
            place = moved(point, d, aside)
            d = self._factor(surface, place) * pressed + self._compliance(surface, place) * force
        return d


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
        self._centre: Vector = tuple(document.get("centre", _ZERO))
        self._inertia: list[list[float]] = document.get("inertia", [[0.0] * 3] * 3)
        self._gravity: Vector = tuple(document.get("gravity", Motion().gravity))
        self.reset()

    def reset(self) -> None:
        """As before the first reading."""
        self._finds = [node_of(tree).find for tree in self._trees]
        self._held, self._time = [0.0] * 6, nan

    def step(
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


def _rows(affine: dict[str, Any] | None) -> list[Any]:
    return list(zip(affine["matrix"], affine["constant"], strict=True)) if affine else []


def _mapped(rows: list[Any], values: Collection[float]) -> list[float]:
    a, b, c, d, e, f = values
    return [
        r[0] * a + r[1] * b + r[2] * c + r[3] * d + r[4] * e + r[5] * f + constant
        for r, constant in rows
    ]


def _copied(states: list[Any]) -> list[dict[str, Any]]:
    return [
        {k: v[:] if isinstance(v, list) else v for k, v in vars(state).items()} for state in states
    ]


def _put(states: list[Any], values: list[dict[str, Any]]) -> None:
    for state, kept in zip(states, values, strict=True):
        vars(state).update({k: v[:] if isinstance(v, list) else v for k, v in kept.items()})


def load_armor(path: str | Path) -> Armor:
    """Load an armor from a file that `compensate.armor.export_armor` wrote, and verify it.

    The armor first replays the contacts that the file contains, and must find them again.

    **Raises:** `FileError` where the file is missing, damaged, changed or of another format, or where the
    replay gives other contacts.

    **Example:**

        >>> file = compensate.armor.export_armor(solver, folder / "armor.json")
        >>> compensate.runtime.load_armor(file).step(0.01, (0, 0, -10, 0, 0, 0)).surface
        1
    """
    return replayed(path, KIND, "contacts lie {:.3g} m off", _replay)


def _replay(document: dict[str, Any]) -> tuple[Armor, float]:
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
