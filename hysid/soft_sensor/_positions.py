"""Positions of touches from the readings of many channels, by a Gaussian process."""

from typing import Any

import numpy as np

import identify
from compensate.microchannel import PositionEstimator, standardised


def fit_positions(
    readings: Any, places: Any, *, least: float = 0.0, seed: int = 0
) -> PositionEstimator:
    """Learn where a sensor of many channels is touched, from touches at known places.

    **Arguments:**

    - `readings`: (rows, channels), in any unit. Several rows per place, at different forces, help.
    - `places`: (rows, coordinates), for example x and y in mm; estimates have the same unit.
    - `least`: the sensor is not touched while every |reading| is below this, in the unit of the readings.
    - `seed`: of the search for the length scales.

    **Returns:** a `compensate.microchannel.PositionEstimator`.

    **Raises:** `InputError` as `identify.fit_kernel` and `PositionEstimator` do.

    **Example:**

        >>> x = np.repeat(np.arange(6.0), 3)
        >>> noise = np.random.default_rng(0).normal(0.0, 0.05, (18, 3))
        >>> readings = np.column_stack([1 + x, 6 - x, 3 + 0 * x]) + noise
        >>> estimator = hysid.fit_positions(readings, x[:, None])
        >>> round(float(estimator.estimate([3.5, 3.5, 3.0]).point[0]), 1)
        2.5
    """
    places = np.asarray(places, float)
    x = np.asarray(standardised(readings)[0])
    kernel = identify.fit_kernel(x, places - places.mean(0), seed)
    return PositionEstimator(readings, places, kernel, least=least)
