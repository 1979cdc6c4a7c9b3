"""What is given of an armor: what is known before any calibration, in a TOML file or a mesh; and tables of
wrenches and of presses at known points.

unit = "mm"                 # of all lengths here; by default m
box = {dx = 300, dy = 300, dz1 = 550, dz2 = 0}    # or mesh = "shell.stl", from the TOML's folder
threshold = 1.5             # N
thickness = 50              # of the cover
frame_width = 50            # of the dents that the frame may have; without it the frame is rigid
full_scale = [50, 12]       # N, N m, of the sensor; without it the sensor has no hysteresis
noise = [0.03, 0.006]       # N, N m, standard deviation of a reading
reports = "load"            # or "reaction"
mass = 1.2                  # kg, of all that the sensor carries; without it the sensor feels no weight
centre = [0, 0, 250]        # of that mass, from P_o
inertia = [0.05, 0.05, 0.02]    # kg m^2, about that centre and the shell's axes

Both tables have a column for each of Fx, Fy, Fz, Mx, My and Mz, what the sensor under the shell read, and
one for the time. Presses have more: `press`, which press a row belongs to; `force`, of the gauge, which
pushes along the surface's inward normal; `x`, `y` and `z`, the touched point of the shell, undeformed, from
P_o; and `displacement`, how deep the cover gave way, where that was measured. Units are read from the
headers ("Fx (N)", "x [mm]") and converted; a column without a unit is in N, N m, m or s.

Where the shell's weight and inertia are known, columns tell how it moves, in its own axes: gx, gy, gz, the
direction in which gravity pulls, ax, ay, az, the acceleration of P_o without gravity (m/s^2), wx, wy, wz,
the angular velocity (rad/s), and alx, aly, alz, the angular acceleration (rad/s^2). Presses have gravity.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from compensate import invert
from compensate.armor import (
    Armor,
    Box,
    Bumps,
    ContactSolver,
    Cover,
    Mesh,
    Motion,
    Presses,
    WristSensor,
)
from compensate.armor._shapes import AbstractShape
from hysteresis import AbstractModel, InputError, PrandtlIshlinskii, read_table
from hysteresis._quantities import conversion
from hysteresis.records._table import Table
from hysteresis.records._units import name_and_unit

from ..intake._own_config import read_toml
from ..intake._selection import in_unit
from ..intake.guess._remedies import reading

NUMBERS = {
    "threshold": (1, False), "thickness": (1, True), "frame_width": (1, True), "full_scale": (2, False),
    "noise": (2, False), "mass": (1, False), "centre": (3, True), "inertia": (3, False),
}  # fmt: skip
"""How many numbers each key has, and whether they are lengths."""
KEYS = {"unit", "box", "mesh", "reports", *NUMBERS}
BOX = ("dx", "dy", "dz1", "dz2")
NOISE = (0.03, 0.006)
TRAVEL, SHARE = 0.1, 0.05
"""Of full scale, and of the reading: the hysteresis of a sensor before a calibration finds its own."""


@dataclass(frozen=True)
class Description:
    """An armor as its file describes it, lengths in m.

    - `box`: (dx, dy, dz1, dz2); or `corners` (n, 3) and `triangles` (m, 3) of a mesh.
    - `thickness`: of the cover; `frame_width`: of the frame's dents, None for a rigid one.
    - `full_scale`: N and N m, of a sensor with hysteresis, None for one without.
    - `mass`, kg, `centre` (3,), `inertia` (3,), kg m^2: of all that the sensor carries.
    """

    box: tuple[float, ...] | None = None
    corners: Any = None
    triangles: Any = None
    threshold: float = 1.5
    thickness: float = float("inf")
    frame_width: float | None = None
    full_scale: tuple[float, ...] | None = None
    noise: tuple[float, ...] = NOISE
    reports: str = "load"
    mass: float = 0.0
    centre: tuple[float, ...] = (0.0, 0.0, 0.0)
    inertia: tuple[float, ...] = (0.0, 0.0, 0.0)

    def shape(self) -> AbstractShape:
        """The shell."""
        return Mesh(self.corners, self.triangles) if self.box is None else Box(*self.box)

    def armor(self, material: AbstractModel) -> Armor:
        """The armor with a cover of this material, which was fitted in either direction.

        Raises `InputError` as `Cover` and `ContactSolver` do.
        """
        shape = self.shape()
        frame: Any = 0.0
        if self.frame_width:
            if not isinstance(shape, Box):
                count = len(shape.faces().offset)
                said = f"the frame below a mesh of {count} faces has no dents."
                raise InputError("bad-option", said, fix="leave frame_width out.")
            frame = Bumps(shape.centres(), 0.0, self.frame_width)
        units, given, plays = material.units, material, None
        if units is not None and conversion(units.input, "m") and conversion(units.output, "N"):
            given = invert(material)  # it gives forces
        cover = Cover(given, 1.0, frame, thickness=self.thickness)
        if self.full_scale is not None:
            full = np.repeat(np.asarray(self.full_scale, float), 3)
            plays = [
                PrandtlIshlinskii(np.array([TRAVEL * f]), np.array([SHARE]), 1.0) for f in full
            ]
        sensor = WristSensor(
            hysteresis=plays, reports=self.reports, mass=self.mass, centre=np.array(self.centre),
            inertia=np.diag(self.inertia),
        )  # fmt: skip
        return Armor(sensor, ContactSolver(shape, cover, self.threshold))

    @property
    def noise_of_wrench(self) -> Any:
        """(6,), N and N m."""
        return jnp.repeat(jnp.asarray(self.noise, float), 3)


def read_description(file: Path) -> Description:
    """An armor from a TOML file, or from a mesh in m.

    Raises `InputError` where it cannot be read, or has keys that are unknown.
    """
    if file.suffix.lower() != ".toml":
        return Description(**_mesh(file, "m"))
    given = dict(read_toml(file))
    box = given.pop("box", None) or {key: given.pop(key) for key in BOX if key in given}
    box = box if isinstance(box, dict) else {}
    if unknown := sorted((given.keys() - KEYS) | (box.keys() - {*BOX})):
        raise InputError(
            "unknown-key", f"{unknown[0]!r} is not known here.", place=str(file),
            fix=f"The keys are {', '.join(sorted(KEYS))}; those of a box {', '.join(BOX)}.",
        )  # fmt: skip
    unit = given.pop("unit", "m")
    metres = conversion(str(unit), "m")
    if metres is None:
        raise InputError("unknown-unit", f"{unit!r} is not a unit of length.", place=str(file))
    try:
        found: dict[str, Any] = {"reports": str(given.get("reports", "load"))}
        for key in NUMBERS.keys() & given.keys():
            count, is_length = NUMBERS[key]
            values = given[key] if count > 1 else [given[key]]
            found[key] = tuple(float(x) * (metres if is_length else 1.0) for x in values)
            if len(found[key]) != count:
                raise ValueError(f"{key} is {count} numbers")
            if key != "centre" and not min(found[key]) >= 0:
                raise ValueError(f"{key} is not 0 or above")
            found[key] = found[key] if count > 1 else found[key][0]
        sides = tuple(metres * float(box.get(key, 0.0 if key == "dz2" else np.nan)) for key in BOX)
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(
            "bad-config", f"A value cannot be used: {error}.", place=str(file)
        ) from error
    if ("mesh" in given) == np.isfinite(sides).all():
        raise InputError(
            "bad-config", "The shape is not given, or given twice.", place=str(file),
            fix="box = {dx = 0.3, dy = 0.3, dz1 = 0.55, dz2 = 0}, or mesh = \"shell.stl\".",
        )  # fmt: skip
    if "mesh" in given:
        return Description(**found, **_mesh(file.parent / str(given["mesh"]), str(unit)))
    return Description(box=sides, **found)


def _mesh(file: Path, unit: str) -> dict[str, Any]:
    if not file.is_file():
        said, fix = f"There is no file {file}.", "Name a TOML or mesh file."
        raise InputError("file-not-found", said, fix=fix)
    corners = np.asarray(Mesh.load(file, unit).corners()).reshape(-1, 3)
    return {"corners": corners, "triangles": np.arange(len(corners)).reshape(-1, 3)}


AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
UNITS: dict[str, str] = {**dict.fromkeys(AXES[:3], "N")} | dict.fromkeys(AXES[3:], "N*m")
UNITS |= {"time": "s", "force": "N", "displacement": "m"} | dict.fromkeys("xyz", "m")
MOTION = {
    "acceleration": ("m/s^2", ("ax", "ay", "az")), "gravity": ("m/s^2", ("gx", "gy", "gz")),
    "velocity": ("rad/s", ("wx", "wy", "wz")),
    "angular_acceleration": ("rad/s^2", ("alx", "aly", "alz")),
}  # fmt: skip
UNITS |= {column: unit for unit, columns in MOTION.values() for column in columns}
FAR = 0.05
"""Of the shape's longest side: a point farther from every surface was not touched."""


