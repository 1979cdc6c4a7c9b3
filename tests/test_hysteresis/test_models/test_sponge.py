"""The linear sponge: a line above a threshold, zero below it."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hysteresis import LinearSponge
from tests.problems import histories


@given(
    histories(0.0, 20.0), st.floats(0.1, 5.0), st.floats(-5.0, 5.0), st.sampled_from([-np.inf, 1.5])
)
def test_line_above_the_threshold(u: np.ndarray, K: float, b: float, threshold: float):
    y = np.asarray(LinearSponge(K, b, threshold).simulate(None, u))
    touched = u >= threshold
    # One product and one sum, each rounded, possibly fused.
    np.testing.assert_allclose(y[touched], (K * u + b)[touched], rtol=0, atol=1e-13)
    assert not y[~touched].any()


def test_contact_begins_at_the_threshold_itself():
    u = [np.nextafter(1.5, 0.0), 1.5]
    np.testing.assert_array_equal(LinearSponge(2.0, 1.0, 1.5).simulate(None, u), [0.0, 4.0])
