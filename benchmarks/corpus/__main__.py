"""What laws, inverses, exports and fits gave on a known day: frozen numbers, and a comparison with them.

python -m benchmarks.corpus [--freeze yes] [--quick] [--json] [--only TEXT]

`laws`: of every problem of the tests, outputs, their derivatives by each input and by each parameter, the
inverse with its statuses, and each step of the exported compensator with its status and deviation. `fits`:
parameters, errors, scores and verdicts on the records in datasets/ and on records of models with noise.

A number may be off by 1e-9 of the largest of its array; `EXCEPTIONS` names what may be off by more, and
why. `--freeze yes` writes the numbers again: only where other numbers are what was wanted, with a word in
the commit on which changed. Inputs are drawn by NumPy, whose streams are promised not to change.
"""

import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import hysid
from compensate import export_runtime, invert
from compensate.runtime import load
from hysteresis import AbstractModel, Burgers, InputError, Record
from tests.problems import PROBLEMS, Problem, random_histories

from .._measure import Row, judged, options, report

NUMBERS = Path(__file__).parent / "numbers.npz"
DATASETS = Path(__file__).parents[2] / "datasets"
ROWS = 60
TOLERANCE = 1e-9
EXCEPTIONS: dict[str, tuple[float, str]] = {
    "fits": (1e-5, "a solver stops within a tolerance of its own, and flat directions widen it"),
}
"""Beginnings of names, what their numbers may be off by, and why."""

Numbers = dict[str, np.ndarray]


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the numbers, and write or compare them."""
    chosen = options(
        "benchmarks.corpus", __doc__, arguments, only="names with this in them",
        freeze="yes: write the numbers again",
    )  # fmt: skip
    jax.config.update("jax_enable_x64", True)
    frozen = dict(np.load(NUMBERS)) if NUMBERS.exists() else {}
    made: Numbers = {}
    for name, make in _entries():
        if (chosen.only or "") in name and not (chosen.quick and name.startswith("fits")):
            print(f"{name} ...", file=sys.stderr, flush=True)
            made |= {f"{name}/{what}": np.asarray(x) for what, x in make().items()}
    if chosen.freeze == "yes":
        np.savez_compressed(NUMBERS, allow_pickle=False, **(frozen | made))
    else:
        report(_compared(made, frozen), chosen.json)


def _compared(made: Numbers, frozen: Numbers) -> list[Row]:
    """Rows of how many arrays there are, and how many are off; each of these is printed."""
    off = []
    for name, x in made.items():
        fault = _off(name, x, frozen[name]) if name in frozen else "not in the corpus"
        if fault:
            off.append(name)
            print(f"{name}: {fault}", file=sys.stderr, flush=True)
    what = f"numbers of the corpus that are off, of {len(made)} arrays"
    return [judged(what, len(off), 0)]


def _off(name: str, now: np.ndarray, then: np.ndarray) -> str:
    """What is off in an array; "" where nothing is."""
    if now.shape != then.shape or now.dtype.kind != then.dtype.kind:
        return f"{now.dtype}{now.shape} for {then.dtype}{then.shape}"
    if then.dtype.kind != "f":
        changed = np.flatnonzero(now != then)
        return f"{now.flat[changed[0]]} for {then.flat[changed[0]]}" if changed.size else ""
    share = next((x for start, (x, _) in EXCEPTIONS.items() if name.startswith(start)), TOLERANCE)
    if np.any(np.isfinite(now) != np.isfinite(then)):
        return "a number became NaN or infinite, or the other way round"
    good = np.isfinite(then)
    size = float(np.max(np.abs(then[good]), initial=0.0))
    miss = float(np.max(np.abs(now[good] - then[good]), initial=0.0))
    return f"off by {miss / size:.1e} of {size:.3g}" if miss > share * size else ""


def _entries() -> Iterator[tuple[str, Callable[[], Numbers]]]:
    for problem in PROBLEMS:
        yield f"laws/{problem.name}", lambda problem=problem: _law(problem)
    for name, (record, model) in _records().items():
        yield f"fits/{name}", lambda record=record, model=model: _fit(record(), model)


def _law(problem: Problem) -> Numbers:
    """A problem's numbers over one random history."""
    model = problem.model()
    u = random_histories(np.random.default_rng(7), problem.low, problem.high, (2, ROWS))[1]
    step = 10.0 ** np.random.default_rng(8).uniform(-2, 0.5, ROWS)
    if isinstance(model, Burgers) and model.hold == "constant":
        step = np.minimum(step, 0.9 * model.largest_stable_step())
    t = np.cumsum(step)
    weight = jnp.asarray(np.random.default_rng(9).normal(size=ROWS))

    def summed(model: AbstractModel, u: Any) -> Any:
        return jnp.sum(weight * model.simulate(t, u))

    y = np.asarray(model.simulate(t, u))
    by_parameters = eqx.filter_grad(summed)(model, u)
    leaves = [np.ravel(leaf) for leaf in jax.tree.leaves(by_parameters)]
    found: Numbers = {
        "output": y,
        "by input": np.asarray(jax.jacfwd(lambda u: summed(model, u))(jnp.asarray(u))),
        "by parameters": np.concatenate(leaves) if leaves else np.zeros(0),
    }
    if "no-inverse" in problem.tags:
        return found
    value, status = invert(model).simulate(t, y)
    found |= {"inverse": np.asarray(value), "status": np.asarray(status)}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "it.json"
        export_runtime(model, file, y, times=t)
        exported = load(file)
    steps = [exported.step(dt, x) for dt, x in zip(np.diff(t, prepend=t[0]), y, strict=True)]
    return found | {
        "exported": np.array([one.value for one in steps]),
        "exported status": np.array([int(one.status) for one in steps]),
    }


