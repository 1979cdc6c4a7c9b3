"""Whether a fit finds the parameters that made a record, from a start a decade away from each.

python -m benchmarks.recovery [--quick] [--json] [--only TEXT]

Of every model: simulated records of parameters drawn at random, with white noise of a per cent of the
output's range. Each is fitted from a start in which every parameter is ten times too large or too small, at
random; of one between two bounds its odds are. A parameter counts as found where the truth lies in its own
95 per cent interval, and the fit came to the objective that a search from the truth itself comes to; one
without an honest interval was not found.

Beside it, in how many runs the far start comes there all alone: without the random starts about it, and
without what the record itself suggests.

Set OMP_NUM_THREADS=1: the many small factorisations are up to twenty times slower with two.
"""

import sys
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import (
    AbstractModel,
    BoucWen,
    Burgers,
    FoamCurve,
    GeneralizedMaxwell,
    LinearSponge,
    Preisach,
    Record,
    StandardLinearSolid,
)
from hysteresis.preisach import GaussianDensity
from identify import FitResult, fit
from identify.parameters._transform import Transform, transform
from identify.parametric._multistart import Problem
from identify.records._new_record import prepare

from ._measure import Row, judged, noted, options, report
from ._preisach.inputs import evaluate

NOISE = 0.01
"""Standard deviation of the noise, of the output's range."""

RUNS, FOUND = 100, 88
"""A sound interval holds the truth in 95 of 100 runs, give or take 2.2: that is three of those below."""

SAME = 1.001
"""Objectives that differ by less are those of one minimum: the noise moves them by 1 / sqrt(rows)."""

Draw = Callable[[np.random.Generator], AbstractModel]


class Case(NamedTuple):
    """A model whose parameters are drawn, and the input (and times) of its records.

    - `twins`: arrays whose entries a fit may give in any order, the one that orders them first.
    """

    name: str
    draw: Draw
    t: np.ndarray | None
    u: np.ndarray
    twins: tuple[str, ...] = ()


class Run(NamedTuple):
    """Which parameters were found, and whether the least objective was reached: by the fit, and by a search
    from the far start alone."""

    found: dict[str, bool]
    best: bool
    alone: bool


def minor_loops(low: float, high: float, samples: int) -> np.ndarray:
    """Ways between turning points that come ever closer to the middle, and apart again."""
    sizes = np.array([0, 1, 0.1, 0.85, 0.25, 0.7, 0.4, 0.6, 0.3, 0.9, 0, 1])
    return low + (high - low) * np.interp(np.linspace(0, 11, samples), np.arange(12), sizes)


def _about(rng: np.random.Generator, *centres: float) -> list[float]:
    """Each within a factor of 1.5 of its centre."""
    return [float(c * 1.5 ** rng.uniform(-1, 1)) for c in centres]


def _sponge(rng: np.random.Generator) -> LinearSponge:
    K, b = _about(rng, 1.3, 6.0)
    return LinearSponge(K, b, 1.5)


def _foam(rng: np.random.Generator) -> FoamCurve:
    toe, plateau = _about(rng, 0.2, 0.2)
    linear, first, second, third = _about(rng, 2.0, 2.0, 3.0, 6.0)
    rounding, densification, offset = _about(rng, 0.3, 0.5, 0.5)
    return FoamCurve(
        linear, toe, plateau, first, second, third, rounding, densification, offset
    )  # fmt: skip


def _burgers(rng: np.random.Generator) -> Burgers:
    E1, eta1, E2, eta2, offset = _about(rng, 2.0, 100.0, 1.0, 8.0, 0.3)
    return Burgers(E1, eta1, E2, eta2, offset)


def _solid(rng: np.random.Generator) -> StandardLinearSolid:
    E1, E2, eta2, offset = _about(rng, 2.0, 1.0, 8.0, 0.3)
    return StandardLinearSolid(E1, E2, eta2, offset)


def _maxwell(rng: np.random.Generator) -> GeneralizedMaxwell:
    rest, first, second, short, long, offset = _about(rng, 1.0, 1.0, 1.0, 1.0, 15.0, 0.3)
    return GeneralizedMaxwell(rest, [first, second], [short, long], offset)


def _bouc_wen(rng: np.random.Generator) -> BoucWen:
    k, alpha, yield_at, n, offset = _about(rng, 2.0, 0.2, 0.5, 2.0, 0.3)
    return BoucWen(k, alpha, yield_at, n, rng.uniform(-0.5, 0.5), offset)


def _preisach(rng: np.random.Generator) -> Preisach:
    total, coercivity, bias, offset = _about(rng, 1.0, 0.3, 0.1, 0.3)
    widths = _about(rng, 0.12, 0.2)
    density = GaussianDensity(-1.0, 1.0, total, coercivity, widths[0], bias, widths[1])
    return Preisach(density, offset=offset)


