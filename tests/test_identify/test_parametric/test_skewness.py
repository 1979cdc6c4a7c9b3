"""Intervals that follow a skewed posterior."""

import numpy as np
import pytest

from identify.parametric._standard_errors import Skewness, points_about, skewness

SIZE, NINETY = 0.1, 1.6448536
AXIS = np.linspace(-1.0, 0.6, 200_001)
HEIGHT = np.exp(-((np.exp(AXIS) - 1) ** 2) / (2 * SIZE**2))
"""The posterior of z = log K, where K = 1 was measured with an error of `SIZE`."""


def score(z: np.ndarray) -> np.ndarray:
    return -(np.exp(z) - 1) * np.exp(z) / SIZE**2


def of_log() -> Skewness:
    covariance = np.array([[SIZE**2]])
    return skewness(score(points_about(np.zeros(1), covariance)), covariance)


def test_a_logarithm_has_the_quantiles_of_its_posterior() -> None:
    bent = of_log()
    # By hand: d3 log p / dz3 = -3 / SIZE^2. Differences of 0.7 deviations see its change, a few per cent.
    assert bent.shift[0] == pytest.approx(-1.5 * SIZE, rel=0.05)
    assert bent.skew[0] == pytest.approx(-3 * SIZE, rel=0.05)
    share = np.cumsum(HEIGHT) / HEIGHT.sum()
    for side, wanted in ((-NINETY, 0.05), (NINETY, 0.95)):
        end = SIZE * (side + bent.displaced(NINETY)[0])
        exact = np.interp(wanted, share, AXIS)
        # What is left is of third order, skew squared; without the skewness it is five times that.
        assert abs(end - exact) < 0.07 * SIZE
        assert abs(SIZE * side - exact) > 0.15 * SIZE
        # The inverse expansion is that of the ends.
        assert bent.deviate(np.array([end / SIZE]))[0] == pytest.approx(side, abs=1e-12)
