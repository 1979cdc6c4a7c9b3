"""Inverses of the moving and of the output-dependent Preisach model, in saturation and beyond."""

from collections.abc import Callable

import numpy as np
import pytest

from compensate import Status, invert
from hysteresis import AbstractModel, InputError, MovingPreisach, OutputDependentPreisach, Preisach
from hysteresis.preisach import GridDensity
from tests.problems import CELLS, HIGH, LOW, weights

REVERSIBLE = np.full(CELLS, 0.3)
Draw = Callable[[Preisach], AbstractModel]
both = pytest.mark.parametrize(
    "draw",
    [lambda m: MovingPreisach(m, 0.02), lambda m: OutputDependentPreisach(m, [1.0, 2.0], -3.0)],
    ids=["moving", "output-dependent"],
)


def inner(reversible: np.ndarray | None, **options: str) -> Preisach:
    density = GridDensity(LOW, HIGH, weights(np.random.default_rng(0)))
    return Preisach(density, reversible, 0.7, **options)


@both
def test_beyond_saturation_the_reversible_part_goes_on(draw: Draw):
    model, u = draw(inner(REVERSIBLE)), np.array([0.0, HIGH + 1, HIGH + 2, 1.0, LOW - 1, 0.5])
    found = invert(model).simulate(None, model.simulate(None, u))
    np.testing.assert_allclose(found.value, u, rtol=0, atol=1e-7)  # slopes vanish at a reversal
    outside = np.array([False, True, True, False, True, False])
    wanted = np.where(outside, Status.EXTRAPOLATED, Status.OK)
    np.testing.assert_array_equal(found.status, wanted)


@both
def test_beyond_saturation_without_one_the_end_is_held(draw: Draw):
    model, u = draw(inner(None)), np.array([0.0, HIGH + 1, 1.0, LOW - 1, 0.5])
    y = np.asarray(model.simulate(None, u))
    found = invert(model).simulate(None, y + np.array([0.0, 1.0, 0.0, -1.0, 0.0]))
    saturated = np.array([False, True, False, True, False])
    np.testing.assert_array_equal(found.status == Status.SATURATED, saturated)
    again = np.asarray(model.simulate(None, found.value))
    np.testing.assert_allclose(again, y, rtol=0, atol=1e-9 * np.ptp(y))


@both
def test_samples_that_are_not_finite_are_held_from_the_first_on(draw: Draw):
    model = draw(inner(REVERSIBLE, initial="positive"))
    start = model.saturation()[1] if isinstance(model, MovingPreisach) else HIGH
    y = np.asarray(model.simulate(None, np.array([0.0, 1.0, 0.3, 0.6])))
    y = np.insert(y, [0, 2], [np.nan, np.inf])
    found = invert(model).simulate(None, y)
    wanted = [float(start), 0.0, 1.0, 1.0, 0.3, 0.6]
    np.testing.assert_allclose(found.value, wanted, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(found.status == Status.INVALID, ~np.isfinite(y))


def test_an_output_that_stands_still_is_refused():
    with pytest.raises(InputError, match=r"stands still.*\[not-invertible\]"):
        invert(OutputDependentPreisach(inner(REVERSIBLE), [1.0, 0.0]))
