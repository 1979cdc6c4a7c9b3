"""`export_to`: a compensator for one of the targets."""

import inspect
import platform
import sys
import uuid
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from hysteresis import InputError, laws

from ...runtime import _file
from .._cards import CARDS
from .._document import Model, nodes_of
from .._export import Exported, Program
from ._artefact import USED, Artefact, name_in_c
from ._fixed_point import add_fixed_point
from ._onnx import onnx

# A ROS 2 package: filter plugins for numbers and for wrenches.


def ros2(program: Program, out: Path, real: str) -> Exported:
    """Write a package that colcon builds."""
    made = Artefact(program, name_in_c(out, lower=True), real)
    made.add_header(f"src/{made.stem}.h")
    made.add_templates("ros2", {
        "filter.cpp": "src/filter.cpp", "filters.yaml": "config/filters.yaml",
        "ci.yml": ".github/workflows/build.yml",
    })  # fmt: skip
    return made.written(out)


# An Arduino and PlatformIO library: the header, its tables in flash, and an example.


def arduino(program: Program, out: Path, real: str) -> Exported:
    """Write library.properties, library.json, src/NAME.h and an example sketch."""
    made = Artefact(program, name_in_c(out), real)
    if real == "fixed":
        add_fixed_point(made, f"src/{made.stem}.h")
    else:
        made.add_header(f"src/{made.stem}.h")
    made.add_templates("arduino", {"example.ino": "examples/Compensate/Compensate.ino"})
    return made.written(out)


# An engine plugin for MuJoCo: a sensor and an actuator, compiled where MuJoCo's package is installed.


def mujoco(program: Program, out: Path, real: str) -> Exported:
    """Write the plugin's source, how it is built, an example, and the library for this machine."""
    made = Artefact(program, name_in_c(out), real)
    made.words["predicts"] = program.predicts
    source = f"{made.stem}_plugin.c"
    made.add_header(f"{made.stem}.h")
    made.add_templates("mujoco", {"plugin.c": source})
    package = find_spec("mujoco")
    folder = Path(package.origin).parent if package and package.origin else None
    libraries = sorted(folder.glob("libmujoco.so*")) if folder else []
    if folder and libraries:
        options = (f"-I{folder / 'include'}", str(libraries[-1]))
        made.add_compiled(f"lib{made.stem}.so", source, *options)
    else:
        made.notes.append(
            "MuJoCo's Python package for Linux is not installed, so only sources were written; README.md"
            " says how they are built."
        )
    return made.written(out)


# A Python package with an estimator for scikit-learn, and the runtime in plain Python that it runs.


RUNTIME = Path(_file.__file__).parent
MODULES = ("_compensator.py", "_file.py", "_status.py")
LAWS = Path(laws.__file__).parent


def sklearn(program: Program, out: Path, real: str) -> Exported:
    """Write a package that imports scikit-learn and NumPy, and nothing of hysid."""
    # A package named json would be imported in place of Python's own.
    made = Artefact(program, name_in_c(out, used=USED | sys.stdlib_module_names), real)
    made.add_templates("sklearn", {"__init__.py.txt": "__init__.py"})
    begin = '"""As much of compensate.runtime as a compensator needs."""\n'
    kinds = {node["kind"] for node in nodes_of(made.document["tree"])}
    for kind in kinds.intersection(laws.announced()):
        made.files[f"runtime/laws/{kind}.py"] = inspect.getsource(laws.module_of(kind))
        begin += f"from .laws import {kind}, announce\n\nannounce({kind})\n"
    made.files["runtime/__init__.py"] = begin
    for file in (*map(RUNTIME.joinpath, MODULES), *sorted(LAWS.glob("*.py"))):
        name = file.name if file.parent == RUNTIME else f"laws/{file.name}"
        text = file.read_text("utf-8").replace("from hysteresis.laws", "from .laws")
        made.files[f"runtime/{name}"] = text
    return made.written(out)


# A functional mock-up unit of FMI 2.0 or 3.0 for co-simulation: its sources, and a binary.


BINARIES = {2: {"x86_64": "linux64"}, 3: {"x86_64": "x86_64-linux", "aarch64": "aarch64-linux"}}
"""Folders of binaries, by version of FMI and machine."""


def fmu(program: Program, out: Path, real: str, version: int) -> Exported:
    """Write an FMU of a version of FMI."""
    made = Artefact(program, name_in_c(out), real)
    token = uuid.uuid5(uuid.NAMESPACE_OID, f"{made.stem} {version} {made.document['checksum']}")
    made.words |= {"token": f"{{{token}}}", "version": version}
    source = f"sources/{made.stem}_fmu.c"
    made.add_template("fmu/modelDescription.xml", "modelDescription.xml")
    made.add_header(f"sources/{made.stem}.h")
    made.add_template("fmu/fmu.c", source)
    if version == 3:
        made.add_template("fmu/buildDescription.xml", "sources/buildDescription.xml")
    made.add_runtime("resources/hysid-export.json")
    made.add_template("fmu/index.html", "documentation/index.html")
    if folder := BINARIES[version].get(platform.machine()):
        made.add_compiled(f"binaries/{folder}/{made.stem}.so", source)
    return Exported(made.write_archive(out), (*program.notes, *made.notes))


TARGETS: dict[str, tuple[Callable[[Program, Path, str], Exported], tuple[str, ...]]] = {
    "c": (lambda program, out, real: program.write_c(out, real), ("double", "float")),
    "runtime": (lambda program, out, real: program.write_runtime(out), ("double",)),
    "arduino": (arduino, ("float", "fixed")),
    "ros2": (ros2, ("double",)),
    "mujoco": (mujoco, ("double",)),
    "sklearn": (sklearn, ("double",)),
    "onnx": (onnx, ("double",)),
    "fmu": (partial(fmu, version=2), ("double",)),
    "fmu3": (partial(fmu, version=3), ("double",)),
}
"""What writes a target, and the numbers that it can have, the default first."""


def export_to(
    target: str,
    model: Model,
    path: str | Path,
    readings: ArrayLike,
    *,
    real: str | None = None,
    **options: Any,
) -> Exported:
    """Write the inverse of a model for a target; arguments otherwise as of `export_runtime`.

    Of an `Oscillator`, and of a `Feedback` of one input and output, it is the step from force to
    displacement, and `readings` are forces.

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
            "bad-option",
            f"The target {target!r} is unknown.",
            fix=f"{', '.join(TARGETS)}; of a material card: {', '.join(CARDS)}.",
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
