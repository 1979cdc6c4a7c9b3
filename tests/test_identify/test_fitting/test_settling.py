"""First cycles of a sample that settles are left out, and only of such a sample."""

from dataclasses import replace

import numpy as np

from hysteresis import Record
from identify import fit
from identify.fitting._settling import settled
from identify.fitting._training_data import training_data
from identify.records._relaxation_times import relaxation_times

CYCLES, SAMPLES = 10, 60
BOTH = (False, True)
"""Orientations to try."""


def pressed(settling: float, turn: int = 1) -> Record:
    """Equal cycles of a loop, whose force is higher by a share that is forgotten in two cycles."""
    t = np.linspace(0, 10.0 * CYCLES, CYCLES * SAMPLES + 1)
    u = 0.5 - 0.5 * np.cos(2 * np.pi * t / 10)
    force = u**1.5 + 0.05 * np.sin(2 * np.pi * t / 10) * u * (1 - u)
    noise = 0.002 * np.random.default_rng(0).normal(size=len(t))
    return Record.from_arrays(u, turn * (force * (1 + settling * np.exp(-t / 20)) + noise), t)


def counted(record: Record) -> list[int]:
    return sorted(set(record.cycle[record.mask].tolist()) - {0})


def test_a_sample_that_settles_keeps_its_last_cycles():
    record = pressed(settling=0.2)
    later = settled(record, BOTH)
    assert counted(later) == [8, 9, 10]
    assert "cycle 8" in later.history[-1]
    # Memory longer than a part of a cycle of 10 s cannot be told from what the first cycles left.
    assert max(relaxation_times(record)) > 100
    assert max(relaxation_times(later)) < 5


def test_what_may_not_be_left_out_stays():
    record = pressed(settling=0.2)
    half = np.where(record.cycle > 5, 0.5 * record.input, record.input)
    assert settled(replace(record, input=half), BOTH).mask.all()  # cycles that are not alike
    sweep = replace(record, time=record.time**1.5)
    assert settled(sweep, BOTH).mask.all()  # cycles of different rates
    few = replace(record, mask=record.cycle <= 5)
    assert settled(few, BOTH) is few


def test_a_falling_output_settles_like_its_negative():
    kept = [
        training_data(
            pressed(settling=0.2, turn=turn), None,
            keep_conditioning=False, keep_clocks=False, say=lambda text: None,
        )
        for turn in (1, -1)
    ]  # fmt: skip
    assert [data.falls for data in kept] == [False, True]
    assert counted(kept[0].record) == counted(kept[1].record) != list(range(1, CYCLES + 1))


def test_a_fit_says_so_and_may_be_told_otherwise():
    record = pressed(settling=0.2)
    found = fit(record, "LinearSponge", test_cycles=1, noise="gaussian")
    assert "Left out what comes before cycle 7: the sample settles." in found.train.history
    assert counted(found.train) == [7, 8, 9]
    kept = fit(record, "LinearSponge", test_cycles=1, conditioning="keep", noise="gaussian")
    assert counted(kept.train) == list(range(1, 10))
    assert found.metrics["test"] is not None
    assert kept.metrics["test"] is not None
    assert found.metrics["test"].rmse < kept.metrics["test"].rmse


def test_no_cycles_no_settling():
    t = np.linspace(0, 1, 200)
    record = Record.from_arrays(t * 1.0, t**2, t)
    assert settled(record, BOTH) is record
