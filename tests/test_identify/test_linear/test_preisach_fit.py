"""The linear fit of a Preisach model: its design is the model, at every size, with its prior and state."""

from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from compensate import invert
from hysteresis import Preisach, Record
from hysteresis.internal import SumDensity
from hysteresis.preisach import GaussianDensity, GridDensity
from identify import fit, fit_density, fit_density_in_blocks, load, save
from identify.internal import excited_cells
from tests.refusals import raises, refuses
from tests.thorough import rest_thorough


def history(seed: int, turns: int = 30, samples: int = 12) -> np.ndarray:
    """A zigzag between random extrema in [0, 1], the whole range first."""
    random = np.random.default_rng(seed)
    corners = np.concatenate([[0.0, 1.0, 0.0], random.uniform(size=turns)])
    return np.interp(np.arange(samples * len(corners)) / samples, np.arange(len(corners)), corners)


def true_model(n: int, leading: bool, seed: int = 0, initial: str = "negative") -> Preisach:
    """A smooth density below a reversible part that is steep enough to be inverted."""
    middle = (np.arange(n) + 0.5) / n
    alpha, beta = np.meshgrid(middle, middle, indexing="ij")
    weights = np.tril(np.exp(-(((alpha - beta - 0.3) / 0.3) ** 2)))
    weights /= weights.sum()
    reversible = (3.0 if leading else 0.5) * (1 + middle) / n
    return Preisach(GridDensity(0, 1, weights), reversible, 0.3, leading=leading, initial=initial)  # type: ignore[arg-type]


@pytest.mark.parametrize("leading", rest_thorough([False, True], 1))
def test_finds_the_model_that_made_the_data(leading: bool) -> None:
    """Noise of 0.1 % of the range; judged on another history, against the truth without noise."""
    truth, random = true_model(12, leading), np.random.default_rng(1)
    u = history(0, turns=60)
    y = np.asarray(truth.simulate(None, u))
    noise = 1e-3 * np.ptp(y)
    record = Record.from_arrays(u, y + random.normal(0, noise, len(y)))
    found = fit(record, "Preisach")
    assert found.model.leading is leading
    other = history(7)
    error = np.asarray(found.model.simulate(None, other) - truth.simulate(None, other))
    # Ten samples fix a weight: the error is a fraction of the noise, and never above it.
    assert np.sqrt(np.mean(error**2)) < noise


def test_a_leading_fit_can_always_be_inverted() -> None:
    """Data whose true slope is zero after every reversal: without constraints it would go below."""
    truth = true_model(10, True)
    flat = np.maximum(-np.asarray(Preisach(truth.density, leading=True).least_slope()) / 10, 0)
    truth = Preisach(truth.density, flat, 0.0, leading=True)
    u, random = history(3), np.random.default_rng(0)
    y = np.array(truth.simulate(None, u))
    y += random.normal(0, 0.01 * np.ptp(y), len(y))
    model = fit(Record.from_arrays(u, y), "Preisach").model
    assert model.leading
    assert float(model.least_slope().min()) >= -1e-12
    clean = model.simulate(None, u)
    again = model.simulate(None, invert(model).simulate(None, clean).value)
    assert float(jnp.abs(again - clean).max()) <= 1e-9 * float(np.ptp(clean))


