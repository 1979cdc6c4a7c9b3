"""What is known of an armor before any calibration: a TOML file, or a mesh.

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
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from compensate import invert
from compensate.armor import Armor, Box, Bumps, ContactSolver, Cover, Mesh, WristSensor
from compensate.armor._shapes import AbstractShape
from hysteresis import AbstractModel, InputError, PrandtlIshlinskii
from hysteresis._quantities import conversion

from ..intake._own_config import read_toml

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
        if self.frame_width is not None:
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
    if unknown := sorted(set(given) - KEYS):
        raise InputError(
            "unknown-key", f"{unknown[0]!r} is not known here.", place=str(file),
            fix=f"The keys are {', '.join(sorted(KEYS))}.",
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
            found[key] = found[key] if count > 1 else found[key][0]
        if "mesh" in given:
            return Description(**found, **_mesh(file.parent / str(given["mesh"]), str(unit)))
        sides = tuple(metres * float(box.get(key, 0.0 if key == "dz2" else np.nan)) for key in BOX)
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(
            "bad-config", f"A value cannot be used: {error}.", place=str(file)
        ) from error
    if not np.isfinite(sides).all():
        raise InputError(
            "bad-config", "The shape is not given.", place=str(file),
            fix="box = {dx = 0.3, dy = 0.3, dz1 = 0.55, dz2 = 0}, or mesh = \"shell.stl\".",
        )  # fmt: skip
    return Description(box=sides, **found)


def _mesh(file: Path, unit: str) -> dict[str, Any]:
    if not file.is_file():
        said, fix = f"There is no file {file}.", "Name a TOML or mesh file."
        raise InputError("file-not-found", said, fix=fix)
    corners = np.asarray(Mesh.load(file, unit).corners()).reshape(-1, 3)
    return {"corners": corners, "triangles": np.arange(len(corners)).reshape(-1, 3)}
