"""What a plot shows of many rows: every peak, whatever the level of detail."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hysid.studio._views import ALL, GAP, RASTER, Series, of_loops, over_time, peaks


def series(n: int, seed: int = 0) -> Series:
    rng = np.random.default_rng(seed)
    x = np.arange(n) / 100
    u = np.sin(x) + 0.01 * rng.normal(size=n)
    return Series(x, u, u**3, np.arange(2, n + 2), np.zeros(n, int))


@given(st.integers(1, 40_000), st.integers(0, 3))
def test_no_peak_of_a_view_is_lost(n, seed):
    one = series(n, seed)
    rows = slice(n // 5, n)
    shown = peaks((one.u, one.y), rows)
    assert np.all(np.diff(shown) > 0)
    for column in (one.u, one.y):
        assert (column[shown].min(), column[shown].max()) == (
            column[rows].min(),
            column[rows].max(),
        )
    assert len(shown) <= max(ALL, 6 * 1000 + 1)


def test_a_stretch_of_few_rows_is_shown_whole():
    one = series(100_000)
    np.testing.assert_array_equal(over_time(one, 10.0, 20.0)[3], one.line[999:2002])


def test_loops_are_joined_where_all_rows_are_shown_and_a_raster_elsewhere():
    few, joined = of_loops(series(500))
    assert joined
    assert few.shape[1] == 500
    one = series(100_000)
    many, joined = of_loops(one)
    assert not joined
    assert many.shape[1] <= RASTER[0] * RASTER[1]
    # Each row is in the cell of one that is shown.
    cell = np.array([np.ptp(one.u) / RASTER[0], np.ptp(one.y) / RASTER[1]])
    for k in range(0, 100_000, 997):
        away = np.abs(many[1:3] - np.array([[one.u[k]], [one.y[k]]])) / cell[:, None]
        assert (away.max(axis=0) <= 1.0).any()


def test_a_box_of_loops_shows_its_rows_with_gaps_where_they_leave_it():
    one = series(3000)
    found, joined = of_loops(one, box=(0.0, 0.5, -1.0, 1.0))
    inside = set(one.line[(one.u >= 0) & (one.u <= 0.5)])
    assert joined
    assert inside <= set(found[3])
    begins = found[4] >= GAP
    np.testing.assert_array_equal(begins[1:], np.diff(found[3]) > 1)
