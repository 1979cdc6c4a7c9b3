"""No class of models can represent a rig: data made by the model under test would prove nothing."""

import numpy as np
import pytest

from benchmarks._armor.classes import LEAST, RIGS, nearest, nearest_bumps
from hysteresis import PrandtlIshlinskii, Record
from hysteresis._registry import find_model
from tests.thorough import rest_thorough


@pytest.mark.thorough
@pytest.mark.parametrize("rig", rest_thorough(RIGS, lambda rig: rig == "skin"))
def test_the_widest_class_does_not_contain_a_rig(rig: str):
    """`python -m benchmarks.armor --only classes` tries all classes that `fit` knows."""
    assert nearest(RIGS[rig](), "Composition") > LEAST


def test_a_bump_is_no_frame():
    assert nearest_bumps() > LEAST


@pytest.mark.thorough
def test_a_class_that_contains_a_rig_would_be_found():
    """A sensor with plays at the very widths from which a fit of plays starts."""
    record = RIGS["sensor"]()
    start = find_model("PrandtlIshlinskii").start(record)
    assert isinstance(start, PrandtlIshlinskii)
    plays = PrandtlIshlinskii(start.thresholds, np.array([0.01, 0.02, 0.03, 0.01]), 1.0)
    inside = np.asarray(plays.simulate(record.time, record.input))
    same = Record.from_arrays(record.input, inside, record.time, input_unit="N", output_unit="N")
    assert nearest(same, "PrandtlIshlinskii") < LEAST
