"""How long a compensator's error lasts: found from residuals, and carried by an exported file."""

from pathlib import Path

import numpy as np
import pytest

from compensate import calibrated, export_runtime, invert
from compensate.runtime import load
from hysteresis import LinearSponge, Record

DT, SLOPE, TIME, ROWS = 0.1, 2.0, 1.5, 6000
MODEL = LinearSponge(K=SLOPE, b=0.0, threshold=0.0)


def error_of(share: float) -> tuple[Record, float, float]:
    """A line whose readings have noise of which a share decays within 1.5 s."""
    random = np.random.default_rng(7)
    phi = np.exp(-DT / TIME)
    slow, white = np.zeros(ROWS), random.normal(size=ROWS)
    for k in range(1, ROWS):
        slow[k] = phi * slow[k - 1] + np.sqrt(1 - phi**2) * random.normal()
    t = DT * np.arange(ROWS)
    u = 10 - 5 * np.cos(0.2 * t)
    y = SLOPE * u + 0.1 * (np.sqrt(share) * slow + np.sqrt(1 - share) * white)
    record = Record.from_arrays(u, y, t)
    found = calibrated(invert(MODEL), record)
    return record, found.share, found.lasts


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_share_and_time_are_found(share: float):
    """600 s are 200 decays, which give the correlations to 0.07 or so."""
    _, found, lasts = error_of(share)
    assert found == pytest.approx(share, abs=0.12)
    assert lasts == pytest.approx(TIME, rel=0.3)


def test_white_noise_does_not_last_and_the_file_says_so(tmp_path: Path):
    record, found, lasts = error_of(0.0)
    assert (found, lasts) == (0.0, 0.0)
    error = calibrated(invert(MODEL), record)
    file = export_runtime(MODEL, tmp_path / "line.json", record.output, error=error).path
    assert load(file).lasting == {"share": 0.0, "time": 0.0}
    plain = export_runtime(MODEL, tmp_path / "plain.json", record.output).path
    assert load(plain).lasting is None
