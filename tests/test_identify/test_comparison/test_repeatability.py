"""Repeatability: how well the best line is known, however far the model is from the material."""

from pathlib import Path

import numpy as np
import pytest

import identify
from hysteresis import Record
from hysteresis.internal import force_path
from hysteresis.rigs import SpongeRig
from identify import FitResult
from identify.internal import repeatability

FORCE = force_path((0.0,) + (20.0, 0.0) * 5, 2.0)
CLEAN = SpongeRig().follow(FORCE, dt=6.0)
NOISE, PAIRS = 0.05, 8  # mm


def fitted(seed: int, softer: float = 1.0, cycles: int = 5) -> FitResult:
    rows = slice(0, 20 * cycles + 1)
    noise = np.random.default_rng(seed).normal(0, NOISE, len(FORCE))
    d = (softer * CLEAN + noise)[rows]
    record = Record.from_arrays(FORCE[rows], d, dt=6.0, input_unit="N", output_unit="mm")
    line = record.select(range=(2.0, 20.0))
    return identify.fit(line, "LinearSponge", noise="gaussian", conditioning="keep")


@pytest.fixture(scope="module")
def fits() -> list[FitResult]:
    return [fitted(seed) for seed in range(2 * PAIRS)]


def of_later_cycles(fit: FitResult) -> FitResult:
    """The same without the first cycle, in which the foam softens."""
    return identify.fit(
        fit.train.select(cycle=range(2, 6)), "LinearSponge", noise="gaussian", conditioning="keep"
    )


@pytest.mark.thorough
def test_the_errors_are_those_of_repeated_records(fits: list[FitResult]):
    """Noise of 0.05 mm makes K differ from record to record; the misfit of millimetres does not."""
    later = [of_later_cycles(fit) for fit in fits]
    spread = np.std([fit.parameters[0].value for fit in later], ddof=1)
    told = np.mean([repeatability(fit).stderr[0] for fit in later])
    # 16 records give their deviation to 18 %, 16 times 3 degrees of freedom the other to 10 %.
    assert told == pytest.approx(spread, rel=0.6)
    assert later[0].parameters[0].stderr > 20 * told


def test_ageing_is_seen_and_nothing_else(fits: list[FitResult]):
    """The line misses the loops by 2 mm in every record; 5 per cent softer is 0.07 mm/N."""
    same = [identify.change(fits[2 * k], fits[2 * k + 1]).p for k in range(PAIRS)]
    assert min(same) > 0.01 / PAIRS
    aged = identify.change(of_later_cycles(fits[0]), of_later_cycles(fitted(99, softer=1.05)))
    assert aged.p < 0.01
    assert aged.parameters[0].name == "K"
    assert aged.parameters[0].clear
    assert aged.parameters[0].difference == pytest.approx(
        0.05 * fits[0].parameters[0].value, rel=0.1
    )


def test_parameters_carry_both_errors(fits: list[FitResult], tmp_path: Path):
    """Through save and load."""
    found = identify.load(identify.save(fits[0], tmp_path / "fit"))
    told = repeatability(fits[0])
    assert [p.repeatability for p in found.parameters if p.status == "free"] == told.stderr.tolist()
    assert "from cycle to cycle" in found.summary()
    assert fitted(3, cycles=2).parameters[0].repeatability is None
