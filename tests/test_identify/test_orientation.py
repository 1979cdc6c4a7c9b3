"""Which way the output goes and its loops turn, how noise is counted, and what is held out."""

import numpy as np
import pytest

from hysteresis import Record, StandardLinearSolid
from hysteresis._registry import registered
from identify import fit
from identify.internal import estimate_noise
from identify.records._folds import parts
from identify.records._orientation import output_falls
from tests.thorough import rest_thorough


def ratcheting(sign: float, creep: float) -> Record:
    """Cycles of a lagging loop whose mean moves on by several times its height."""
    t = np.linspace(0, 10, 1001)
    u = 1 + np.sin(2 * np.pi * t)
    y = u - 0.2 * np.cos(2 * np.pi * t) + creep * t
    return Record.from_arrays(u * (1 - 0.03 * t), sign * y, t)


@pytest.mark.parametrize("creep", [-2.0, 0.0, 2.0])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_creep_from_cycle_to_cycle_turns_no_sign(sign: float, creep: float):
    assert output_falls(ratcheting(sign, creep)) == (sign < 0)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("seed", range(8))
def test_the_steps_tell_the_sign_of_friction_on_a_random_path(seed: int, sign: float):
    rng = np.random.default_rng(seed)
    turns = np.append(0.0, rng.uniform(-1, 1, 30))
    u = np.interp(np.arange(900), 30 * np.arange(31), turns)
    held, y = 0.0, np.empty(900)
    for k, move in enumerate(np.diff(u, prepend=0.0)):
        held = np.clip(held + 20 * move, -1, 1)
        y[k] = held
    record = Record.from_arrays(u, sign * y + 0.01 * rng.normal(size=900))
    assert output_falls(record) == (sign < 0)


@pytest.mark.parametrize("units", [("1", "1"), ("mm/mm", "MPa"), ("N", "mm"), ("deg", "1")])
@pytest.mark.parametrize("relaxes", rest_thorough([True, False], 1))
def test_an_input_that_goes_one_way_tells_deformation_from_load(units, relaxes):
    """By the units where both are known, else by what the output does in the hold."""
    t = np.linspace(0.0, 30.0, 200)
    u = np.minimum(t / 3.0, 1.0)
    solid = StandardLinearSolid(4.0, 6.0, 20.0, leading=relaxes)
    y = np.asarray(solid.simulate(t, u)) + np.random.default_rng(0).normal(0, 1e-3, len(t))
    given = Record.from_arrays(u, y, t, input_unit=units[0], output_unit=units[1])
    asked = {("mm/mm", "MPa"): True, ("N", "mm"): False}.get(units, relaxes)
    assert registered(StandardLinearSolid).start(given).leading is asked
    if asked is relaxes:
        found = fit(given, "StandardLinearSolid", starts=2, noise="gaussian")
        assert found.metrics["train"].rmse < 1.2e-3  # that of the noise


@pytest.mark.parametrize("phi", [0.5, 0.9])
def test_coloured_noise_counts_for_less(phi: float) -> None:
    """AR(1): the correlation time is (1 + phi) / (1 - phi)."""
    random, sequences = np.random.default_rng(1), []
    for _ in range(40):
        x, r = np.zeros(4000), random.normal(size=4000)
        x[0] = r[0] / np.sqrt(1 - phi**2)
        for k in range(1, len(x)):
            x[k] = phi * x[k - 1] + r[k]
        sequences.append(x)
    noise = estimate_noise(sequences)
    # Sokal's window of five times tau cuts off exp(-5) of the sum and leaves 3 % of statistics.
    assert noise.correlation_time == pytest.approx((1 + phi) / (1 - phi), rel=0.08)
    assert noise.effective == pytest.approx(160_000 * (1 - phi) / (1 + phi), rel=0.08)


@pytest.mark.parametrize(("amplitudes", "groups"), [
    ([1, 1, 3, 3, 3, 1], [{0, 1, 5}, {2}, {3}, {4}]),  # the smaller ones all at once
    ([1, 2, 3, 3], [{0}, {1}, {2}, {3}]),
    ([3, 1], [{0}, {1}]),  # one alone shows the largest range
    ([1.0, 1.1, 1.2, 1.3, 1.4, 1.5], [{0, 5}, {1}, {2}, {3}, {4}]),  # a continuum is dealt out
    ([1, 2, 3, 4, 5, 5], [{0, 5}, {1}, {2}, {3}, {4}]),  # more kinds than groups
])  # fmt: skip
def test_an_amplitude_is_held_out_whole(amplitudes: list[float], groups: list[set[int]]) -> None:
    u = np.concatenate([a * np.sin(np.linspace(0, 6, 50)) for a in amplitudes])
    of = np.repeat(np.arange(len(amplitudes)), 50)
    label = parts(Record.from_arrays(u, u, groups=of)).label
    found = [set(of[label == k].tolist()) for k in range(label.max() + 1)]
    assert sorted(found, key=min) == groups


def cycles(n: int) -> Record:
    u = np.abs((np.arange(40 * n + 1) / 20 + 1) % 2 - 1)
    return Record.from_arrays(u, u)


def test_the_last_cycle_is_held_out_and_the_first_may_be_conditioning() -> None:
    cut = parts(cycles(4))
    assert (cut.folds, cut.conditioning) == ((((0, 1, 2), (3,)),), 0)
    assert (cut.conditioned.folds, cut.conditioned.fitted) == ((((1, 2), (3,)),), (1, 2, 3))
    assert parts(cycles(4), keep_conditioning=True).conditioning is None
    assert parts(cycles(2)).conditioning is None


def test_of_a_single_loop_pieces_of_both_branches_are_held_out() -> None:
    """No row before the last branch tells what a memory does there. A ramp shows nothing new at its end."""
    u = np.concatenate([np.linspace(1, -1, 200), np.linspace(-1, 1, 200)])
    loop = parts(Record.from_arrays(u, u + 0.1 * np.sign(np.gradient(u))))
    assert len(loop.folds) == 4
    for fold in loop.folds:
        held = np.isin(loop.label, fold.test)
        assert abs(held.mean() - 0.25) < 0.01  # rows of a branch in 8 pieces
        for branch in (slice(0, 200), slice(200, 400)):
            assert abs(held[branch].mean() - 0.25) < 0.02
        # Where one branch is held out, the other is fitted at the same inputs.
        assert not (held[:200] & held[:199:-1]).sum() > 4  # neighbours at the cuts
    for way in (np.linspace(0, 1, 400), np.minimum(np.linspace(0, 4, 400), 1.0)):
        assert len(parts(Record.from_arrays(way, way, np.arange(400.0))).folds) == 1
