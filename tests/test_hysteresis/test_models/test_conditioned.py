"""Conditioned: a model at each of a few conditions, straight in the condition between them."""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from hysteresis import (
    Burgers,
    Conditioned,
    InputError,
    LinearSponge,
    MonotoneCurve,
    PrandtlIshlinskii,
    Preisach,
    Series,
    Sum,
)
from hysteresis.curves import Clip
from hysteresis.internal import extended
from hysteresis.preisach import GridDensity
from hysteresis.testing import check_model

KNOTS = [1.0, 2.0, 5.0]


def with_loops(gain: float, relays: float) -> Sum:
    """A curve and relays on [-1, 2]."""
    density = GridDensity(-1.0, 2.0, relays * np.tril(np.ones((4, 4))))
    return Sum(MonotoneCurve.even(-1.0, 2.0, gain * np.array([1.0, 2.0])), Preisach(density))


def three(axis: str = "linear") -> Conditioned:
    """Loops that narrow as the condition rises."""
    models = [with_loops(1.0, 0.5), with_loops(2.0, 0.3), with_loops(1.5, 0.1)]
    return Conditioned(tuple(models), KNOTS, "temperature", "K", axis)


def walk(condition: Any, samples: int = 60, seed: int = 0) -> np.ndarray:
    """Inputs between turning points, beside a condition."""
    random = np.random.default_rng(seed)
    u = np.interp(np.linspace(0, 9, samples), np.arange(10), random.uniform(-1.0, 2.0, 10))
    return np.column_stack([u, np.broadcast_to(condition, samples)])


def plays(slope: float, weight: float) -> PrandtlIshlinskii:
    return PrandtlIshlinskii([0.2, 0.7], [weight, 2 * weight], slope)


def test_it_keeps_the_laws_of_every_model():
    parts = (plays(1.0, 0.5), plays(2.0, 0.3))
    check_model(Conditioned(parts, [1.0, 3.0], axis="reciprocal"), -1.0, 2.0)


@pytest.mark.parametrize("axis", ["linear", "logarithmic", "reciprocal"])
def test_at_a_knot_it_is_the_model_of_the_knot_and_beyond_them_the_nearest(axis: str):
    model = three(axis)
    for k, c in enumerate(KNOTS):
        rows = walk(c)
        alone = model.models[k].simulate(None, rows[:, 0])
        np.testing.assert_allclose(model.simulate(None, rows), alone, atol=1e-14)
    for outside, inside in ((0.1, 1.0), (90.0, 5.0)):
        got, wanted = (model.simulate(None, walk(c)) for c in (outside, inside))
        np.testing.assert_array_equal(got, wanted)


@pytest.mark.parametrize(
    ("axis", "c", "share"),
    [("linear", 3.0, 1 / 3), ("logarithmic", np.sqrt(10.0), 0.5), ("reciprocal", 20 / 7, 0.5)],
)
def test_between_two_knots_it_is_straight_on_its_axis(axis: str, c: float, share: float):
    model = three(axis)
    low, high = (model.simulate(None, walk(at)) for at in (2.0, 5.0))
    np.testing.assert_allclose(
        model.simulate(None, walk(c)), (1 - share) * low + share * high, atol=1e-13
    )


def test_a_stage_behind_it_and_wider_relays_keep_its_outputs():
    model, rows = three(), walk(np.linspace(0.0, 6.0, 60))
    y = model.simulate(None, rows)
    np.testing.assert_allclose(
        extended(model, -2.0, 3.0).simulate(None, rows), y, atol=1e-12 * float(jnp.abs(y).max())
    )
    clipped = Series(model, Clip(low=0.0))
    np.testing.assert_array_equal(clipped.simulate(None, rows), np.maximum(y, 0.0))
    assert clipped.parts[0].condition == "temperature"


def test_what_is_no_conditioned_model_is_refused():
    line = LinearSponge(1.0, 0.0)
    for parts, knots, code in (
        ((), [], "bad-parts"),
        ((line, Burgers(2.0, 40.0, 1.0, 5.0)), [0.0, 1.0], "bad-parts"),
        ((line,), [0.0, 1.0], "length-mismatch"),
        ((line, line), [1.0, 1.0], "parameter-out-of-bounds"),
    ):
        with pytest.raises(InputError) as error:
            Conditioned(parts, knots)
        assert error.value.code == code
    with pytest.raises(InputError, match="above 0"):
        Conditioned((line, line), [-1.0, 1.0], axis="logarithmic")
    with pytest.raises(InputError) as error:
        replace(three(), axis="cubic")
    assert error.value.code == "bad-option"
    with pytest.raises(InputError) as error:
        three().simulate(None, np.zeros(5))
    assert error.value.code == "wrong-shape"
