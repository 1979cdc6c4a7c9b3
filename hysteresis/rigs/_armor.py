"""A virtual haptic armour: the box of Tsuji et al. (2014), carried by one force sensor, and a gauge.

It makes what a person with a push-pull gauge would record at known points. Nothing here computes
a contact point: data made by the solver under test would prove nothing.
"""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from ._arguments import check_fields, check_step, fault, require
from ._foam_block import FoamBlock
from ._force_sensors import ForceSensor, GaugeSensor
from ._sponge import FORCE_LIMIT, SpongeRig, force_path

Points = Float[np.ndarray, "presses 3"]
Sides = Float[np.ndarray, "presses 2"]
Numbers = Int[np.ndarray, " presses"]
"""In space and on a surface, and the numbers of surfaces."""

# The frame below a cover: plates that sag where they are pressed, in many modes.


@dataclass(frozen=True, kw_only=True)
class PlateFrame:
    """Five thin plates, held at their edges; the lower edges of the four walls are free to move.

    A force at a point moves it by the sum over the modes of a simply supported plate (Navier),

        w/F = sum_mn phi_mn^2/K_mn,    phi_mn = sin(m pi x/a) sin(n pi y/b)
        K_mn = (a b/4) D pi^4 (m^2/a^2 + n^2/b^2)^2,     D = E t^3/(12 (1 - nu^2))

    A wall is half of a plate of twice its height, pressed with its mirror image: n is odd.

    **Arguments:** (all above 0)

    - `thickness_mm`, `modulus_gpa`, `poisson`: t, E and nu; acrylic glass unless given.
    - `modes`: in each direction.

    **Raises:** `InputError` if a parameter is outside its range.

    Source: Timoshenko and Woinowsky-Krieger, Theory of Plates and Shells (1959), section 34.
    """

    thickness_mm: float = 5.0
    modulus_gpa: float = 3.0
    poisson: float = 0.37
    modes: int = 8

    def __post_init__(self) -> None:
        check_fields(self, below={"poisson": 0.5})

    def compliance(
        self, place: Sides, half: Sides, wall: Bool[np.ndarray, " presses"]
    ) -> Float[np.ndarray, " presses"]:
        """w/F in mm/N at places in m from the middle of plates with these half widths.

        Of a wall the second coordinate is the height.
        """
        t, E = 1e-3 * self.thickness_mm, 1e9 * self.modulus_gpa
        D = E * t**3 / (12 * (1 - self.poisson**2))
        a, high = 2 * half.T
        x = place[:, 0] + half[:, 0]
        # From the upper edge downwards, so that the free edge is the middle of the doubled plate.
        y = np.where(wall, half[:, 1] - place[:, 1], place[:, 1] + half[:, 1])
        b = np.where(wall, 2 * high, high)
        m, n = np.mgrid[1 : self.modes + 1, 1 : self.modes + 1].reshape(2, -1, 1)
        shape = np.sin(m * np.pi * x / a) * np.sin(n * np.pi * y / b)
        K = a * b / 4 * D * np.pi**4 * ((m / a) ** 2 + (n / b) ** 2) ** 2
        return 1e3 * np.sum(np.where(wall, 2.0 * (n % 2), 1.0) * shape**2 / K, axis=0)


_fault = partial(fault, "ArmorRig")
_require = partial(require, "ArmorRig")

INWARD: Final = np.array([[0, 0, -1], [0, -1, 0], [0, 1, 0], [-1, 0, 0], [1, 0, 0]], float)
"""Inward normals of surfaces 1 to 5: the top, +y, -y, +x, -x."""

PRESS_FORCE: Final = 15.0
"""N, of every press in the paper, and the force to which the sag refers."""

PRESS: Final = np.linspace(0.0, PRESS_FORCE, 6)[1:]
"""N: a press as the paper's, first touch to 15 N in five ramps."""

CALIBRATION_TURNS: Final = (0.0, 20.0, 8.0, 16.0, 4.0, 12.0, 2.0, 18.0, 0.0)
"""N, where a calibration press reverses: both branches, and loops inside loops."""

_ON_SURFACE: Final = 1e-9  # m


class BoxSize(NamedTuple):
    """Of the box with its base at z = `dz2`, its top at z = `dz1`; m, from P_o."""

    dx: float
    dy: float
    dz1: float
    dz2: float


class ArmorPoints(NamedTuple):
    """Where to press."""

    points: Points
    """P^i in m, on the undeformed surface"""
    surface: Numbers
    """1 to 5"""