def test_cells_are_narrow_where_a_loop_is_steep(tmp_path: Path) -> None:
    """A magnet that switches from row to row: cells of one width would smear it over ten rows."""
    u = np.concatenate([np.linspace(1500.0, -1500.0, 150), np.linspace(-1500.0, 1500.0, 150)])
    moved = np.where(np.arange(300) < 150, u + 210.0, u - 210.0)
    y = 5 * np.tanh(moved / 5.0) + 2e-4 * u
    y += np.random.default_rng(0).normal(0, 0.05, len(u))
    found = fit(Record.from_arrays(u, y), "Preisach")
    density = found.model.density
    # The noise is 0.5 % of the range; a cell of one width at 40 of them holds four rows of each switch.
    assert found.metrics["train"].nrmse_percent < 1.0
    assert np.diff(density.edges).min() < 0.6 * 3000 / density.cells
    width = next(p for p in found.parameters if p.name == "loop.width")
    # The branches are 10 apart over 420 of 3000.
    assert abs(width.value - 1.4) < 3 * width.stderr + 0.02
    u2 = np.linspace(-1500.0, 1500.0, 4001)
    loop = np.asarray(found.model.simulate(None, np.concatenate([u2, u2[::-1]])))
    apart = loop[:4000:-1] - loop[:4001]
    # The parameter is corrected for the push of prior and signs, a part of its error.
    assert abs(np.trapezoid(apart, u2) / 3000 - width.value) < width.stderr
    save(found, tmp_path / "fit")
    assert load(tmp_path / "fit").model.density.nodes == density.nodes
    assert excited_cells(found.model, found.train, found.used).any()


def walk(seed: int, turns: int = 40, samples: int = 800) -> np.ndarray:
    """A zigzag between random extrema in [0, 1], the whole range first."""
    at = np.concatenate([[0.0, 1.0, 0.0], np.random.default_rng(seed).random(turns)])
    return np.interp(np.linspace(0, len(at) - 1, samples), np.arange(len(at)), at)


def bump(cells: int) -> np.ndarray:
    middle = (np.arange(cells) + 0.5) / cells
    alpha, beta = np.meshgrid(middle, middle, indexing="ij")
    w = np.tril(np.exp(-(((alpha - beta - 0.25) / 0.15) ** 2) - ((alpha + beta - 1) / 0.3) ** 2))
    return w / w.sum()


def record_of(model: Preisach, u: np.ndarray, noise: float = 0.002) -> Record:
    y = np.asarray(model.simulate(None, u))
    return Record.from_arrays(u, y + np.random.default_rng(9).normal(0, noise * np.ptp(y), len(y)))


TRUTH = Preisach(GridDensity(0.0, 1.0, bump(16)), np.full(16, 0.02), 0.3)


@pytest.mark.parametrize("strength", rest_thorough([1e-4, 1e-1], 1))
def test_products_find_what_the_matrix_finds(strength: float, monkeypatch: pytest.MonkeyPatch):
    record = record_of(TRUTH, walk(1))
    dense = fit_density(record, 24, strength=strength)
    monkeypatch.setattr("identify.linear._density_fit.DENSE", 12)
    by_products = fit_density(record, 24, strength=strength)
    outputs = [one.model.simulate(None, walk(5)) for one in (by_products, dense)]
    np.testing.assert_allclose(*outputs, atol=1e-6)


def test_the_strength_of_greatest_evidence_predicts_best() -> None:
    """Within a tenth of the best of a scan over nine decades, judged on another history."""
    record, other = record_of(TRUTH, walk(2), noise=0.01), walk(7)
    truth = np.asarray(TRUTH.simulate(None, other))

    def error(strength: float | None) -> float:
        model = fit_density(record, 16, strength=strength).model
        return float(np.sqrt(np.mean((np.asarray(model.simulate(None, other)) - truth) ** 2)))

    assert error(None) < 1.1 * min(error(10.0**k) for k in range(-8, 1))


