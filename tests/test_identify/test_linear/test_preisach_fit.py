"""The linear fit of a Preisach model: its design is the model, and it finds what made the data."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from compensate import invert
from hysteresis import Preisach, Record
from hysteresis.preisach import GridDensity
from identify import fit, load, save
from identify.internal import excited_cells
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
    record = Record.from_arrays(u, y)
    model = fit(record, "Preisach").model
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