class ArmorPresses(NamedTuple):
    """Presses as recorded, and the truth about them."""

    time: Float[np.ndarray, " samples"]
    """s"""
    force: Float[np.ndarray, "presses samples"]
    """N, of the gauge, along its direction"""
    direction: Points
    """u, of length 1"""
    wrench: Float[np.ndarray, "presses samples 6"]
    """what the sensor reads: F in N, then M in N m, exerted by the load about P_o"""
    surface: Numbers
    """1 to 5"""
    touched: Points
    """P^i in m: where the undeformed surface was touched"""
    contact: Float[np.ndarray, "presses samples 3"]
    """P^e in m: where the load is, P^e = P^i + d n with the inward normal n"""
    displacement: Float[np.ndarray, "presses samples"]
    """d in m"""
    load: Float[np.ndarray, "presses samples 6"]
    """the true wrench"""


@dataclass(frozen=True, kw_only=True)
class ArmorRig:
    """A box on a force sensor, covered with a sheet of sponge, and a gauge to press it with.

    The load is f u at P^e, u the gauge's direction and f its force, and with f_n = f u.n

        d = a d_s[f_n] + s (f_n/15 N) exp(-r^2/(2 w^2)) + e,    P^e = P^i + d n
        wrench = sensor[f u, P^e x f u]

    - d_s: `SpongeRig` of the cover's thickness, touched for the first time; the sheet goes on around the
      probe, which makes it stiffer than the block the paper characterised: a < 1.
    - The acrylic frame sags, most at the middle of each surface; r is the distance from there. With a
      `frame` its plates say by how much instead.
    - e: unevenness of the cover and of the hand, normal, one for each press.

    The rigid box has d = 0 and is 500 mm wide, as the one that the paper compares with; the soft one is
    600 mm wide over its sponge. A rig of the same `seed` has the same sensor, soft or rigid: the paper's
    conditions (a), (b) and (c) are two rigs. The rig keeps no state.

    **Arguments:**

    - `seed`: of the specimen and of its readings.
    - `soft`: sponge or bare acrylic.
    - `cover`: the sponge. `sheet`: a. Of a `FoamBlock` the sheet is stiffer by 1/a, and by a part
      that changes smoothly from place to place with the deviation `uneven`.
    - `sag_mm`, `sag_width_mm`: s and w. `scatter_mm`: standard deviation of e.
    - `frame`: plates, instead of the sag of s and w. `sensor`: the force sensor.

    **Raises:** `InputError` if a parameter is outside its range.

    Source: Tsuji et al. (2014), figs 8, 11, 13 and section "Evaluation of compensation". The sizes of
    its Table 2 follow from the text; a, s, w and e were chosen to give its errors.

    **Example:**

        >>> rig = hysteresis.rigs.ArmorRig(seed=1)
        >>> body = rig.points_of_the_body()
        >>> rig.press(body.points, body.surface).wrench.shape
        (45, 5, 6)
    """

    seed: int = 0
    soft: bool = True
    cover: SpongeRig | FoamBlock = field(default_factory=SpongeRig)
    sheet: float = 0.94
    uneven: float = 0.02
    sag_mm: float = 1.5
    sag_width_mm: float = 60.0
    scatter_mm: float = 0.6
    frame: PlateFrame | None = None
    sensor: ForceSensor | GaugeSensor = field(default_factory=GaugeSensor)

    def __post_init__(self) -> None:
        at_zero = ("seed", "sag_mm", "scatter_mm", "uneven")
        check_fields(self, at_zero, ("soft", "cover", "sensor", "frame"))

    @property
    def size(self) -> BoxSize:
        """Half widths and heights of the undeformed box."""
        return BoxSize(0.3, 0.3, 0.55, 0.0) if self.soft else BoxSize(0.25, 0.25, 0.5, 0.0)

    @classmethod
    def of_foam(cls, seed: int = 0, **changes: Any) -> "ArmorRig":
        """A `FoamBlock` as cover and a `PlateFrame` below it, with these `changes` of its fields.

        No model of `hysteresis` is the whole of either; `FoamBlock` says which part of it one is.
        """
        parts = {"cover": FoamBlock(), "frame": PlateFrame(), "sheet": 0.9}
        return cls(seed=seed, **parts | changes)

    @cached_property
    def specimen(self) -> Any:
        """What makes this rig's sensor another than the next one's."""
        return self.sensor.specimen(np.random.default_rng([self.seed, 0]))

    def points_of_surface_1(self) -> ArmorPoints:
        """The 76 points of the paper's fig 11, on the soft box: along x, y and both diagonals.

        Each line goes from -270 to 270 mm in steps of 30 mm. Numbers 10, 29, 48, 67 are the middle.
        """
        t, zero = 0.03 * np.arange(-9, 10), np.zeros(19)
        x, y = np.concatenate([t, zero, t, t]), np.concatenate([zero, t, t, -t])
        return ArmorPoints(np.stack([x, y, np.full(76, self.size.dz1)], axis=1), np.ones(76, int))

    def points_of_the_body(self) -> ArmorPoints:
        """The 45 points of the paper's fig 13: nine of each surface, 200 mm apart about its middle."""
        u, v = (0.2 * a.ravel() for a in np.meshgrid([-1, 0, 1], [-1, 0, 1], indexing="ij"))
        surface = np.repeat(np.arange(1, 6), 9)
        points = self._place(surface, np.tile(u, 5), np.tile(v, 5))
        return ArmorPoints(points, surface)

    def random_points(self, count: int, *, margin: float = 0.03, seed: int = 0) -> ArmorPoints:
        """Points evenly over the body, at least `margin` metres from every edge."""
        _require(
            count > 0 and 0 <= margin < min(self.size[:2]) and margin < self.size.dz1 / 2,
            f"count = {count}, margin = {margin} m.",
            "Give 1 point or more, and a margin below the half width.",
        )
        rng = np.random.default_rng([self.seed, 2, seed])
        (width, _), (_, height) = self._half_widths(np.array([1, 2]))
        area = np.array([width**2, *[width * height] * 4])
        surface = rng.choice(np.arange(1, 6), count, p=area / area.sum())
        u, v = ((self._half_widths(surface) - margin) * rng.uniform(-1, 1, (count, 2))).T
        return ArmorPoints(self._place(surface, u, v), surface)

    def press(
        self,
        points: ArrayLike,
        surface: ArrayLike,
        force: ArrayLike = PRESS,
        *,
        direction: ArrayLike | None = None,
        dt: float = 6.0,
        session: int = 0,
    ) -> ArmorPresses:
        """Press at known points; every press finds the cover and the sensor at rest.

        **Arguments:**

        - `points`: (presses, 3) in m, on the undeformed surface; `surface`: (presses,), 1 to 5.
        - `force`: (samples,) for all or (presses, samples), 0 to 40 N, each sample the end of a ramp
          of `dt` seconds; the first ramp starts from 0 N.
        - `direction`: (presses, 3), where the gauge points; the inward normal unless given.
        - `session`: presses of another session have other scatter and noise, on the same sensor.

        **Raises:** `InputError` outside these ranges, for a point that is not on its surface, a
        direction that does not push.
        """
        points, surface = np.asarray(points, float), np.asarray(surface)
        self._check_points(points, surface)
        force = np.asarray(force, float)
        force = np.tile(force, (len(points), 1)) if force.ndim == 1 else force
        said = f"force has the shape {force.shape} for {len(points)} points."
        mend = "Give (samples,) or (presses, samples)."
        _require(force.ndim == 2 and len(force) == len(points) and force.shape[1] > 0, said, mend)
        within = bool(np.all((force >= 0) & (force <= FORCE_LIMIT)))
        fix = "Stay where the rig is known to resemble the sponge."
        _require(within, f"a force is outside 0 to {FORCE_LIMIT:g} N.", fix)
        check_step("ArmorRig", dt)
        normal = INWARD[surface - 1]
        along = normal if direction is None else _unit(np.asarray(direction, float), normal)
        rng = np.random.default_rng([self.seed, 1, session])
        d = self._displacement(points, surface, force * np.sum(along * normal, axis=1)[:, None], dt)
        d += self.soft * 1e-3 * self.scatter_mm * rng.normal(size=(len(points), 1))
        contact = points[:, None] + d[..., None] * normal[:, None]
        pushed = force[..., None] * along[:, None]
        load = np.concatenate([pushed, np.cross(contact, pushed)], axis=2)
        wrench = self.sensor.read(load, self.specimen, rng)
        time = dt * np.arange(1, force.shape[1] + 1)
        return ArmorPresses(time, force, along, wrench, surface, points, contact, d, load)

    def calibrate(self, points: ArrayLike, surface: ArrayLike, *, session: int = 1) -> ArmorPresses:
        """Presses up to 20 N and back with reversals in between (`CALIBRATION_TURNS`), at 0.5 N/s."""
        return self.press(points, surface, force_path(CALIBRATION_TURNS), dt=2.0, session=session)

    def _displacement(
        self, points: np.ndarray, surface: np.ndarray, force: np.ndarray, dt: float
    ) -> Float[np.ndarray, "presses samples"]:
        """The cover's and the frame's part of d in m under normal forces."""
        if not self.soft:
            return np.zeros(force.shape)
        inside, half = self._from_the_middle(points, surface), self._half_widths(surface)
        if isinstance(self.cover, FoamBlock):
            from_edge = np.min(half - np.abs(inside), axis=1)
            d = self._foam(self.cover, points, surface, force, dt, from_edge)
        else:
            d = self.sheet * np.array([_followed(self.cover, row.tobytes(), dt) for row in force])
        if self.frame is None:
            near = np.exp(-np.sum(inside**2, axis=1) / (2 * (1e-3 * self.sag_width_mm) ** 2))
            give = self.sag_mm / PRESS_FORCE * near
        else:
            # The frame is thinner than the shell by the cover.
            part = 1 - 1e-3 * self.cover.thickness_mm / half
            give = self.frame.compliance(inside * part, half * part, surface > 1)
        return 1e-3 * (d + give[:, None] * force)

    def _foam(
        self, cover: FoamBlock, points: np.ndarray, surface: np.ndarray, force: np.ndarray, dt: float,
        from_edge: np.ndarray,
    ) -> Float[np.ndarray, "presses samples"]:  # fmt: skip
        """d in mm of foam: its density changes over a decimetre, and its cone is cut off at an edge."""
        rng = np.random.default_rng([self.seed, 3])
        waves, phase = rng.normal(size=(5, 3, 24)) / 0.1, rng.uniform(0, 2 * np.pi, (5, 24))
        angle = np.einsum("pi,pik->pk", points, waves[surface - 1]) + phase[surface - 1]
        density = np.sqrt(2 / 24) * np.cos(angle).sum(axis=1)
        reach = 1e-3 * (cover.probe_mm / 2 + cover.spread * cover.thickness_mm)
        supported = 0.5 + 0.5 * np.clip(from_edge / reach, 0, 1)
        stiffness = np.exp(self.uneven * density) / self.sheet
        return cover.follow_columns(force, dt, stiffness, supported)

    def _half_widths(self, surface: Numbers) -> Sides:
        """Of each surface, along its two axes: x then y then z, without the normal's."""
        dx, dy, dz1, dz2 = self.size
        high = (dz1 - dz2) / 2
        return np.array([(dx, dy), (dx, high), (dx, high), (dy, high), (dy, high)])[surface - 1]

    def _from_the_middle(self, points: Points, surface: Numbers) -> Sides:
        lateral = INWARD[surface - 1] == 0
        middle = np.array([0.0, 0.0, (self.size.dz1 + self.size.dz2) / 2])
        return (points - middle)[lateral].reshape(-1, 2)

    def _place(self, surface: np.ndarray, u: np.ndarray, v: np.ndarray) -> Points:
        """Points at (u, v) from the middle of their surface."""
        dx, dy, dz1, dz2 = self.size
        normal = INWARD[surface - 1]
        points = np.array([0.0, 0.0, (dz1 + dz2) / 2]) - normal * [dx, dy, (dz1 - dz2) / 2]
        points[normal == 0] += np.stack([u, v], axis=1).ravel()
        return points

    def _check_points(self, points: np.ndarray, surface: np.ndarray) -> None:
        _require(
            points.ndim == 2 and points.shape[1:] == (3,) and surface.shape == (len(points),),
            f"points have the shape {points.shape}, surface {surface.shape}.",
            "Give (presses, 3) and (presses,).",
        )
        _require(
            np.issubdtype(surface.dtype, np.integer)
            and bool(np.all((surface >= 1) & (surface <= 5))),
            "a surface is none of 1 to 5.",
            "Number them as the paper does.",
        )
        inside = self._from_the_middle(points, surface)
        on = self._place(surface, *inside.T)
        away = np.max(np.abs(points - on), axis=1, initial=0.0)
        beyond = np.max(np.abs(inside) - self._half_widths(surface), axis=1, initial=-1.0)
        off = np.flatnonzero(~((away <= _ON_SURFACE) & (beyond <= _ON_SURFACE)))
        if off.size:
            n = off[0]
            raise _fault(
                f"points[{n}] = {points[n]} m is not on surface {surface[n]}.",
                "Give metres, on the undeformed box (size), in the order of surface.",
            )


@lru_cache(maxsize=512)
def _followed(cover: SpongeRig, force: bytes, dt: float) -> Float[np.ndarray, " samples"]:
    """`cover.follow`, once for equal histories: it is a loop in Python."""
    return cover.follow(np.frombuffer(force), dt=dt)


def _unit(direction: np.ndarray, normal: np.ndarray) -> Points:
    _require(
        direction.shape == normal.shape and bool(np.all(np.sum(direction * normal, axis=1) > 0)),
        "a direction does not push on its surface.",
        "Give (presses, 3), each with a part along the inward normal.",
    )
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)
