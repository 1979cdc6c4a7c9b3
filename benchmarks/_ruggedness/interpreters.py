"""Simulations and fits computed anew by other processes: with other threads, and by another Python.

python -m benchmarks._ruggedness.interpreters FILE writes what its interpreter computes.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

import numpy as np

from .._measure import Row, judged, noted

ROOT = Path(__file__).parents[2]
TOOLS = ("hypothesis", "pytest")
SAME_VERSIONS = ("jax", "jaxlib", "numpy", "scipy", "equinox", "optimistix")
MODELS = ("LinearSponge", "Burgers", "Preisach", "Composition")
ONE = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
}
TWO = {"OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2", "XLA_FLAGS": ""}
SAME_OUTPUT, SAME_FIT = 1e-12, 1e-3
"""Largest difference of a simulated output over its range, and of a fit in standard errors."""

Numbers = dict[str, np.ndarray]


def rows(python: str = "") -> list[Row]:
    """This interpreter with two threads, and another Python, beside this one with one thread.

    `python`: an interpreter that has what hysid needs, hypothesis and pytest. Without one an environment is
    made below build/ of the newest other Python from 3.11 on that is found.
    """
    here = _computed_by(sys.executable, ONE)
    found = _compared("two threads", here, _computed_by(sys.executable, TWO))
    own = f"{sys.version_info.major}.{sys.version_info.minor}"
    what = f"another Python than {own}: outputs and fits"
    try:
        python = python or _environment()
        there = _computed_by(python, ONE)
    except MissingInterpreterError as missing:
        return [*found, noted(what, float("nan"), reason=str(missing))]
    asked = [python, "-c", "import platform; print(platform.python_version())"]
    other = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    return [*found, *_compared(f"Python {other} beside {own}", here, there)]


class MissingInterpreterError(Exception):
    """There is no other interpreter, or it lacks something; says how to get it."""


def _computed_by(python: str, own: dict[str, str]) -> Numbers:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "numbers.npz")
        run = subprocess.run(
            [python, "-m", "benchmarks._ruggedness.interpreters", str(file)], cwd=ROOT,
            env=os.environ | own | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if run.returncode:
            said = run.stderr.strip().splitlines()[-1:]
            how = f"{python} -m pip install --editable {ROOT} {' '.join(TOOLS)}"
            raise MissingInterpreterError(f"{python} fails with {' '.join(said)}; {how}")
        with np.load(file) as arrays:
            return {name: arrays[name] for name in arrays.files}


def _environment() -> str:
    """The interpreter of an environment of another Python, which is made where it is not there yet."""
    versions = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions")
    for minor in range(30, 10, -1):
        if minor == sys.version_info.minor:
            continue
        names = [f"python3.{minor}", *map(str, versions.glob(f"3.{minor}.*/bin/python"))]
        for name in filter(shutil.which, names):
            if subprocess.run([name, "-c", ""], capture_output=True, check=False).returncode == 0:
                return _made(name, ROOT / "build" / "ruggedness" / f"python3.{minor}")
    raise MissingInterpreterError(
        "needs a second Python from 3.11 on: --python PATH names its environment"
    )


def _made(python: str, place: Path) -> str:
    made = str(place / "bin" / "python")
    if not Path(made).exists():
        print(f"filling {place} ...", file=sys.stderr, flush=True)
        # With other versions of JAX or NumPy numbers are others, whatever the Python.
        same = [f"{name}=={version(name)}" for name in SAME_VERSIONS]
        install = [made, "-m", "pip", "install", "--quiet", "--editable", str(ROOT)]
        for command in ([python, "-m", "venv", str(place)], [*install, *TOOLS, *same]):
            run = subprocess.run(command, capture_output=True, text=True, check=False)
            if run.returncode:
                shutil.rmtree(place, ignore_errors=True)
                said = " ".join(run.stderr.strip().splitlines()[-1:])
                raise MissingInterpreterError(f"{python}: {said}; --python PATH names one")
    return made


def _compared(what: str, here: Numbers, there: Numbers) -> list[Row]:
    assert here.keys() == there.keys()
    outputs = {name: y for name, y in here.items() if name.startswith("output ")}
    fitted = {name: y for name, y in here.items() if name.startswith("fit ")}
    apart = {name: _largest(there[name] - y, np.ptp(y) or 1.0) for name, y in outputs.items()}
    of_fits = {
        name: _largest(there[name] - y, here[f"error of {name}"]) for name, y in fitted.items()
    }
    rows = []
    for kind, each, bar in (
        (f"outputs of {len(apart)} models, differences over the range", apart, SAME_OUTPUT),
        (f"fits of {len(MODELS)} models, in standard errors", of_fits, SAME_FIT),
    ):
        worst = max(each, key=each.__getitem__)
        if each[worst] > bar:
            print(f"{what}: {worst} differs by {each[worst]:.3g}", file=sys.stderr)
        rows.append(judged(f"{what}: {kind}", each[worst], bar))
    return rows


def _largest(difference: np.ndarray, size: np.ndarray | float) -> float:
    """The largest difference, over its size."""
    return float(np.max(np.abs(difference / size), initial=0.0))


def computed() -> Numbers:
    """Outputs of every model of the tests, and fits with their errors: of parameters and predictions."""
    # Only in the process that computes, which sets its precision first.
    import jax

    jax.config.update("jax_enable_x64", True)
    import identify
    from hysteresis import Record
    from tests.problems import PROBLEMS, SAMPLES, clock, random_histories
    from tests.test_hysid.command import sponge

    found: Numbers = {}
    for problem in PROBLEMS:
        u = random_histories(np.random.default_rng(0), problem.low, problem.high, (1, SAMPLES))[0]
        model = problem.model()
        step = 0.1 * np.diff(clock(0), prepend=0.0)
        if getattr(model, "hold", "") == "constant":
            step = np.minimum(step, 0.2 * float(model.largest_stable_step()))  # type: ignore[attr-defined]
        found[f"output {problem.name}"] = np.asarray(model.simulate(np.cumsum(step), u))
    t, force, stroke = (np.array(column, float) for column in list(zip(*sponge(), strict=True))[:3])
    record = Record.from_arrays(force, stroke, time=t)
    for name in MODELS:
        fit = identify.fit(record, name)
        known = [(p.value, p.stderr) for p in fit.parameters if p.stderr]
        found[f"fit {name}"], found[f"error of fit {name}"] = np.array(known).T
        predicted = fit.predict(record)
        found[f"fit {name}, predicted"] = predicted
        found[f"error of fit {name}, predicted"] = np.array(np.std(stroke - predicted))
    return found


if __name__ == "__main__":
    np.savez(sys.argv[1], **computed())  # type: ignore[arg-type]
