"""Foam curves fit measurements of another law than theirs."""

from pathlib import Path

import numpy as np

from compensate import Status, invert
from hysteresis import read_csv
from identify import fit

SPONGE = Path(__file__).resolve().parents[3] / "datasets" / "sponge-50mm-cycles.csv"


def test_loading_branch_of_the_virtual_sponge():
    """The first of five cycles is another curve, and left out."""
    record = read_csv(SPONGE, input="displacement (mm)", output="force (N)")
    result = fit(record.select(branch="loading"), "FoamCurve", noise="gaussian", starts=6)
    assert result.metrics["train"].nrmse_percent < 0.5
    found = invert(result.model).simulate(None, record.output)
    assert np.all(found.status == Status.OK)
