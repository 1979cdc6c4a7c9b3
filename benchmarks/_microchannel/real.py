"""Measured soft sensors: forces, see `learnt`, and where an eFlesh lattice is touched.

The lattice has five magnetometers. The grid has a touch every millimetre, each of a depth of its own; every
second row and column is learnt from, all other places are estimated, one reading at a time.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from hysid import fit_positions
from hysteresis import read_table

from .._measure import Row, judged, noted
from ..accuracy import data_folder
from .learnt import learnt_rows

BAR = 0.8
CHANNELS = tuple(f"s{k:02d}" for k in range(15))
FILE = "eflesh-magnetic-tactile/tidy_contact_position.csv"


def real_rows(quick: bool) -> list[Row]:
    """Contact position and forces of sensors that were measured."""
    return [*_position_rows(), *learnt_rows(quick)]


def _position_rows() -> list[Row]:
    """Contact position on places left out, and what the nearest neighbours make of it."""
    what = "eFlesh, contact position on places left out, mean error, mm"
    file = data_folder() / FILE
    if not file.exists():
        return [noted(what, float("nan"), reason="the data are not here")]
    readings, places = _table(file)
    step = np.round(places - places.min(0)).astype(int)
    learnt = (step % 2 == 0).all(1)
    found = fit_positions(readings[learnt], places[learnt]).estimate(readings[~learnt])
    off = np.asarray(found.point) - places[~learnt]
    error = np.linalg.norm(off, axis=1)
    # 90 % of chi squared with two degrees of freedom.
    held = (error / np.asarray(found.deviation)) ** 2 < 4.605
    row = judged(what, float(error.mean()), BAR)
    return [
        row,
        noted("    95 % of the readings within, mm", float(np.quantile(error, 0.95))),
        noted("    held by 90 % circles, %", 100 * float(held.mean())),
        noted("    five nearest neighbours, mm", _nearest(readings, places, learnt)),
    ]


def _table(file: Path) -> tuple[Float[np.ndarray, "rows channels"], Float[np.ndarray, "rows 2"]]:
    table = read_table(file)

    def columns(*names: str) -> np.ndarray:
        return np.column_stack([np.asarray(table.text[name], float) for name in names])

    return columns(*CHANNELS), columns("x_mm", "y_mm")


def _nearest(readings: np.ndarray, places: np.ndarray, learnt: np.ndarray, k: int = 5) -> float:
    """Mean error in mm of the mean of k neighbours, weighted by 1 / distance."""
    known, asked = readings[learnt], readings[~learnt]
    square = ((asked[:, None] - known[None]) ** 2).sum(-1)
    near = np.argsort(square, axis=1)[:, :k]
    weight = 1 / np.sqrt(np.take_along_axis(square, near, 1) + 1e-12)
    weight /= weight.sum(1, keepdims=True)
    found = (weight[..., None] * places[learnt][near]).sum(1)
    return float(np.linalg.norm(found - places[~learnt], axis=1).mean())
