"""Export of an armor to a file that runs without JAX."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from hysteresis import AbstractModel, InputError

from ..export._document import program_of, require_double, write
from ..runtime._armor import KIND
from ..runtime._file import SCHEMA, number
from ._cover import AbstractField, Bumps, Cover, Uniform
from ._solver import TURNS, ContactSolver
from ._wrench import AT_REST, WristSensor

MOST_FACES = 256
"""Plain Python looks at every face: more of them take longer than a control loop has."""


def export_armor(
    solver: ContactSolver, path: str | Path, sensor: WristSensor | None = None, *,
    model: AbstractModel | None = None, title: str = "armor",
) -> Path:  # fmt: skip
    """Write a solver as JSON for `compensate.runtime.load`, with contacts to verify it on loading.

    **Arguments:**

    - `sensor`: the sensor whose readings the program gets, at rest; without one it gets wrenches of the
      load about P_o.
    - `model`: where the cover is a compensator, the model that was inverted.
    - `title`: a description in one line.

    **Returns:** the path of the file.

    **Raises:** `InputError` for a shape of more than 256 faces, a cover or a sensor's hysteresis that
    cannot be exported, a compensator without its model, and JAX in single precision.

    **Example:**

        >>> file = compensate.armor.export_armor(solver, folder / "armor.json", title="upper arm")
        >>> compensate.runtime.load(file).title
        'upper arm'
    """
    require_double()
    faces = solver.shape.faces()
    if len(faces.offset) > MOST_FACES:
        raise InputError(
            "bad-option", f"a shape of {len(faces.offset)} faces is too slow in plain Python.",
            fix=f"ContactStream(solver), or a Convex of at most {MOST_FACES} faces.",
        )  # fmt: skip
    each = zip(*(np.asarray(a).tolist() for a in faces[:4]), strict=True)
    document = {
        "schema": SCHEMA, "kind": KIND, "title": title,
        "faces": [
            [normal, offset, list(zip(edges, ends, strict=True))] for normal, offset, edges, ends in each
        ],
        "limits": {name: number(limit) for name, limit in solver.limits()._asdict().items()},
        "cover": _cover(solver.cover, model, len(faces.offset)),
        "sensor": sensor and _sensor(sensor),
        "golden": _golden(solver, sensor),
    }  # fmt: skip
    return write(path, document)


def _cover(cover: Cover, model: AbstractModel | None, surfaces: int) -> dict[str, Any]:
    material: Any = cover.compensator
    is_inverse = not (material is None or isinstance(material, AbstractModel))
    if is_inverse and model is None:
        raise InputError(
            "not-exportable", "the cover is a compensator, and is exported by the model it inverts.",
            fix="export_armor(..., model=the model given to invert).",
        )  # fmt: skip
    exported: Any = model if is_inverse else material
    tree = None if exported is None else program_of(exported)
    of_force, of_length, of_time = (1.0, 1.0, 1.0) if cover.is_rigid else cover.scales
    most = cover.known_to()
    return {
        "tree": tree, "inverse": is_inverse, "scale": of_length, "force_scale": of_force,
        "time_scale": of_time, "thickness": number(cover.thickness),
        "most": None if most is None else float(most),
        "factor": _field(cover.factor, surfaces), "compliance": _field(cover.compliance, surfaces),
        "turns": TURNS,
    }  # fmt: skip


def _field(field: AbstractField, surfaces: int) -> dict[str, Any]:
    def each(value: Any) -> list[float]:
        return np.broadcast_to(np.asarray(value), (surfaces,)).tolist()

    if isinstance(field, Uniform):
        return {"kind": "uniform", "value": np.asarray(field.value).tolist()}
    if isinstance(field, Bumps):
        return {
            "kind": "bumps", "centre": field.centre.tolist(), "amplitude": each(field.amplitude),
            "width": float(field.width), "base": each(field.base),
        }  # fmt: skip
    raise InputError(
        "not-exportable", f"a field {type(field).__name__} cannot be exported.",
        fix="use Uniform or Bumps.",
    )  # fmt: skip


def _sensor(sensor: WristSensor) -> dict[str, Any]:
    """The linear parts as matrices: the calibration, and everything after the hysteresis."""
    if sensor.slip is not None:
        raise InputError(
            "not-exportable", "the slip of the sensor's joints is not exported yet.",
            fix="calibrate without with_slip, or with plays of each axis.",
        )  # fmt: skip
    calibrated = sensor._calibrated
    placed = eqx.tree_at(
        lambda s: (s.matrix, s.bias), sensor, (jnp.eye(6), jnp.zeros_like(sensor.bias))
    )

    def carried(sound: Array) -> Array:
        wrench = placed.read(sound)
        return jnp.concatenate([wrench.force, wrench.moment], axis=-1)

    def whole(readings: Array) -> Array:
        return carried(calibrated(readings))

    parts = (calibrated, carried) if sensor.hysteresis else (whole, None)
    return {
        "calibration": _affine(parts[0]), "placement": parts[1] and _affine(parts[1]),
        "range": [number(end) for end in np.asarray(sensor.range)],
        "time_constant": float(sensor.time_constant),
        "hysteresis": [program_of(model) for model in sensor.hysteresis or ()],
        "mass": float(sensor.mass), "centre": sensor.centre.tolist(), "inertia": sensor.inertia.tolist(),
        "gravity": list(AT_REST.gravity),
    }  # fmt: skip


def _affine(f: Callable[[Any], Any]) -> dict[str, Any]:
    """f(x) = matrix x + constant of six numbers: the columns are the values at unit vectors."""
    constant = f(jnp.zeros((6,)))
    matrix = f(jnp.eye(6)) - constant[None]
    return {"matrix": matrix.T.tolist(), "constant": constant.tolist()}


def _golden(solver: ContactSolver, sensor: WristSensor | None) -> dict[str, Any]:
    """Normal and slanting presses near the middle of some faces, and the contacts that JAX computes."""
    faces = solver.shape.faces()
    chosen = np.unique(np.linspace(0, len(faces.offset) - 1, 8).astype(int))
    centre = -np.asarray(faces.offset)[:, None] * np.asarray(faces.normal)
    random, strength = np.random.default_rng(0), (0.5, 4.0, 12.0, 8.0, 15.0, 3.0, 1.4, 0.2)
    normal = np.repeat(np.asarray(faces.normal)[chosen], len(strength), axis=0)
    slant = 0.2 * random.normal(size=normal.shape)
    force = np.tile(strength, len(chosen))[:, None] * (normal + slant)
    moment = np.cross(np.repeat(centre[chosen], len(strength), axis=0), force)
    t = 0.1 * np.arange(len(force))
    readings, doubt = np.hstack([force, moment]), np.zeros(len(force), int)
    if sensor is not None:
        readings = np.asarray(sensor.respond(force, moment))
        force, moment, doubt = map(np.asarray, sensor.simulate(t, readings))
    contacts = solver.simulate(t, force, moment, doubt)
    return {
        "t": t.tolist(), "reading": readings.tolist(),
        "point": contacts.point.tolist(), "surface": contacts.surface.tolist(),
        "status": contacts.status.tolist(),
        "tolerance": 1e-9 * max(float(solver.shape.longest()), 1e-300),
    }  # fmt: skip
