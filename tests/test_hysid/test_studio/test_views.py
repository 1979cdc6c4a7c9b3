"""What a plot shows of many rows: every peak, whatever the level of detail."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hysid
from tests.test_hysid.test_studio.test_explore import sent

pytest.importorskip("anywidget", reason="anywidget is not installed")


def record(n: int, seed: int = 0) -> hysid.Record:
    x = np.arange(n) / 100
    u = np.sin(x) + 0.01 * np.random.default_rng(seed).normal(size=n)
    return hysid.Record.from_arrays(u, u**3, x, line=np.arange(2, n + 2))


def shown(of: hysid.Record, **asked: Any) -> tuple[np.ndarray, np.ndarray, bool]:
    """Clock, input, output, line and state of the rows of both plots; whether lines join the loops."""
    about, content = sent(hysid.explore(of), asked)
    cut = 5 * about["shapes"][0]
    time, loops = np.split(np.frombuffer(content), [cut])
    return time.reshape(5, -1), loops.reshape(5, -1), about["joined"]


@settings(max_examples=10)
@given(st.integers(2, 40_000), st.integers(0, 3))
def test_no_peak_of_a_view_is_lost(n: int, seed: int):
    one = record(n, seed)
    rows = slice(max(n // 5 - 1, 0), n)
    time, _, _ = shown(one, view=[one.time[n // 5], None])
    assert np.all(np.diff(time[3]) > 0)
    for column, seen in ((one.input, time[1]), (one.output, time[2])):
        assert (seen.min(), seen.max()) == (column[rows].min(), column[rows].max())
    assert time.shape[1] <= 6001


def test_a_stretch_of_few_rows_is_shown_whole():
    one = record(100_000)
    np.testing.assert_array_equal(shown(one, view=[10.0, 20.0])[0][3], one.line[999:2002])


def test_loops_are_joined_where_all_rows_are_shown_and_a_raster_elsewhere():
    _, few, joined = shown(record(500))
    assert joined
    assert few.shape[1] == 500
    one = record(100_000)
    _, many, joined = shown(one)
    assert not joined
    assert many.shape[1] <= 360 * 240
    # Each row is in the cell of one that is shown.
    cell = np.array([np.ptp(one.input) / 360, np.ptp(one.output) / 240])
    for k in range(0, 100_000, 997):
        at = np.array([[one.input[k]], [one.output[k]]])
        assert ((np.abs(many[1:3] - at) / cell[:, None]).max(axis=0) <= 1.0).any()


def test_a_box_of_loops_shows_its_rows_with_gaps_where_they_leave_it():
    one = record(3000)
    _, found, joined = shown(one, box=(0.0, 0.5, -1.0, 1.0))
    inside = set(one.line[(one.input >= 0) & (one.input <= 0.5)])
    assert joined
    assert inside <= set(found[3])
    np.testing.assert_array_equal(found[4][1:] >= 8, np.diff(found[3]) > 1)
