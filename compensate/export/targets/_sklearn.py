"""A Python package with an estimator for scikit-learn, and the runtime in plain Python that it runs."""

import inspect
from pathlib import Path

from hysteresis import laws

from ...runtime import _file
from .._export import Exported, Program
from .._trees import nodes_of
from ._artefact import Artefact, name_in_c

RUNTIME = Path(_file.__file__).parent
MODULES = ("_compensator.py", "_file.py", "_shape.py", "_status.py")
LAWS = Path(laws.__file__).parent


def sklearn(program: Program, out: Path, real: str) -> Exported:
    """Write a package that imports scikit-learn and NumPy, and nothing of hysid."""
    made = Artefact(program, name_in_c(out), real)
    made.words["step"] = made.usual_step
    made.add_template("sklearn/__init__.py.txt", "__init__.py")
    made.add_template("sklearn/README.md", "README.md")
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
    made.add_runtime()
    return Exported(made.write_folder(out), (*program.notes, *made.notes))
