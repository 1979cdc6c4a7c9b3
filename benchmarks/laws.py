"""Laws written once: how large the house is, what running and inverting them costs, and their derivatives.

python -m benchmarks.laws [--quick] [--json] [--only TEXT]

Parts: house (lines, files, steps written out, compensators), outputs and inverses (nanoseconds a row, of
1e5 rows, once compiled), derivatives (columns against differences), fits (processor time, warm).
"""

import ast
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import identify
from hysteresis import (
    AbstractModel,
    BoucWen,
    Burgers,
    InputError,
    MonotoneCurve,
    PrandtlIshlinskii,
    Record,
    Sum,
)
from hysteresis.running import _over_time as over_time
from hysteresis.running import numbers_of
from tests.problems import PROBLEMS

from ._measure import Row, judged, least_seconds, noted, run_parts
from ._preisach.inputs import random_model

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("hysteresis", "identify", "compensate", "hysid")
ROWS = 100_000
UNSEEN = 0.9
"""Of rows: at the others a step of the differences crosses a kink."""


def house(quick: bool) -> list[Row]:
    """Counts over the syntax tree of the four packages."""
    texts = [f.read_text("utf-8") for name in PACKAGES for f in (ROOT / name).rglob("*.py")]
    laws = [
        ast.parse(f.read_text("utf-8"))
        for name in ("hysteresis", "compensate")
        for f in (ROOT / name).rglob("*.py")
    ]
    nodes = [node for tree in laws for node in ast.walk(tree)]
    steps = [n for n in nodes if isinstance(n, ast.FunctionDef) and n.name == "step"]
    compensators = [
        n for n in nodes if isinstance(n, ast.ClassDef) and n.name.endswith("Compensator")
    ]
    return [
        judged("lines of the four packages", sum(len(t.splitlines()) for t in texts), 70_000),
        judged("their files", len(texts), 500),
        judged("`def step(` in hysteresis and compensate", len(steps), 14),
        judged("classes named Compensator", len(compensators), 8),
    ]


def _walk(low: float, high: float, seed: int = 0) -> np.ndarray:
    """Between turning points in the range, with ten samples on each way."""
    random = np.random.default_rng(seed)
    turns = random.uniform(low, high, ROWS // 10 + 1)
    return np.interp(np.arange(ROWS) / 10, np.arange(len(turns)), turns)


def _models() -> dict[str, tuple[AbstractModel, np.ndarray]]:
    plays = PrandtlIshlinskii(np.linspace(0.05, 0.5, 5), np.full(5, 0.2), 1.0)
    two = Sum(MonotoneCurve.even(-1.0, 1.0, np.array([0.5, 1.0, 2.0])), plays)
    return {
        "Preisach": (random_model(), _walk(0.0, 1.0)),
        "plays": (plays, _walk(-1.0, 1.0)),
        "a sum of two": (two, _walk(-1.0, 1.0)),
        "Burgers": (Burgers(2.0, 40.0, 1.0, 5.0), _walk(-1.0, 1.0)),
        "Bouc-Wen": (BoucWen(2.0, 0.25, 0.3, 1.5, 0.2), _walk(-1.0, 1.0)),
    }


INVERSES = {"Preisach": 200.0, "plays": 300.0, "a sum of two": 8_000.0, "Bouc-Wen": 4_000.0}


def outputs(quick: bool) -> list[Row]:
    """Beside the parallel form in JAX where a model keeps one."""
    dt, found = np.full(ROWS, 0.01), []
    for name, (model, u) in _models().items():
        own, t = numbers_of(model.tree()), np.cumsum(dt)
        prepared = model.prepare(t, u)
        calls: dict[str, Callable[[], Any]] = {
            "law": lambda own=own, u=u: over_time.run(own, u, dt),
            "model": lambda model=model, prepared=prepared: model.evaluate(prepared),
        }
        seconds = least_seconds(calls, 3 if quick else 10)
        found.append(noted(f"outputs, {name}: ns", 1e9 * seconds["law"] / ROWS))
        found.append(
            noted(f"outputs, {name}: of the model's time", seconds["law"] / seconds["model"])
        )
    return found


def inverses(quick: bool) -> list[Row]:
    dt, found = np.full(ROWS, 0.01), []
    for name, (model, u) in _models().items():
        own = numbers_of(model.tree())
        y = over_time.run(own, u, dt).value
        seconds = least_seconds({name: lambda own=own, y=y: over_time.find(own, y, dt)}, 3)[name]
        what, value = f"inverse, {name}: ns", 1e9 * seconds / ROWS
        bar = INVERSES.get(name)
        found.append(noted(what, value) if bar is None else judged(what, value, bar))
    return found


def derivatives(quick: bool) -> list[Row]:
    """The worst of all problems whose tree runs forwards; the text is run by Python where `quick`."""
    worst, random, rows = 0.0, np.random.default_rng(0), 100
    for problem in PROBLEMS:
        try:
            tree = problem.model().tree()
        except InputError:
            continue
        if tree["kind"] == "oscillator":
            continue
        own = numbers_of(tree)
        u = _walk(problem.low, problem.high)[:rows]
        dt = random.uniform(0.01, 0.1, rows)
        dm = np.zeros((len(own.m), 1))
        free = np.array(own.known.free, int)
        free = free[(np.abs(own.m[free]) < 1e29) & (free < len(own.m) - own.known.states)]
        dm[free, 0] = random.uniform(-1, 1, len(free)) * np.abs(own.m[free])
        columns = over_time.tangents(own, dm, u, dt).columns[:, 0]
        up, down = (
            over_time.run(own._replace(m=own.m + s * dm[:, 0]), u, dt).value for s in (1e-6, -1e-6)
        )
        differences = (up - down) / 2e-6
        off = np.quantile(np.abs(columns - differences), UNSEEN) / np.abs(differences).max()
        worst = max(worst, float(off))
    return [
        judged("columns of every law against differences, in parts of the largest", worst, 1e-7)
    ]


def fits(quick: bool) -> list[Row]:
    """Six parameters of Bouc-Wen from 1,000 rows, 8 starts: the second fit of a process."""
    t = np.arange(1000) * 0.01
    u = np.sin(np.pi * t) * np.linspace(0.2, 1, 1000)
    y = np.asarray(BoucWen(2.0, 0.25, 0.3, 1.5, 0.2).simulate(None, u))
    y = y + np.random.default_rng(0).normal(0, 0.005, 1000)
    record = Record.from_arrays(time=t, input=u, output=y)
    for _ in range(2):
        begun = time.process_time()
        identify.fit(record, "BoucWen", noise="gaussian", starts=8)
        taken = time.process_time() - begun
    return [judged("fit of Bouc-Wen, 8 starts: s of processor time", taken, 8.0)]


PARTS = {
    "house": house,
    "outputs": outputs,
    "inverses": inverses,
    "derivatives": derivatives,
    "fits": fits,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the figures."""
    with over_time.compiled_at_once():
        run_parts("benchmarks.laws", __doc__, PARTS, arguments)


if __name__ == "__main__":
    sys.exit(main())
