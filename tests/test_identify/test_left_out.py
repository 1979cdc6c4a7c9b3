"""Models without one cycle each are those that a fit to the other rows gives."""

import numpy as np
import pytest

from hysteresis import BoucWen, LinearSponge, Record
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


@pytest.mark.thorough
def test_they_miss_the_other_cycles_by_no_more_than_the_whole_fit():
    """Also where the cycle that is left out is the one that yields, and the others say little of it."""
    u = np.interp(np.arange(161) / 20, np.arange(9), [0.0, 1.0, 0.0, 1.1, 0.0, 10.0, 0.0, 1.0, 0.0])
    truth = BoucWen(k=1.0, alpha=0.2, yield_at=3.0, n=1.5)
    y = np.asarray(truth.simulate(None, u)) + 0.02 * RANDOM.normal(size=len(u))
    found = fit(Record.from_arrays(u, y), truth, noise="gaussian", starts=1, conditioning="keep")
    left = models_without_groups(found)
    assert len(left) >= 2
    for rows, model in left:
        rest = found.used & ~rows
        missed = np.asarray(model.simulate(None, u)) - y
        assert np.mean(missed[rest] ** 2) <= np.mean(found.residuals[rest] ** 2) * (1 + 1e-6)
