"""Beyond their grids models go on as play operators, and inside they are what they were."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from hysteresis import LinearSponge, MonotoneCurve, Scaled, Series, Sum
from hysteresis.internal import extended
from hysteresis.preisach import GridDensity, Preisach
from tests.thorough import rest_thorough

CELLS = 6


def model(leading: bool = False, initial: object = "negative", nodes: object = None) -> Preisach:
    weights = np.tril(np.random.default_rng(0).uniform(0.1, 1.0, (CELLS, CELLS)))
    steep = 2 * (weights.sum(0) + weights.sum(1))
    return Preisach(
        GridDensity(0.0, 1.0, weights, nodes=nodes), steep, 0.3, leading=leading, initial=initial
    )  # type: ignore[arg-type]


UNEVEN = tuple(np.linspace(0, 1, CELLS + 1) ** 1.5)
CASES = rest_thorough([
    model(initial=(0.7, 0.2, 0.5)), model(nodes=UNEVEN), Sum([model(), model(True)]),
    Scaled(model(), -2.0, 1.0), Series([MonotoneCurve.even(0.0, 1.0, np.array([0.2, 0.8])), model()]),
    model(), model(True), model(initial="positive"), model(initial="demagnetised"),
], 3)  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_inside_nothing_changes(case: Any):
    # One long history: every length of the memory would be compiled anew.
    u = np.random.default_rng(3).uniform(0, 1, 400)
    u[::40], u[20::40] = 0.0, 1.0
    wide = extended(case, -0.4, 1.7)
    # Sums of some two hundred masses up to 1, rounded.
    np.testing.assert_allclose(wide.simulate(None, u), case.simulate(None, u), rtol=0, atol=1e-11)  # type: ignore[attr-defined]


@pytest.mark.parametrize("case", CASES)
def test_the_output_is_continuous_at_the_seam_and_rises_beyond(case: Any):
    wide = extended(case, -0.4, 1.7)
    for path in (np.linspace(0.9, 1.7, 81), np.linspace(0.1, -0.4, 81)):
        y = np.asarray(wide.simulate(None, np.concatenate([[path[0]], path])))[1:]
        step = np.diff(y) * (-1 if isinstance(case, Scaled) else 1) * np.sign(path[-1] - path[0])
        assert np.all(step > 0)
        assert step.max() < 0.05 * np.ptp(y)  # no jump: four times the mean step of 80


def test_other_models_are_given_back():
    line = LinearSponge(1.0, 0.0)
    assert extended(line, -9.0, 9.0) is line
    within = model()
    assert extended(within, 0.2, 0.8) is within
    fitted = Preisach(
        GridDensity(0.0, 1.0, jnp.ones((CELLS, CELLS))), up=0.5 * jnp.ones((CELLS, CELLS))
    )
    assert extended(fitted, -1.0, 2.0) is fitted
