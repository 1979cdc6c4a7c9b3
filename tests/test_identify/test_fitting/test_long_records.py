"""Records of more rows than a fit needs: fewer count, and the input's path stays."""

import numpy as np
import pytest

from hysteresis import Burgers, Record
from identify import fit

MOST, ROWS = 1_000, 9_000
TRUTH = Burgers(2.0, 60.0, 1.0, 5.0, 0.2)


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if a thousand rows were many."""
    monkeypatch.setattr("identify.records._orientation.HELD_AT_ONCE", MOST)


def pressed(noise: float = 0.0, turns: int = 12) -> Record:
    """Two runs of ramps to random ends, with a jump of the input in each, on an uneven clock."""
    random = np.random.default_rng(4)
    t = np.tile(np.cumsum(random.uniform(0.01, 0.03, ROWS // 2)), 2)
    ends = random.uniform(0, 5, turns)
    u = np.interp(t, np.linspace(0, t.max(), turns), ends) + np.where(t > 0.4 * t.max(), 2.0, 0.0)
    half = ROWS // 2
    y = np.concatenate([TRUTH.simulate(t[s], u[s]) for s in (slice(half), slice(half, ROWS))])
    u = u + noise * random.standard_normal(ROWS)
    return Record.from_arrays(u, y, t, np.repeat([1, 2], half), input_unit="N", output_unit="mm")


def test_a_long_record_is_fitted_on_fewer_rows_along_the_same_path() -> None:
    record = pressed()
    found = fit(record, "Burgers", noise="gaussian")
    train = found.train
    assert len(train) <= MOST
    assert train.history[-1].code == "thinned"
    assert train.labels == record.labels
    rows = train.line - 1
    np.testing.assert_array_equal(train.output, record.output[rows])
    assert 0.4 * MOST < train.mask.sum() <= 0.5 * MOST  # those for the path do not count
    # At every phase.
    assert len(np.unique(rows[train.mask] % (2 * ROWS // MOST))) == 2 * ROWS // MOST
    for (_, kept), (_, whole) in zip(train.sequences(), record.sequences(), strict=True):
        path = np.interp(record.time[whole], train.time[kept], train.input[kept])
        # To two steps of the input, which its uneven clock makes, or eight times what looks like noise.
        assert np.abs(path - record.input[whole]).max() <= 1e-3 * np.ptp(record.input)
    for name in ("E1", "eta1", "E2", "eta2"):
        # The path is off by a thousandth at most, here and there.
        truth = float(getattr(TRUTH, name))
        assert float(getattr(found.model, name)) == pytest.approx(truth, rel=1e-3)


@pytest.mark.thorough
def test_noise_of_the_input_is_no_path() -> None:
    assert len(fit(pressed(noise=0.05), "Burgers", noise="gaussian").train) < 0.6 * MOST


@pytest.mark.thorough
def test_a_record_that_turns_within_a_few_rows_stays_whole() -> None:
    assert len(fit(pressed(turns=ROWS // 4), "Burgers", noise="gaussian").train) == ROWS
