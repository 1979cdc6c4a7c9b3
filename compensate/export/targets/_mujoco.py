"""An engine plugin for MuJoCo: a sensor and an actuator, compiled where MuJoCo's package is installed."""

from importlib.util import find_spec
from pathlib import Path

from .._export import Exported, Program
from ._artefact import Artefact, name_in_c


def mujoco(program: Program, out: Path, real: str) -> Exported:
    """Write the plugin's source, how it is built, an example, and the library for this machine."""
    made = Artefact(program, name_in_c(out), real)
    made.words["predicts"] = program.predicts
    made.add_header(f"{made.stem}.h")
    made.add_template("mujoco/plugin.c", f"{made.stem}_plugin.c")
    sources = dict(made.files)
    for name in ("CMakeLists.txt", "example.xml", "README.md"):
        made.add_template(f"mujoco/{name}", name)
    made.add_runtime()
    package = find_spec("mujoco")
    folder = Path(package.origin).parent if package and package.origin else None
    libraries = sorted(folder.glob("libmujoco.so*")) if folder else []
    if folder and libraries:
        options = (f"-I{folder / 'include'}", str(libraries[-1]))
        binary = made.compiled(sources, f"{made.stem}_plugin.c", *options)
        if binary:
            made.files[f"lib{made.stem}.so"] = binary
    else:
        made.notes.append(
            "MuJoCo's Python package for Linux is not installed, so only sources were written; README.md"
            " says how they are built."
        )
    return Exported(made.write_folder(out), (*program.notes, *made.notes))