def cases() -> list[Case]:
    """Every model, on an input that shows all of its parameters."""
    t = np.cumsum(np.random.default_rng(0).uniform(0.1, 0.3, 400))
    # Jumps, rests and ramps: what is fast and what is slow, apart.
    steps = np.interp(
        t, np.linspace(0, t[-1], 17), np.tile([0.0, 5.0, 5.0, 5.0, 1.0, 1.0, 3.0, 3.0], 3)[:17]
    )
    ramp = np.linspace(0.0, 15.0, 2000)
    return [
        Case("LinearSponge", _sponge, None, ramp),
        Case("FoamCurve", _foam, None, ramp),
        Case("StandardLinearSolid", _solid, t, steps),
        Case("Burgers", _burgers, t, steps),
        Case("GeneralizedMaxwell, 2 branches", _maxwell, t, steps, ("tau", "E")),
        Case("BoucWen", _bouc_wen, None, minor_loops(-2.0, 2.0, 200)),
        Case("Preisach, GaussianDensity", _preisach, None, minor_loops(-1.0, 1.0, 300)),
    ]  # fmt: skip


def far_from(truth: AbstractModel, bounds: Transform, rng: np.random.Generator) -> AbstractModel:
    """Every parameter, or the odds of one between two bounds, multiplied or divided by ten."""
    z = bounds.to_free(truth)
    bounded = np.isfinite(bounds.low) | np.isfinite(bounds.high)
    way = rng.choice([-1.0, 1.0], len(z))
    far = np.where(bounded, z + way * np.log(10), z * 10.0**way)
    return bounds.insert(truth, bounds.to_values(jnp.asarray(far)))


def one_run(case: Case, number: int) -> Run:
    """A record of its own, and its fit from far."""
    rng = np.random.default_rng([number, len(case.name)])
    truth = case.draw(rng)
    y = np.asarray(truth.simulate(case.t, case.u))
    y = y + rng.normal(0, NOISE * np.ptp(y), len(y))
    record = Record.from_arrays(case.u, y, case.t)
    bounds = transform(truth, float(np.ptp(y)), float(np.ptp(case.u))).for_fit
    start = far_from(truth, bounds, rng)
    result = fit(record, start, seed=number)
    used, prepared = result.used, prepare(truth, record)

    def objective(model: AbstractModel) -> float:
        return float(np.mean((np.asarray(evaluate(model, prepared)) - y)[used] ** 2))

    def nearest(model: AbstractModel) -> float:
        problem = Problem(bounds, truth, prepared, y)
        z = problem.refined(1.0 * used, bounds.to_free(model)).free
        return objective(bounds.insert(truth, bounds.to_values(jnp.asarray(z))))

    least = SAME * nearest(truth)
    found, best = _found(case, truth, bounds, result), objective(result.model) <= least
    return Run(
        {name: best and holds for name, holds in found.items()}, best, nearest(start) <= least
    )


def _found(
    case: Case, truth: AbstractModel, bounds: Transform, result: FitResult
) -> dict[str, bool]:
    """Of every free parameter, whether the truth lies within 1.96 of its standard errors."""
    fitted = {p.name: p for p in result.parameters}
    for array in case.twins:
        order = np.argsort(np.asarray(getattr(result.model, case.twins[0])))
        fitted |= {f"{array}.{k}": fitted[f"{array}.{j}"] for k, j in enumerate(order)}

    def holds(name: str, value: float) -> bool:
        at, error = fitted[name].value, fitted[name].stderr
        return error is not None and bool(abs(at - value) <= 1.96 * error)

    return {n: holds(n, v) for n, v in zip(bounds.names, bounds.values(truth), strict=True)}


def rows_of(case: Case, quick: bool) -> list[Row]:
    """The worst parameter of a model, and how its runs came to their minimum."""
    runs = 5 if quick else RUNS
    done = [one_run(case, k) for k in range(runs)]
    counts = {name: sum(run.found[name] for run in done) for name in done[0].found}
    worst = min(counts, key=lambda name: counts[name])
    what = f"{case.name}: found, of {runs} runs, worst parameter ({worst})"
    row = judged(what, counts[worst], FOUND * runs / RUNS, at_least=True)
    if quick:
        row = row._replace(met=None, reason=f"{runs} runs cannot tell 95 % from less")
    return [
        row,
        noted("runs that reach the least objective", sum(r.best for r in done)),
        noted("from the far start alone", sum(r.alone for r in done)),
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit all records of all models and print; the exit status."""
    chosen = options(
        "benchmarks.recovery", __doc__, arguments, only="models with this in their name"
    )
    jax.config.update("jax_enable_x64", True)
    some = [case for case in cases() if (chosen.only or "") in case.name]
    report([row for case in some for row in rows_of(case, chosen.quick)], chosen.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
