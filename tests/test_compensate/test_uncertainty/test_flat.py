"""What a flat place leaves open."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compensate import Status, flat_intervals, invert, qualify
from hysteresis import AbstractModel, Preisach, Record
from hysteresis.preisach import GridDensity


def relays() -> AbstractModel:
    """Inputs of 0 to 10: relays switch up in [5, 6] and [7, 8], down in [5, 6] and [2, 3]."""
    weights = np.zeros((10, 10))
    weights[5, 5] = weights[7, 2] = 1.0
    return Preisach(GridDensity(0.0, 10.0, weights))


def open_inputs(u: np.ndarray) -> tuple[np.ndarray, Any]:
    model = relays()
    found = invert(model).simulate(None, model.simulate(None, u))
    flat = found.status == Status.FLAT
    return np.asarray(flat), flat_intervals(model, None, found.value, 0.0, 10.0, flat)


@given(st.lists(st.floats(0, 10), min_size=1, max_size=12))
@settings(deadline=None, max_examples=20)
def test_the_input_is_within_the_interval_where_flat(stops: list[float]):
    u = np.resize(stops, 12)
    flat, interval = open_inputs(u)
    low, high = np.asarray(interval.low), np.asarray(interval.high)
    # 1e-6: where the output starts with the square of the input, 1e-12 of it is a millionth.
    assert (u[flat] >= low[flat] - 1e-5).all()
    assert (u[flat] <= high[flat] + 1e-5).all()
    assert (np.asarray(interval.width)[~flat] == 0).all()


def test_intervals_of_known_relays():
    _, interval = open_inputs(np.array([1.0, 6.5, 9.0, 4.0, 1.0]))
    # No relay is up; the first one is; both are; the second alone; none, the way down from 5.
    assert np.asarray(interval.low) == pytest.approx(np.array([0.0, 6.0, 8.0, 3.0, 0.0]), abs=1e-5)
    assert np.asarray(interval.high) == pytest.approx(
        np.array([5.0, 7.0, 10.0, 5.0, 2.0]), abs=1e-5
    )


def test_a_verdict_tells_the_widest():
    u = np.array([0.0, 4.0, 6.5, 9.0, 6.5, 4.0, 1.0, 0.0])
    record = Record.from_arrays(u, np.asarray(relays().simulate(None, u)), input_unit="N")
    found = qualify(invert(relays()), record, relays())
    assert found.flat_width == pytest.approx(5.0, abs=1e-4)
    assert "up to 5 N are open" in " ".join(found.reasons)