def _records() -> dict[str, tuple[Callable[[], Record], str]]:
    """What is fitted, by name: how its record is made, and the model's name."""
    sponges = {"10mm": ("LinearSponge", "FoamCurve"), "50mm": ("Burgers", "Preisach", "auto")}
    found: dict[str, tuple[Callable[[], Record], str]] = {
        f"{stem} {model}": (lambda stem=stem: _sponge(f"sponge-{stem}-cycles.csv"), model)
        for stem, models in sponges.items()
        for model in models
    }
    mixed = "StandardLinearSolid", "EverettSurface", "auto"
    found |= {
        f"mixed {model}": (lambda: _sponge("sponge-50mm-mixed-cycles.csv"), model)
        for model in mixed
    }
    known = {
        "bouc-wen": "BoucWen",
        "burgers-leading-linear": "Burgers",
        "degrading-bouc-wen": "DegradingBoucWen",
        "duhem": "DuhemOperator",
        "foam": "FoamCurve",
        "kelvin-voigt": "GeneralizedKelvinVoigt",
        "maxwell": "GeneralizedMaxwell",
        "play-rates-bent": "PrandtlIshlinskii",
        "preisach-negative": "Preisach",
        "standard-solid": "StandardLinearSolid",
        "stops-by-span": "Composition",
    }
    for problem in PROBLEMS:
        if problem.name in known:
            model = known[problem.name]
            found[f"{problem.name} {model}"] = (lambda problem=problem: _made(problem), model)
    return found


def _sponge(file: str) -> Record:
    return hysid.read_csv(
        DATASETS / file, input="force (N)", output="displacement (mm)", time="time (s)"
    )


def _made(problem: Problem) -> Record:
    """Four cycles of growing amplitude of a problem's own model, with noise of 0.5 % of the range."""
    turn = np.linspace(0, 8 * np.pi, 320)
    swing = np.repeat([0.4, 0.6, 0.8, 1.0], 80) * np.sin(turn)
    u = problem.low + (problem.high - problem.low) * (0.5 + 0.45 * swing)
    t = 0.05 * np.arange(len(u))
    y = np.asarray(problem.model().simulate(t, u))
    noise = 0.005 * np.ptp(y) * np.random.default_rng(3).normal(size=len(y))
    return Record.from_arrays(u, y + noise, time=t)


def _fit(record: Record, model: str) -> Numbers:
    """Parameters, NaN where nothing tells them, errors and verdict; a refusal's code."""
    try:
        fit = hysid.fit(record, None, model, test_cycles=1)
    except InputError as error:
        return {"refused": np.array(error.code)}
    told = [np.nan if p.status == "unidentified" else float(p.value) for p in fit.parameters]
    return {
        "model": np.array(fit.name),
        "parameters": np.array(told, float),
        "rms errors": np.array([one.rmse for one in fit.metrics.values() if one]),
        "verdict": np.array([fit.verdict.level, *fit.verdict.codes]),
    }


if __name__ == "__main__":
    main()
