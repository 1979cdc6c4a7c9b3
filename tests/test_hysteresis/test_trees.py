"""Every model's tree of laws: run forwards it is the model, and JAX traces and differentiates it."""

from functools import partial
from typing import Any

import numpy as np
import pytest

from hysteresis import (
    BoucWen,
    Burgers,
    Conditioned,
    DuhemForce,
    LinearSponge,
    MonotoneCurve,
    Oscillator,
    Preisach,
    Scaled,
    Series,
    Softening,
    Sum,
)
from hysteresis.curves import Clip, MonotoneSpline, PolynomialCurve
from hysteresis.laws._tree import node_of
from hysteresis.preisach import GaussianDensity, GridDensity
from hysteresis.trees import plain
from tests import compositions
from tests.problems import PROBLEMS, Problem, clock, random_histories, variants_thorough, weights
from tests.refusals import refuses

LOW, HIGH, ROWS = -1.0, 2.0, 60


def _conditioned(rng: np.random.Generator, scale: float = 0.0, axis: str = "linear") -> Conditioned:
    curves = [MonotoneCurve.even(LOW - k, HIGH + k, rng.uniform(0.1, 1.0, 4)) for k in range(3)]
    models = [Series([one, Burgers(*rng.uniform(1, 40, 4))]) for one in curves]
    turned = [Scaled(one, scale * rng.uniform(0.5, 2)) if scale else one for one in models]
    return Conditioned(turned, np.array([1.0, 2.0, 5.0]), axis=axis)


def _demagnetised(rng: np.random.Generator) -> Preisach:
    return Preisach(GridDensity(LOW, HIGH, weights(rng)), initial="demagnetised", capacity=16)


def _curves(rng: np.random.Generator) -> Series:
    spline = MonotoneSpline.even(0.0, HIGH, rng.uniform(0.1, 1, 4), rng.normal())
    return Series([Clip(0.0), spline, PolynomialCurve(rng.uniform(0.1, 1, 4))])


def _duhem_oscillator(rng: np.random.Generator) -> Oscillator:
    rising, falling = rng.uniform(0.2, 1, (2, 5))
    return Oscillator(400.0, 5.0, 1.5, DuhemForce(rising, falling, 2.0), 3)


def _without_range(rng: np.random.Generator) -> Sum:
    """Parts that do not say for which inputs they were made."""
    return Sum([BoucWen(rng.uniform(0.5, 2), 0.3, 0.4, 1.5), LinearSponge(rng.uniform(0.5, 2))])


MORE = {
    "conditioned": _conditioned, "demagnetised": _demagnetised, "curves": _curves,
    "conditioned-log": partial(_conditioned, scale=1.0, axis="logarithmic"),
    "conditioned-falling": partial(_conditioned, scale=-1.0, axis="reciprocal"),
    "without-range": _without_range,
    "recovering": lambda rng: Softening(LOW, HIGH, rng.uniform(0.1, 0.5, (3, 3)), 3.0, leading=False),
    "maxwell-leading": compositions.nonlinear_maxwell,
    "duhem-oscillator": _duhem_oscillator,
}  # fmt: skip
OTHERS = [
    Problem(name, make, LOW, HIGH, frozenset(), compositions.held) for name, make in MORE.items()
]
TREES = [*PROBLEMS, *OTHERS]
every = pytest.mark.parametrize("problem", variants_thorough(TREES))


@every
def test_run_forwards_it_is_the_model(problem: Problem):
    """To 1e-9 of the range. An oscillator goes from force to displacement by its `find`."""
    model = problem.model()
    u = random_histories(np.random.default_rng(0), problem.low, problem.high, (1, ROWS))[0]
    t = clock(1, ROWS)
    c = np.random.default_rng(2).uniform(0.5, 6.0, ROWS)
    conditioned = isinstance(model, Conditioned)
    y = np.asarray(model.simulate(t, np.column_stack([u, c]) if conditioned else u))
    takes: list[Any] = []
    it = node_of(plain(model.tree()), takes=takes)
    go = it.find if isinstance(model, Oscillator) else it.move
    found = []
    for dt, x, condition in zip(np.diff(t, prepend=t[0]).tolist(), u, c, strict=True):
        for take in takes:
            take(float(condition))
        found.append(go(dt, float(x)))
    assert np.abs(np.array(found) - y).max() <= 1e-9 * np.ptp(y)


def test_a_density_without_a_grid_has_no_tree():
    density = GaussianDensity(0.0, 1.0, 1.0, 0.1, 0.1, 0.5, 0.1)
    refuses("not-exportable", lambda: Preisach(density).tree(), "GaussianDensity")