def test_a_first_state_is_fitted() -> None:
    """A record that starts in the middle of a history; its staircase runs along cells' edges."""
    turns = np.random.default_rng(4).integers(0, 17, 60) / 16
    turns[:6] = 0.0, 1.0, 0.25, 0.75, 0.375, 0.5
    history = np.interp(np.arange(60 * 20) / 20, np.arange(60), turns)
    y, start = np.asarray(TRUTH.simulate(None, history)), 100
    cut = slice(start, None)
    noise = np.random.default_rng(0).normal(0, 1e-3 * np.ptp(y), len(y))
    record = Record.from_arrays(history[cut], (y + noise)[cut])
    error = {}
    for initial in ("negative", "positive", "fit"):
        model = fit_density(record, 16, low=0.0, high=1.0, initial=initial).model
        left = np.asarray(model.simulate(None, history[cut])) - y[cut]
        error[initial] = float(np.sqrt(np.mean(left**2)))
    assert error["fit"] < 0.1 * min(error["negative"], error["positive"])
    assert error["fit"] < 1e-3 * np.ptp(y)  # below the noise


@pytest.mark.parametrize(("code", "keywords"), [
    ("out-of-range", {"low": 0.2}), ("out-of-range", {"high": 0.9}),
    ("bad-option", {"cells": 0}), ("bad-option", {"cells": 100, "leading": True}),
    ("bad-option", {"cells": 100, "initial": "fit"}),
])  # fmt: skip
def test_what_cannot_be_fitted_is_said(code: str, keywords: dict) -> None:
    refuses(code, lambda: fit_density(record_of(TRUTH, walk(0)), **keywords))


@pytest.mark.thorough
def test_a_sum_of_densities_is_saved_and_loaded(tmp_path: Path) -> None:
    parts = (GaussianDensity(0.0, 1.0, 1.0, 0.2, 0.1, 0.5, 0.1), GridDensity(0.2, 0.9, bump(4)))
    model = Preisach(SumDensity(parts), initial=(0.9, 0.1))
    record = record_of(model, walk(2, turns=10, samples=100))
    found = replace(fit(record, "LinearSponge", noise="gaussian", starts=2), model=model)
    again = load(save(found, tmp_path / "fit")).model
    outputs = [one.simulate(None, record.input) for one in (model, again)]
    np.testing.assert_array_equal(*outputs)


ROWS = 600


def columns(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A zigzag and play operators of it."""
    random = np.random.default_rng(seed)
    u = np.interp(np.arange(ROWS) / 9, np.arange(ROWS // 9 + 2), random.uniform(size=ROWS // 9 + 2))
    play, radii, y = np.zeros(3), np.array([0.05, 0.2, 0.4]), []
    for x in u:
        play = np.clip(play, x - radii, x + radii)
        y.append(play.sum())
    return u, np.array(y) + 0.01 * random.normal(size=ROWS)


@pytest.mark.parametrize(("leading", "initial"), [(False, "negative"), (True, "demagnetised")])
def test_blocks_give_the_weights_of_the_whole(leading: bool, initial: str) -> None:
    u, y = columns()
    if leading:
        y = 3 * u - y
    options = {"strength": 1e-3, "low": 0.0, "high": 1.0, "leading": leading, "initial": initial}
    whole = fit_density(Record.from_arrays(u, y), 8, **options)  # type: ignore[arg-type]
    cuts = np.sort(np.random.default_rng(1).integers(1, ROWS, 12))  # some blocks may be empty
    blocks = zip(np.split(u, cuts), np.split(y, cuts), strict=True)
    found = fit_density_in_blocks(blocks, 8, **options)  # type: ignore[arg-type]
    # The same sums in another order.
    np.testing.assert_allclose(found.unknowns, whole.unknowns, rtol=0, atol=1e-8)
    assert found.rows == ROWS
    assert found.rmse == pytest.approx(np.sqrt(np.mean(whole.residuals**2)), rel=1e-6)


def test_errors_say_what_is_wrong() -> None:
    u, y = columns()
    for blocks, code in [
        ([(2 * u, y)], "out-of-range"),
        ([(u, y), (np.array([np.nan]), np.array([0.0]))], "not-numbers"),
        ([(u, 0 * y)], "zero-range"),
        ([], "zero-range"),
    ]:
        with raises(code):
            fit_density_in_blocks(blocks, 4, low=0.0, high=1.0, strength=1e-3)
