"""`export_to`: a compensator for one of the targets."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError

from .._export import Exported, Program
from ._arduino import arduino
from ._fmu import fmu2, fmu3
from ._mujoco import mujoco
from ._onnx import onnx
from ._ros2 import ros2
from ._sklearn import sklearn

TARGETS: dict[str, tuple[Callable[[Program, Path, str], Exported], tuple[str, ...]]] = {
    "c": (lambda program, out, real: program.write_c(out, real), ("double", "float")),
    "runtime": (lambda program, out, real: program.write_runtime(out), ("double",)),
    "arduino": (arduino, ("float", "fixed")),
    "ros2": (ros2, ("double",)),
    "mujoco": (mujoco, ("double",)),
    "sklearn": (sklearn, ("double",)),
    "onnx": (onnx, ("double",)),
    "fmu": (fmu2, ("double",)),
    "fmu3": (fmu3, ("double",)),
}
"""What writes a target, and the numbers that it can have, the default first."""


def export_to(
    target: str,
    model: AbstractModel,
    path: str | Path,
    readings: ArrayLike,
    *,
    real: str | None = None,
    **options: Any,
) -> Exported:
    """Write the inverse of a model for a target; arguments otherwise as of `export_runtime`.

    Of an `Oscillator` it is the step from force to displacement, and `readings` are forces.

    **Arguments:**

    - `target`: "c" (a header), "runtime" (a file for plain Python), "arduino" (a library for Arduino and
      PlatformIO), "ros2" (a package of filter plugins), "mujoco" (an engine plugin), "sklearn" (a
      package with an estimator), "onnx" (a model of one step), "fmu" or "fmu3" (a unit of FMI 2.0 or 3.0
      for co-simulation).
    - `path`: of the file or folder. A folder that an earlier export wrote is replaced.
    - `real`: "double", "float", or "fixed" for integers (arduino only); by default what the target is used
      with.

    Raises `InputError` as `export_runtime` does, `bad-option` for a target or numbers that are unknown, and
    `would-overwrite` where the folder holds something else.

    **Example:**

        >>> done = compensate.export_to("arduino", model, folder / "sensor", model.simulate(t, u))
        >>> sorted(path.name for path in done.path.iterdir())
        ['README.md', 'examples', 'hysid-export.json', 'library.json', 'library.properties', 'src']
    """
    check(target, real)
    return write_to(target, Program(model, readings, **options), path, real)


def check(target: str, real: str | None) -> None:
    """Raise `InputError` `bad-option` where the target is unknown, or cannot have such numbers."""
    if target not in TARGETS:
        raise InputError(
            "bad-option", f"The target {target!r} is unknown.", fix=f"{', '.join(TARGETS)}."
        )
    reals = TARGETS[target][1]
    if real is not None and real not in reals:
        raise InputError(
            "bad-option",
            f"The target {target} has no numbers of type {real!r}.",
            fix=f"{' or '.join(reals)}.",
        )


def write_to(target: str, program: Program, path: str | Path, real: str | None) -> Exported:
    """`export_to` of what was prepared, once `check` found nothing."""
    write, reals = TARGETS[target]
    return write(program, Path(path), real or reals[0])
