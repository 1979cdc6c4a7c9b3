"""Averages of compositions: where they are taken, and that each is one model."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from compensate import estimate, invert
from hysteresis import Record
from identify import FitResult, fit, load, predictive, sample, save

NOISE = 0.002


def creeping_and_rubbing(seed: int = 0, samples: int = 500) -> Record:
    """A sensor whose creep leads its input and whose friction lags: no parts of one orientation do both."""
    rng, t = np.random.default_rng(seed), 0.1 * np.arange(samples)
    turns = np.cumsum(np.append(0, rng.uniform(2, 8, 40)))
    heights = np.where(np.arange(41) % 2, rng.uniform(0.4, 1, 41), rng.uniform(0, 0.4, 41))
    slow, seat, y = 0.0, 0.0, []
    for u in (inputs := np.interp(t, turns, heights)):
        slow += 0.1 / 1.5 * (u - slow)
        seat = min(max(seat, u - 0.1), u + 0.1)
        y.append(u + 0.5 * slow + 0.6 * (u - seat))
    return Record.from_arrays(inputs, np.array(y) + NOISE * rng.normal(size=samples), t)


@pytest.fixture(scope="module", autouse=True)
def _compositions_alone() -> Iterator[None]:
    """Of `auto`: a tenth of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("identify.fitting._candidates.AUTO", ("Composition",))
        yield


@pytest.fixture(scope="module")
def average() -> FitResult:
    return fit(creeping_and_rubbing(), test_tail=0.3)


def test_an_average_is_taken_where_parts_of_one_sign_miss(average: FitResult):
    assert average.name.startswith("average with")
    rising = [one for one in average.candidates if not one.name.startswith("average")]
    # It has to take away half of the squared error.
    assert average.score < np.sqrt(0.5) * min(one.score for one in rising)
    other = creeping_and_rubbing(7)
    missed = [one.predict(other) - other.output for one in (average, rising[0])]
    ours, theirs = (float(np.sqrt(np.mean(error**2))) for error in missed)
    assert ours < theirs
    assert "either sign" in " ".join(average.notes)
    alone = fit(creeping_and_rubbing(), "Composition", test_tail=0.3)
    assert not any(one.name.startswith("average") for one in alone.candidates)


def sticking(heights: tuple[float, ...], seed: int = 0) -> Record:
    """A valve that sticks within a band, then jumps: relays do that at one amplitude, plays at any."""
    k, stem, y = np.arange(120 * len(heights)), 0.0, []
    for u in (inputs := np.array(heights)[k // 120] * (1 - np.cos(2 * np.pi * k / 120)) / 2):
        if abs(u - stem) > 0.12:
            stem = u - 0.05 * np.sign(u - stem)
        y.append(stem)
    noise = NOISE * np.random.default_rng(seed).normal(size=len(k))
    return Record.from_arrays(inputs, np.array(y) + noise, 0.02 * k)


def test_an_average_with_a_simpler_composition_rises(tmp_path: Path):
    found = fit(sticking((1.0,) * 6), purpose="compensate")
    detail: Any = found.detail
    members = detail.linear.meaning.members
    assert [one.name for one in members][1:] == ["curve + plays + stops"]
    assert sum(one.weight for one in members) == pytest.approx(1)
    assert members[0].error < members[1].error
    assert (detail.linear.unknowns[1:] >= 0).all()
    estimated = estimate(invert(found.model, trained=found.trained), found.train)
    assert np.isfinite(np.asarray(estimated.value)).all()
    again: Any = load(save(found, tmp_path / "fit")).detail
    assert again.linear.meaning == detail.linear.meaning


@pytest.mark.thorough
def test_its_posterior_is_about_it(average: FitResult):
    draws = sample(average, seed=1, steps=200)
    bands = predictive(average, posterior=draws)
    predicted = average.predict(average.test)[average.test.mask]
    # Draws are about the average: their median is within a few of its standard errors.
    assert np.abs(bands.middle - predicted).max() < 3 * NOISE
