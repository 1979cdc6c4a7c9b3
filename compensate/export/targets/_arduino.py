"""An Arduino and PlatformIO library: the header, its tables in flash, and an example."""

from pathlib import Path

from .._export import Exported, Program
from ._artefact import Artefact, name_in_c
from ._fixed_point import add_fixed_point


def arduino(program: Program, out: Path, real: str) -> Exported:
    """Write library.properties, library.json, src/NAME.h and an example sketch."""
    made = Artefact(program, name_in_c(out), real)
    if real == "fixed":
        add_fixed_point(made, f"src/{made.stem}.h")
    else:
        made.add_header(f"src/{made.stem}.h")
    made.add_template("arduino/library.properties", "library.properties")
    made.add_template("arduino/library.json", "library.json")
    example = "arduino/example_fixed.ino" if real == "fixed" else "arduino/example.ino"
    made.add_template(example, "examples/Compensate/Compensate.ino")
    made.add_template("arduino/README.md", "README.md")
    made.add_runtime()
    return Exported(made.write_folder(out), (*program.notes, *made.notes))
