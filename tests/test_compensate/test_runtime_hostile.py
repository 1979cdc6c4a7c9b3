"""What a broken sensor or clock gives: exported compensators stay finite, and are right again."""

from pathlib import Path

import numpy as np
import pytest

from compensate import Status, export_c, export_runtime
from compensate.runtime import load
from hysteresis import Burgers
from tests.c_harness import COMPILERS, Compiled
from tests.test_compensate.test_runtime import EXPORTED, Problem, run
from tests.thorough import rest_thorough

HUGE = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e200)
CLOCKS = (np.nan, np.inf, -np.inf, 1e308, 1e150, -1.0, 0.0, 1e12)
FEW = 60


def hostile(rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Readings and clocks that no sensor means."""
    random = np.random.default_rng(7)
    return random.choice(HUGE, rows), random.choice(CLOCKS, rows)


@pytest.mark.skipif(not COMPILERS, reason="no C compiler")
@pytest.mark.parametrize("real", rest_thorough(["float", "double"], 1))
@pytest.mark.parametrize("problem", rest_thorough(EXPORTED[::5], 3), ids=lambda p: p.name)
def test_c_is_finite_whatever_it_is_fed(problem: Problem, real: str, tmp_path: Path):
    """Estimates, predictions and deviations, on one state; good samples are finite afterwards."""
    done = run(problem)
    path = tmp_path / "it.h"
    done.program.write_c(path, real)
    it = Compiled(path, COMPILERS[0], ("-O1",))
    y, dt = hostile(FEW)
    value, status = it.run(np.append(dt, done.dt[:FEW]), np.append(y, done.y[:FEW]))
    assert np.isfinite(value[1:]).all()
    assert (status[FEW:] != Status.INVALID).all()
    if "double it_predict(" in it.text.replace("it_real", "double"):
        u = np.append(y, done.u[:FEW])
        back = it.predict(np.append(dt, done.dt[:FEW]), u)
        limit = np.finfo(real if real == "double" else "f4").max
        assert np.array_equal(np.isnan(back), ~(np.abs(u) <= limit))


@pytest.mark.skipif(not COMPILERS, reason="no C compiler")
def test_a_long_pause_is_held_and_said(tmp_path: Path):
    """In C and in Python alike: the longest time is named, one beyond it is taken for it."""
    model = Burgers(2.0, 40.0, 1.0, 5.0)
    t = np.linspace(0, 10, 200)
    y = np.asarray(model.simulate(t, np.sin(t)))
    export_runtime(model, tmp_path / "it.json", y, times=t)
    export_c(model, tmp_path / "it.h", y, times=t)
    c, it = Compiled(tmp_path / "it.h", COMPILERS[0]), load(tmp_path / "it.json")
    assert it.longest == 10_000.0
    assert "at most 10000;" in c.text
    for pause in (9_999.0, 10_000.0, 1e300, np.inf):
        dt = np.append(np.full(20, 0.05), [pause, *[0.05] * 20])
        it.reset()
        found = [it.step(b, a) for a, b in zip(y[:41].tolist(), dt.tolist(), strict=True)]
        value, status = c.run(dt, y[:41])
        np.testing.assert_allclose(value, [e.value for e in found], rtol=1e-9, atol=1e-9)
        assert status.tolist() == [int(e.status) for e in found]
        late = np.flatnonzero(status == Status.EXTRAPOLATED).tolist()
        assert late == ([] if pause < 10_000 else [20])
