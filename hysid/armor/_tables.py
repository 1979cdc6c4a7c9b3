"""Tables of wrenches and of presses at known points.

Both have a column for each of Fx, Fy, Fz, Mx, My and Mz, what the sensor under the shell read, and one for
the time. Presses have more: `press`, which press a row belongs to; `force`, of the gauge, which pushes
along the surface's inward normal; `x`, `y` and `z`, the touched point of the shell, undeformed, from P_o;
and `displacement`, how deep the cover gave way, where that was measured. Units are read from the headers
("Fx (N)", "x [mm]") and converted; a column without a unit is in N, N m, m or s.

Where the shell's weight and inertia are known, columns tell how it moves, in its own axes: gx, gy, gz, the
direction in which gravity pulls, ax, ay, az, the acceleration of P_o without gravity (m/s^2), wx, wy, wz,
the angular velocity (rad/s), and alx, aly, alz, the angular acceleration (rad/s^2). Presses have gravity.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from compensate.armor import Motion, Presses
from compensate.armor._shapes import AbstractShape
from hysteresis import InputError, read_table
from hysteresis.records._table import Table

from ..intake._columns import in_unit
from ..intake.guess._remedies import reading

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
    read = {key: _column(table, key)[rows] for key in (*AXES, "force", "x", "y", "z")}
    time = _column(table, "time")[rows] if _named(table, "time") else np.arange(rows.shape[1]) * 1.0
    depth = _column(table, "displacement")[rows] if _named(table, "displacement") else None
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
    """The column of this name, whatever the case, without its unit."""
    for column in table.columns:
        bare = column.split("(")[0].split("[")[0].strip().rstrip("_")
        if name.lower() in (bare.lower(), bare.lower().rpartition("_")[0]):
            return column
    return None