def read_rows(file: Path) -> tuple[Table, list[str]]:
    """A table whose decimal sign and words for missing values are found, and what was found."""
    table = read_table(file)
    options, notes = reading(table, {})
    table = read_table(file, **options) if options else table
    return table, [f"{why} ({found})." for _, found, why in notes]


class Wrenches(NamedTuple):
    """Readings of the sensor in the order of the file, with the line of each row."""

    time: Float[np.ndarray, " rows"] | None
    readings: Float[np.ndarray, "rows 6"]
    line: Int[np.ndarray, " rows"]
    sha256: str | None
    motion: Motion


def read_wrenches(table: Table) -> Wrenches:
    """Raises `InputError` `no-column` where one of the six is missing, and `wrong-unit`."""
    readings = np.column_stack([_column(table, name) for name in AXES])
    time = _column(table, "time") if _named(table, "time") else None
    return Wrenches(time, readings, np.asarray(table.line), table.sha256, _motion(table))


def _motion(table: Table) -> Motion:
    """How the shell moved, as far as the table says: a quantity has all three columns, or none."""
    told = {}
    for name, (_, columns) in MOTION.items():
        if any(_named(table, column) for column in columns):
            told[name] = np.column_stack([_column(table, column) for column in columns])
    return Motion(**told)


