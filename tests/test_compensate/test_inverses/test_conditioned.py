"""The inverse of a model that depends on a condition: given the output and the condition."""

import numpy as np
import pytest

from compensate import Status, invert
from hysteresis import (
    AbstractModel,
    Burgers,
    Conditioned,
    MonotoneCurve,
    PrandtlIshlinskii,
    Scaled,
    Sum,
)
from tests.refusals import refuses
from tests.streams import check_stream

KNOTS = [10.0, 20.0, 50.0]


def part(slope: float, weight: float) -> Sum:
    """A curve on [-1, 2] and plays."""
    curve = MonotoneCurve.even(-1.0, 2.0, slope * np.array([0.5, 1.0, 2.0]))
    return Sum(curve, PrandtlIshlinskii([0.1, 0.5], [weight, weight], 0.1))


def model(sign: float = 1.0) -> Conditioned:
    parts: list[AbstractModel] = [part(1.0, 0.5), part(2.0, 0.2), part(1.5, 0.1)]
    if sign < 0:
        parts = [Scaled(one, sign) for one in parts]
    return Conditioned(tuple(parts), KNOTS, "temperature", "degC")


def walk(samples: int = 40, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Inputs between turning points, and a condition that drifts over all knots."""
    random = np.random.default_rng(seed)
    u = np.interp(np.linspace(0, 9, samples), np.arange(10), random.uniform(-1.0, 2.0, 10))
    return u, np.linspace(9.5, 50.5, samples)


def there_and_back(one: AbstractModel, t: np.ndarray | None = None) -> None:
    u, c = walk()
    y = one.simulate(t, np.column_stack([u, c]))
    found = invert(one).simulate(t, np.column_stack([y, c]))
    np.testing.assert_allclose(found.value, u, atol=1e-7)
    again = one.simulate(t, np.column_stack([found.value, c]))
    np.testing.assert_allclose(again, y, atol=1e-9 * float(np.ptp(y)))
    assert (np.asarray(found.status) == Status.OK).all()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_inverse_undoes_the_model_at_every_condition(sign: float):
    there_and_back(model(sign))


def test_models_that_depend_on_the_rate_are_inverted():
    fast, slow = Burgers(2.0, 40.0, 1.0, 5.0), Burgers(3.0, 60.0, 2.0, 4.0)
    there_and_back(Conditioned((fast, slow), [10.0, 50.0]), np.arange(40.0))


def test_a_stream_gives_what_the_batch_gives():
    u, c = walk(12)
    y = np.asarray(model().simulate(None, np.column_stack([u, c])))
    check_stream(invert(model()), np.arange(12.0), np.column_stack([y, c]))


def test_without_a_condition_the_last_estimate_is_held():
    compensator, u = invert(model()), np.array([0.0, 0.5, 0.5, 1.0])
    c = np.array([20.0, 20.0, np.nan, 20.0])
    y = np.asarray(model().simulate(None, np.column_stack([u, np.full(4, 20.0)])))
    found = compensator.simulate(None, np.column_stack([y, c]))
    assert [int(s) for s in found.status] == [Status.OK, Status.OK, Status.INVALID, Status.OK]
    np.testing.assert_allclose(found.value, u, atol=1e-7)
    refuses("wrong-shape", lambda: compensator.simulate(None, y))


def test_a_model_that_rises_here_and_falls_there_has_no_inverse():
    mixed = Conditioned((Scaled(part(1.0, 0.1), 1.0), Scaled(part(1.0, 0.1), -1.0)), [0.0, 1.0])
    refuses("not-invertible", lambda: invert(mixed))


def test_at_the_end_of_the_range_a_strange_condition_is_told():
    """A reading beyond what the model can give is the end, OK, at trained conditions alone."""
    down = np.array([[0.0, 10.0], [-1.0, 10.0]])
    least = float(model().simulate(None, down)[-1])
    guarded = invert(model(), trained=(-1.0, 2.0), seen=(least - 1.0, least + 9.0))
    found = guarded.simulate(None, np.array([[least - 0.01, c] for c in (10.0, 0.0, 10.0)]))
    np.testing.assert_allclose(found.value, -1.0)
    assert [*found.status] == [Status.OK, Status.EXTRAPOLATED, Status.OK]
