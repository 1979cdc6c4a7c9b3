"""A fit that version 0.1.0 saved, of numbers made by us: later versions load it, and it is the same."""

from pathlib import Path

import numpy as np

import compensate
import hysid
import identify

FOLDER = Path(__file__).parent / "fit_of_0_1_0"


def test_it_loads_and_is_the_same(tmp_path: Path):
    fit = identify.load(FOLDER)
    assert (fit.name, fit.verdict.level, len(fit.baselines)) == ("Burgers", "PASS", 6)
    again = (fit.predict(fit.train) - fit.train.output)[fit.used]
    np.testing.assert_allclose(again, fit.residuals[fit.used], rtol=0, atol=1e-12)
    found = compensate.estimate(hysid.invert(fit), fit.train)
    assert np.isfinite(found.value).all()
    identify.save(fit, tmp_path / "again")
    assert identify.load(tmp_path / "again").metrics == fit.metrics
    assert hysid.report(fit, tmp_path / "fit.html").exists()
