"""Parameters that made a record are found from a start a decade away from each."""

import numpy as np
import pytest
from scipy.stats import binom

from benchmarks.recovery import Run, cases, one_run
from hysteresis import InputError, MonotoneCurve, Record
from identify import fit

RUNS = 4


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    """Two branches, whose stiffnesses and times are arrays."""
    case = next(case for case in cases() if "Maxwell" in case.name)
    return [one_run(case, number) for number in range(RUNS)]


@pytest.mark.thorough
def test_the_truth_lies_in_its_interval(runs: list[Run]) -> None:
    assert set(runs[0].found) == {"E_inf", "E.0", "E.1", "tau.0", "tau.1", "offset"}
    for name in runs[0].found:
        found = sum(run.found[name] for run in runs)
        # Of four sound 95 % intervals fewer than these hold the truth once in ten thousand times.
        assert found >= binom.ppf(1e-4, RUNS, 0.95), name


@pytest.mark.thorough
def test_no_run_stays_where_it_started(runs: list[Run]) -> None:
    assert all(run.best for run in runs)


def test_starts_without_a_finite_output_are_refused() -> None:
    u = np.linspace(0.0, 1.0, 50)
    with pytest.raises(InputError, match=r"\[no-finite-start\]"):
        fit(Record.from_arrays(u, 2 * u), MonotoneCurve.even(0.0, 1.0, [1.0], np.nan), starts=4)
