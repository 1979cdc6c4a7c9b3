"""Models without one cycle each are those that a fit to the other rows gives."""

import numpy as np
import pytest

from hysteresis import LinearSponge, Record
from identify import fit
from identify.internal import models_without_groups

RANDOM = np.random.default_rng(12)
U = np.interp(np.arange(121) / 20, np.arange(7), [0.0, 10.0, 0.0, 7.0, 0.0, 9.0, 0.0])
LINE = Record.from_arrays(U, 0.5 * U + 1 + 0.1 * RANDOM.normal(size=len(U)))


def test_of_a_line_they_are_the_lines_through_the_other_cycles():
    found = fit(LINE, "LinearSponge", noise="gaussian", conditioning="keep")
    left = models_without_groups(found)
    assert len(left) == 3
    for rows, model in left:
        assert isinstance(model, LinearSponge)
        rest = found.used & ~rows & (float(model.threshold) <= U)
        slope, offset = np.polyfit(U[rest], LINE.output[rest], 1)
        assert float(model.K) == pytest.approx(slope, rel=1e-3)
        assert float(model.b) == pytest.approx(offset, rel=1e-2)
