"""A ROS 2 package: filter plugins for numbers and for wrenches."""

from pathlib import Path

from .._export import Exported, Program
from ._artefact import Artefact, name_in_c


def ros2(program: Program, out: Path, real: str) -> Exported:
    """Write a package that colcon builds."""
    made = Artefact(program, name_in_c(out, lower=True), real)
    made.add_header(f"src/{made.stem}.h")
    made.add_template("ros2/filter.cpp", "src/filter.cpp")
    for name in ("plugins.xml", "package.xml", "CMakeLists.txt", "README.md"):
        made.add_template(f"ros2/{name}", name)
    made.add_template("ros2/filters.yaml", "config/filters.yaml")
    made.add_template("ros2/ci.yml", ".github/workflows/build.yml")
    made.add_runtime()
    return Exported(made.write_folder(out), (*program.notes, *made.notes))