def read_presses(table: Table, shape: AbstractShape) -> Presses:
    """Presses of equally many samples. Raises `InputError` for what is missing or does not fit."""
    name = _named(table, "press")
    label = table.text[name] if name else np.full(len(table.line), "1")
    number = np.unique(label, return_inverse=True)[1]
    _, first, count = np.unique(label, return_index=True, return_counts=True)
    order = np.argsort(first)
    if len(set(count.tolist())) != 1:
        raise InputError(
            "bad-presses", f"presses have between {count.min()} and {count.max()} rows.",
            place=table.path, fix="give equally many rows of each press.",
        )  # fmt: skip
    rows = np.stack([np.flatnonzero(number == k) for k in order])
    read = {key: _whole(table, key)[rows] for key in (*AXES, "force", "x", "y", "z")}
    time = _whole(table, "time")[rows] if _named(table, "time") else np.arange(rows.shape[1]) * 1.0
    depth = _whole(table, "displacement")[rows] if _named(table, "displacement") else None
    points = np.stack([read[k] for k in "xyz"], axis=2)
    if np.ptp(points, axis=1).max() > FAR * float(shape.longest()):
        raise InputError(
            "bad-presses", "the touched point moves within a press.", place=table.path,
            cause="rows of several presses.", fix="number them in a column press.",
        )  # fmt: skip
    touched = points[:, 0]
    surface, normal = _touched_surfaces(shape, touched, table.path)
    readings = np.stack([read[key] for key in AXES], axis=-1)
    gravity = _motion(table).gravity
    poses = np.asarray(gravity)[rows] if np.ndim(gravity) == 2 else None
    return Presses(time, readings, read["force"], normal, touched, surface, depth, poses)


def _touched_surfaces(
    shape: AbstractShape, points: Float[np.ndarray, "presses 3"], place: str
) -> tuple[np.ndarray, np.ndarray]:
    """Number and inward normal of the surface that each point lies on."""
    faces = shape.faces()
    normal, offset = np.asarray(faces.normal), np.asarray(faces.offset)
    edge, limit = np.asarray(faces.edge), np.asarray(faces.limit)
    beside = np.abs(points @ normal.T + offset)
    beyond = (np.einsum("fej,pj->pfe", edge, points) - limit).max(axis=2)
    off = np.hypot(beside, np.maximum(beyond, 0))
    best = off.argmin(axis=1)
    if (worst := off.min(axis=1).max()) > FAR * float(shape.longest()):
        raise InputError(
            "bad-presses", f"a pressed point lies {1e3 * worst:.3g} mm from every surface.",
            place=place, cause="points in another unit, or from another origin than P_o.",
            fix="name the unit in the header, x (mm).",
        )  # fmt: skip
    return np.asarray(faces.surface)[best], normal[best]


def _whole(table: Table, name: str) -> np.ndarray:
    """A column without a gap."""
    found = _column(table, name)
    if (gap := ~np.isfinite(found)).any():
        raise InputError(
            "no-value", f"{_named(table, name)!r} has no number there.",
            place=f"{table.path}, line {table.line[gap][0]}", fix="leave the whole press out.",
        )  # fmt: skip
    return found


def _column(table: Table, name: str) -> np.ndarray:
    """A column in the unit of `UNITS`."""
    column = _named(table, name)
    if column is None:
        raise InputError(
            "no-column", f"The table has no column {name}.", place=table.path,
            fix=f"Rename one of {', '.join(map(repr, table.columns))} to {name} ({UNITS[name]}).",
        )  # fmt: skip
    return in_unit(table, column, UNITS[name])


def _named(table: Table, name: str) -> str | None:
    """The column of this name, whatever the case, without its unit. Raises `given-twice`."""
    bare = {column: name_and_unit(column)[0].strip(" _").lower() for column in table.columns}
    named = [column for column in bare if bare[column] == name.lower()]
    if len(named) > 1:
        said = f"Columns {named[0]!r} and {named[1]!r} are both {name}."
        raise InputError("given-twice", said, place=table.path, fix="rename one.")
    return named[0] if named else None
