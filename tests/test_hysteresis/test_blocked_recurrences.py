"""Recurrences in segments are those row by row, whatever the number of rows and wherever they are cut."""

import numpy as np
import pytest

from hysteresis.numerics._blocked_recurrences import clamped, relaxed, running


@pytest.mark.parametrize("rows", [0, 1, 2, 17, 100])
def test_segments_do_what_a_loop_does(rows: int) -> None:
    random = np.random.default_rng(rows)
    decay, drive = random.uniform(size=(rows, 3)), random.normal(size=(rows, 3, 2))
    decay[random.uniform(size=rows) < 0.1] = 0.0  # a sequence starts
    x, expected = random.normal(size=(3, 2)), np.empty((rows, 3, 2))
    found = relaxed(decay, drive, x)
    for k in range(rows):
        x = expected[k] = decay[k, :, None] * x + drive[k]
    # Sums of some terms of size one in another order.
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)

    u, r = np.cumsum(random.normal(size=rows))[:, None], np.array([0.1, 1.0, 4.0])
    z, expected = np.zeros(3), np.empty((rows, 3))
    found = clamped(u - r, u + r, z)
    for k in range(rows):
        z = expected[k] = np.clip(z, u[k] - r, u[k] + r)
    np.testing.assert_array_equal(found, expected)


def test_running_extremes_begin_anew() -> None:
    x = np.array([1.0, 3.0, 2.0, -1.0, 0.0, 5.0])
    found = running(np.maximum, x, np.array([3]), 2.0)
    np.testing.assert_array_equal(found, [2.0, 3.0, 3.0, -1.0, 0.0, 5.0])
    found = running(np.minimum, x, np.array([0, 5]), -9.0)
    np.testing.assert_array_equal(found, [1.0, 1.0, 1.0, -1.0, -1.0, 5.0])
