"""Turning points, branches and cycles: the count must be the rig's, not the noise's."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hysteresis import Record
from hysteresis.records._cycles import noise_level

DATA = Path(os.environ.get("HYSID_DATA", Path(__file__).parents[4] / "shared" / "data"))


def cycles(u: np.ndarray) -> np.ndarray:
    """The cycle of each row, 0 where it is in none."""
    return Record.from_arrays(u, u).cycle


def branches(u: np.ndarray) -> np.ndarray:
    return Record.from_arrays(u, u).branch


def triangles(n_cycles: int, samples: int) -> np.ndarray:
    """`n_cycles` triangles 0 -> 1 -> 0, `samples` samples a leg."""
    return np.interp(
        np.arange(2 * n_cycles * samples + 1),
        samples * np.arange(2 * n_cycles + 1),
        np.arange(2 * n_cycles + 1) % 2,
    )


def test_triangle_wave_by_hand():
    u = np.array([0, 1, 2, 1, 0, 1, 2, 1, 0], float)
    assert branches(u).tolist() == [1, 1, 1, -1, -1, 1, 1, -1, -1]
    assert cycles(u).tolist() == [1, 1, 1, 1, 1, 2, 2, 2, 2]


@pytest.mark.parametrize("n", range(4))
def test_short_and_constant_sequences(n):
    u = np.zeros(n)
    assert cycles(u).tolist() == [0] * n
    assert branches(u).tolist() == [1] * n


def test_slow_ramp_and_hold_after_the_last_cycle_belong_to_none():
    u = np.concatenate([np.zeros(50), triangles(3, 40), np.linspace(0, 1, 300), np.ones(200)])
    c = cycles(u)
    assert c.max() == 3
    assert np.all(c[:50] == 1)
    assert np.all(c[50 + 242 :] == 0)  # the trough is two samples long


@pytest.mark.parametrize(("end", "complete"), [(0.1, 1), (0.45, 1), (0.55, 0), (0.95, 0)])
def test_the_last_cycle_must_come_half_way_back(end, complete):
    u = np.concatenate([np.linspace(0, 1, 50), np.linspace(1, end, 50)[1:]])
    assert cycles(u).max() == complete


@given(st.integers(1, 12), st.integers(15, 60), st.floats(0, 0.02), st.integers(0, 2**32 - 1))
def test_the_default_dead_band_survives_gaussian_noise(n_cycles, samples, sd, seed):
    u = triangles(n_cycles, samples)
    assert cycles(u + np.random.default_rng(seed).normal(0, sd, len(u))).max() == n_cycles


@given(st.integers(4, 60), st.integers(1, 10))
def test_coarse_sines_keep_their_cycles(samples, n_cycles):
    u = -np.cos(2 * np.pi * np.arange(n_cycles * samples + 1) / samples)
    assert cycles(u).max() == n_cycles


def test_foam_has_six_cycles_and_a_tail_in_none():
    path = DATA / "foam-midsole-compression" / "tidy.csv"
    if not path.exists():
        pytest.skip(f"no measured data at {DATA}")
    rows = np.genfromtxt(path, delimiter=",", skip_header=1, dtype=None, encoding="utf-8")
    samples = rows["f0"]
    for sample in np.unique(samples):
        for column in ("f2", "f3"):  # compression; force
            assert cycles(rows[column][samples == sample]).max() == 6, (sample, column)


def test_noise_level_finds_white_noise_on_a_smooth_signal():
    rng = np.random.default_rng(5)
    u = np.sin(np.linspace(0, 60, 20_000))
    assert noise_level(u) < 1e-6
    # Smallest of five estimates, each good to about 1 % at 20,000 samples.
    assert noise_level(u + rng.normal(0, 0.01, len(u))) == pytest.approx(0.01, rel=0.05)
    long = np.sin(np.linspace(0, 500, 1_500_000))
    assert noise_level(long + rng.normal(0, 0.01, len(long))) == pytest.approx(0.01, rel=0.01)
