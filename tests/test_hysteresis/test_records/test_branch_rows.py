"""Rows of a branch: the published approximations are lines over them."""

from pathlib import Path

import numpy as np
import pytest

import hysid
from hysteresis import InputError

SPONGE = Path(__file__).parents[3] / "datasets" / "sponge-50mm-cycles.csv"
COLUMNS = {"input": "force (N)", "output": "displacement (mm)", "time": "time (s)"}


# The figures of the card beside the file, to its last digit.
@pytest.mark.parametrize(
    ("branch", "K", "b"),
    [("loading", 1.3821, 3.480), ("both", 1.2981, 6.174), ("unloading", 1.2142, 8.869)],
)
def test_the_three_published_approximations(branch: str, K: float, b: float):
    record, _ = hysid.records(SPONGE, **COLUMNS, branch=branch, range=(2.0, 20.0))[""]
    fit = hysid.fit(record, "LinearSponge", conditioning="keep", noise="gaussian")
    found = {one.name: one.value for one in fit.parameters}
    assert (round(found["K"], 4), round(found["b"], 3)) == (K, b)
    assert np.asarray(fit.model.trained).tolist() == [2.0, 20.0]


def test_a_turning_sample_belongs_to_both_branches():
    u = np.array([0.0, 1, 2, 2, 1, 0, 1, 2, 1])
    record = hysid.Record.from_arrays(u, u + 0.1, groups=["a"] * 6 + ["b"] * 3)
    rising = record.select("loading").mask.tolist()
    falling = record.select("unloading").mask.tolist()
    assert rising == [True, True, True, True, False, False, True, True, False]
    assert falling == [False, False, False, True, True, True, False, True, True]
    both = record.select("both")
    assert both.labels == ("a loading", "a unloading", "b loading", "b unloading")
    assert both.mask.sum() == sum(rising) + sum(falling)
    np.testing.assert_array_equal(both.input, np.r_[u[:6], u[:6], u[6:], u[6:]])


def test_ranges_and_branches_that_are_none_are_refused():
    record = hysid.Record.from_arrays([0.0, 1, 2, 1], [0.0, 1, 2, 1])
    for options, code in (
        ({"range": (2.0, 1.0)}, "zero-range"),
        ({"range": (5.0, 6.0)}, "no-rows"),
    ):
        with pytest.raises(InputError, match=code):
            record.select(**options)
    with pytest.raises(InputError, match="zero-range"):
        hysid.records(SPONGE, **COLUMNS, range=(2.0,))
