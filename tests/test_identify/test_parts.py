"""Transform, noise, hold-outs and figures: the small parts of a fit."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hysteresis import Burgers, Record
from identify import estimate_noise, metrics
from identify.parameters._transform import Transform, transform
from identify.records._folds import parts, thinned

positive = st.floats(1e-6, 1e6)


@given(positive, positive, positive, positive, st.floats(-1e3, 1e3))
def test_transform_undoes_itself(E1: float, eta1: float, E2: float, eta2: float, d: float) -> None:
    model = Burgers(E1, eta1, E2, eta2, d)
    bounds = transform(model, scale=7.0)
    assert bounds.names == ("E1", "eta1", "E2", "eta2", "offset")
    values = bounds.to_values(jnp.asarray(bounds.to_free(model)))
    # log and exp lose a relative 1e-16 times the size of the logarithm.
    np.testing.assert_allclose(values, bounds.values(model), rtol=1e-13, atol=1e-12)


@given(st.floats(-30, 30))
def test_values_stay_inside_their_bounds(z: float) -> None:
    bounds = Transform(
        ("a", "b", "c", "d"), (0.0, -np.inf, 2.0, -np.inf), (np.inf, 1.0, 5.0, np.inf), 3.0
    )
    a, b, c, d = np.asarray(bounds.to_values(jnp.full(4, z)))
    assert a > 0
    assert b <= 1
    assert 2 <= c <= 5
    assert d == pytest.approx(3 * z, abs=1e-300)  # XLA flushes denormals to zero


def test_white_noise_counts_in_full() -> None:
    residuals = np.random.default_rng(0).normal(0, 2.0, 20_000)
    noise = estimate_noise([residuals])
    # The deviation of a deviation is 1/sqrt(2N) = 0.5 %; of the window's sum, about sqrt(2 M/N) = 2 %.
    assert noise.sigma == pytest.approx(2.0, rel=0.02)
    assert noise.correlation_time == pytest.approx(1.0, abs=0.08)


@pytest.mark.parametrize("phi", [0.5, 0.9])
def test_coloured_noise_counts_for_less(phi: float) -> None:
    """AR(1): the correlation time is (1 + phi) / (1 - phi)."""
    random = np.random.default_rng(1)
    sequences = []
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


def test_figures_by_hand() -> None:
    found = metrics(np.array([0.0, 1.0, 4.0, 9.0]), np.array([0.0, 2.0, 4.0, 7.0]))
    assert found.rmse == pytest.approx(np.sqrt(5 / 4))
    assert found.nrmse_percent == pytest.approx(100 * np.sqrt(5 / 4) / 9)
    assert found.max_abs == 2.0
    assert found.r2 == pytest.approx(1 - 5 / 49)


@pytest.mark.parametrize(
    ("amplitudes", "groups"),
    [
        ([1, 1, 3, 3, 3, 1], [{0, 1, 5}, {2}, {3}, {4}]),  # the smaller ones all at once
        ([1, 2, 3, 3], [{0}, {1}, {2}, {3}]),
        ([3, 1], [{0}, {1}]),  # one alone shows the largest range
        ([1.0, 1.1, 1.2, 1.3, 1.4, 1.5], [{0, 5}, {1}, {2}, {3}, {4}]),  # a continuum is dealt out
        ([1, 2, 3, 4, 5, 5], [{0, 5}, {1}, {2}, {3}, {4}]),  # more kinds than groups
    ],
)
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
    assert cut.folds == (((0, 1, 2), (3,)),)
    assert cut.conditioning == 0
    assert cut.without_conditioning((0, 1, 2), dropped=True) == (1, 2)
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


def test_rows_in_no_cycle_are_fitted_but_never_held_out() -> None:
    record = cycles(3)
    held = np.concatenate([record.input, np.linspace(0.0, 0.4, 30)])
    cut = parts(Record.from_arrays(held, held))
    (fold,) = cut.folds
    assert (cut.label[-20:] == 3).all()
    assert 3 in fold.train
    assert fold.test == (2,)


def test_groups_are_held_out_whole() -> None:
    record = Record.from_arrays(
        np.tile([0.0, 1.0, 0.0], 7), np.zeros(21), groups=np.arange(21) // 3
    )
    cut = parts(record)
    assert len(cut.folds) == 5
    for fold in cut.folds:
        assert not set(fold.train) & set(fold.test)
        for _, rows in record.sequences():
            assert len(set(cut.label[rows])) == 1


@pytest.mark.parametrize("heights", [(1.0, 2.0), (1.0, 2.0, 3.0), (1.0, 1.0, 2.0, 2.0)])
def test_inputs_beyond_all_others_are_never_held_out(heights: tuple[float, ...]) -> None:
    inputs = np.concatenate([[0.0, height, 0.0] for height in heights])
    record = Record.from_arrays(inputs, inputs, groups=np.arange(len(inputs)) // 3)
    cut = parts(record)
    for fold in cut.folds:
        seen = record.input[np.isin(cut.label, fold.train)]
        assert record.input[np.isin(cut.label, fold.test)].max() <= seen.max()
    assert ("beyond" in cut.how) == (heights.count(max(heights)) == 1)


def test_rows_that_do_not_count_are_in_no_part() -> None:
    record, _ = cycles(4).split_cycles(1)
    cut = parts(record)
    assert (cut.label[~record.mask] == -1).all()
    assert cut.all == (0, 1, 2)


@pytest.mark.parametrize("count", [3, 5, 9, 40])
def test_merged_parts_have_the_folds_of_all_cycles(count: int) -> None:
    """Fewer parts, and the same rows in every fold and in the conditioning cycle."""
    cut = parts(cycles(count))
    few = cut.merged
    assert len(few.all) <= min(len(cut.all), 2 + 2 * len(cut.folds))
    for one, other in zip(cut.folds, few.folds, strict=True):
        for before, after in zip(one, other, strict=True):
            np.testing.assert_array_equal(np.isin(cut.label, before), np.isin(few.label, after))
    assert cut.conditioning is not None
    assert few.conditioning is not None
    np.testing.assert_array_equal(cut.label == cut.conditioning, few.label == few.conditioning)
    np.testing.assert_array_equal(cut.label < 0, few.label < 0)


@pytest.mark.parametrize("period", [125, 250, 375])
def test_thinned_rows_show_every_phase_of_a_cycle(period: int) -> None:
    """Every 125-th row of these cycles shows one, two or three phases of them."""
    rows = thinned(np.arange(100_000), 800)
    assert len(np.unique(rows)) == len(rows) == 800
    assert (np.diff(rows) > 0).all()
    phases = np.bincount(20 * (rows % period) // period, minlength=20)
    assert phases.min() > 0.8 * 40
    np.testing.assert_array_equal(thinned(np.arange(5), 9), np.arange(5))
