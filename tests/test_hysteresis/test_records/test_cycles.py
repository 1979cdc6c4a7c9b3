"""Turning points, branches and cycles: the count must be the rig's, not the noise's."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hysteresis.records._cycles import (
    branches,
    cycles,
    default_dead_band,
    loop_sums,
    noise_level,
    turning_points,
)

DATA = Path(os.environ.get("HYSID_DATA", Path(__file__).parents[4] / "shared" / "data"))


def triangles(n_cycles: int, samples: int) -> np.ndarray:
    """`n_cycles` triangles 0 -> 1 -> 0, `samples` samples a leg."""
    return np.interp(
        np.arange(2 * n_cycles * samples + 1),
        samples * np.arange(2 * n_cycles + 1),
        np.arange(2 * n_cycles + 1) % 2,
    )


def test_triangle_wave_by_hand():
    u = np.array([0, 1, 2, 1, 0, 1, 2, 1, 0], float)
    assert turning_points(u, 0.5).tolist() == [0, 2, 4, 6, 8]
    assert branches(u).tolist() == [1, 1, 1, -1, -1, 1, 1, -1, -1]
    assert cycles(u).tolist() == [1, 1, 1, 1, 1, 2, 2, 2, 2]


def test_a_plateau_belongs_to_the_branch_before_it():
    u = np.array([0, 0, 1, 2, 2, 2, 1, 0, 0], float)
    assert branches(u).tolist() == [1, 1, 1, 1, 1, 1, -1, -1, -1]
    assert cycles(u).tolist() == [1] * 9


def test_falling_first_counts_from_peak_to_peak():
    u = -triangles(3, 10)
    assert cycles(u).max() == 3
    assert branches(u)[5] == -1


@pytest.mark.parametrize("n", range(4))
def test_short_and_constant_sequences(n):
    u = np.zeros(n)
    assert cycles(u).tolist() == [0] * n
    assert branches(u).tolist() == [1] * n
    assert noise_level(u) == 0


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


@given(
    st.integers(1, 12),
    st.integers(6, 60),
    st.floats(0, 0.045),
    st.integers(0, 2**32 - 1),
)
def test_noise_below_the_dead_band_changes_nothing(n_cycles, samples, size, seed):
    u = triangles(n_cycles, samples)
    noise = np.random.default_rng(seed).uniform(-size, size, len(u))
    assert cycles(u + noise, 0.1).max() == n_cycles


@given(st.integers(1, 12), st.integers(15, 60), st.floats(0, 0.02), st.integers(0, 2**32 - 1))
def test_the_default_dead_band_survives_gaussian_noise(n_cycles, samples, sd, seed):
    u = triangles(n_cycles, samples)
    assert cycles(u + np.random.default_rng(seed).normal(0, sd, len(u))).max() == n_cycles


@given(
    st.lists(st.integers(-100, 100), min_size=2, max_size=40),
    st.integers(2, 50),
    st.integers(0, 30),
)
def test_denser_sampling_changes_nothing(corners, times, band):
    u = np.array(corners, float)
    k = np.arange(len(u))
    dense = np.interp(np.arange((len(u) - 1) * times + 1) / times, k, u)
    assert cycles(dense, band).max() == cycles(u, band).max()
    found, denser = u[turning_points(u, band)], dense[turning_points(dense, band)]
    assert np.array_equal(found, denser)


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=200), st.floats(0, 500))
def test_legs_alternate_and_exceed_the_dead_band(values, band):
    u = np.array(values)
    points = turning_points(u, band)
    assert points[0] == 0
    assert points[-1] == len(u) - 1
    legs = np.diff(u[points])[1:-1]
    assert np.all(np.abs(legs) > band)
    assert np.all(legs[1:] * legs[:-1] < 0)


@given(st.integers(4, 60), st.integers(1, 10))
def test_coarse_sines_keep_their_cycles(samples, n_cycles):
    u = -np.cos(2 * np.pi * np.arange(n_cycles * samples + 1) / samples)
    assert cycles(u).max() == n_cycles


def test_noise_level_finds_white_noise_on_a_smooth_signal():
    rng = np.random.default_rng(5)
    u = np.sin(np.linspace(0, 60, 20_000))
    assert noise_level(u) < 1e-6
    # Smallest of five estimates, each good to about 1 % at 20,000 samples.
    assert noise_level(u + rng.normal(0, 0.01, len(u))) == pytest.approx(0.01, rel=0.05)
    long = np.sin(np.linspace(0, 500, 1_500_000))
    assert noise_level(long + rng.normal(0, 0.01, len(long))) == pytest.approx(0.01, rel=0.01)


def test_the_dead_band_is_at_most_a_quarter_of_the_range():
    u = np.random.default_rng(0).normal(size=1000)
    assert default_dead_band(u) == pytest.approx(np.ptp(u) / 4)


@given(st.floats(0.05, 3), st.floats(-2, 2), st.booleans())
def test_loop_area_has_the_sign_of_the_lag_and_ignores_drift(lag, drift, leads):
    t = np.linspace(0, 6 * np.pi, 601)
    y = -np.cos(t + lag * (0.5 if leads else -0.5)) + drift * t / t[-1]
    net, total, _, _ = loop_sums(-np.cos(t), y, np.ones(601, bool))
    assert net / total == pytest.approx(-1 if leads else 1, abs=0.05)


def test_foam_has_six_cycles_and_a_tail_in_none():
    path = DATA / "foam-midsole-compression" / "tidy.csv"
    if not path.exists():
        pytest.skip(f"no measured data at {DATA}")
    rows = np.genfromtxt(path, delimiter=",", skip_header=1, dtype=None, encoding="utf-8")
    samples = rows["f0"]
    for sample in np.unique(samples):
        for column in ("f2", "f3"):  # compression; force
            assert cycles(rows[column][samples == sample]).max() == 6, (sample, column)
