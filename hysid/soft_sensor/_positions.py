"""A sensor that tells where it is touched: scales by `identify`, estimates by `compensate.microchannel`."""

from typing import Any

import numpy as np

import identify
from compensate.microchannel import PositionEstimator, standardised


def fit_positions(
    readings: Any, places: Any, *, least: float = 0.0, seed: int = 0
) -> PositionEstimator:
    """Learn where a sensor of many channels is touched, from touches at known places.

    **Arguments:** `readings` (rows, channels); `places` (rows, coordinates), such as x and y in mm; several
    rows a place, of several forces, are welcome. `least`: |reading| below which nothing is touched.

    Raises `InputError` as `identify.fit_kernel` and `PositionEstimator` do.
    """
    places = np.asarray(places, float)
    x = np.asarray(standardised(readings)[0])
    kernel = identify.fit_kernel(x, places - places.mean(0), seed)
    return PositionEstimator(readings, places, kernel, least=least)
