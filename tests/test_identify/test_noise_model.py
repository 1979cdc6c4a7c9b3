"""The noise model against dense covariances, SciPy's densities, and simulated residuals."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st

from hysteresis import LinearSponge, Record
from identify import fit
from identify.noise._model import NoiseModel, rows_of
from tests.thorough import rest_thorough

ROWS = 40
inner = st.floats(-0.95, 0.95)


def some_rows(random: np.random.Generator, rows=ROWS, gap=True) -> tuple[Any, np.ndarray]:
    """Rows in three stretches, one of them after a gap, and the stretch of each (-1: does not count)."""
    u, used = random.normal(size=rows), np.ones(rows, bool)
    stretch = np.zeros(rows, int)
    if gap:
        used[10:13] = False
        stretch = np.repeat([0, -1, 1, 2], [10, 3, 12, rows - 25])
    groups = np.repeat(["a", "b"], [25, rows - 25]) if gap else None
    record = Record.from_arrays(u, u, groups=groups, mask=used)
    return rows_of(record, used, random.normal(size=rows)), stretch


def dense(noise: NoiseModel, rows: Any, stretch: np.ndarray) -> np.ndarray:
    """The covariance of the counted residuals, from the autocovariances of an ARMA(1,1) process."""
    phi, theta = (0.0 if x is None else float(x) for x in (noise.phi, noise.theta))
    gamma = (1 + 2 * phi * theta + theta**2) / (1 - phi**2)
    first = (1 + phi * theta) * (phi + theta) / (1 - phi**2)
    rho = np.array([1.0, *(first / gamma * phi**k for k in range(len(stretch)))])
    s, index = np.asarray(noise.scale(rows)), np.arange(len(stretch))
    lag = np.abs(index[:, None] - index)
    alike = stretch[:, None] == stretch
    whole = np.where(alike, rho[lag], 0.0) * s[:, None] * s
    counted = stretch >= 0
    return whole[np.ix_(counted, counted)]


@settings(max_examples=30, deadline=None)
@given(phi=inner, theta=inner, growth=st.floats(0.0, 3.0), seed=st.integers(0, 99))
def test_the_likelihood_is_that_of_the_dense_covariance(phi, theta, growth, seed):
    random = np.random.default_rng(seed)
    rows, stretch = some_rows(random)
    noise = NoiseModel(1.7, growth=growth, input_sigma=0.3, phi=phi, theta=theta)
    r, counted = random.normal(size=ROWS), stretch >= 0
    expected = scipy.stats.multivariate_normal(
        np.zeros(counted.sum()), dense(noise, rows, stretch), allow_singular=True
    ).logpdf(r[counted])
    # SciPy's eigenvalues lose digits where the process is nearly singular.
    assert float(noise.pointwise(jnp.asarray(r), rows).sum()) == pytest.approx(expected, rel=1e-6)


def test_whitening_is_linear_and_whitens() -> None:
    """Residuals of its own covariance become independent ones of unit variance."""
    random = np.random.default_rng(2)
    rows, stretch = some_rows(random)
    noise, counted = NoiseModel(0.8, phi=0.7, theta=-0.3), stretch >= 0
    W = np.asarray(jax.vmap(lambda e: noise.whitened(e, rows))(jnp.eye(ROWS))).T
    W = W[np.ix_(counted, counted)]
    covariance = W @ dense(noise, rows, stretch) @ W.T
    np.testing.assert_allclose(covariance, np.eye(counted.sum()), atol=1e-10)


@pytest.mark.parametrize(
    "kind", rest_thorough(["arma11", "student-t", "gaussian", "ar1", "growing"], 1)
)
def test_evidence_finds_the_kind_of_noise(kind: str) -> None:
    """Of 2,000 rows the evidence is beyond doubt."""
    random = np.random.default_rng(4)
    w = random.standard_t(4, 2000) if kind == "student-t" else random.normal(size=2000)
    e = w.copy()
    for i in range(1, 2000):
        if kind in ("ar1", "arma11"):
            e[i] = 0.8 * e[i - 1] + w[i] + (-0.5 * w[i - 1] if kind == "arma11" else 0.0)
    u = np.linspace(0, 1, 2000)
    if kind == "growing":
        e = e * np.hypot(0.3, 5 * u)
    record = Record.from_arrays(u, 10 * u + e)
    found = fit(record, LinearSponge(1.0, 0.0, -np.inf), noise="auto").noise_model
    names = ("phi", "theta", "tail", "growth")
    known = {name for name in names if getattr(found, name) is not None}
    wanted = {
        "arma11": {"phi", "theta"}, "student-t": {"tail"}, "ar1": {"phi"},
        "growing": {"growth"},
    }  # fmt: skip
    assert known == wanted.get(kind, set())


U = np.tile(np.concatenate([np.linspace(0, 1, 50), np.linspace(1, 0, 50)]), 4)
BENT = 2 * U + 0.3 * U**2 + 0.002 * np.random.default_rng(5).normal(size=400)
CURVE = Record.from_arrays(U, BENT)


def test_a_misfit_is_not_taken_for_noise() -> None:
    """A smooth function of the input, the same in every cycle, is no noise, however it is coloured."""
    result = fit(CURVE, LinearSponge(1.0, 0.0, -np.inf), conditioning="keep")
    assert result.noise_model is None
    K, b = np.polyfit(U, BENT, 1)
    assert (float(result.model.K), float(result.model.b)) == pytest.approx((K, b), rel=1e-6)
    assert result.noise.correlation_time > 10


def test_a_misfit_is_integrated_over() -> None:
    """As if its shapes' covariance were added to that of the noise."""
    random = np.random.default_rng(6)
    rows, stretch = some_rows(random)
    noise = NoiseModel(0.8, phi=0.6, misfit=0.5)
    counted, r = stretch >= 0, random.normal(size=ROWS)
    shapes = np.asarray(rows.shapes)[counted]
    weights = (0.5 / (1 + np.arange(shapes.shape[1]) // 2)) ** 2
    whole = dense(noise, rows, stretch) + (shapes * weights) @ shapes.T
    expected = scipy.stats.multivariate_normal(np.zeros(counted.sum()), whole).logpdf(r[counted])
    assert float(noise.log_likelihood(jnp.asarray(r), rows)) == pytest.approx(expected, rel=1e-9)
    J = random.normal(size=(ROWS, 2))
    found = noise.arithmetic(rows, J).information_of(J, rows)
    np.testing.assert_allclose(found, J[counted].T @ np.linalg.solve(whole, J[counted]), rtol=1e-9)


def test_an_asked_misfit_widens_what_it_hides() -> None:
    """A curve fitted with a line: the slope's error reaches the slopes of its parts."""
    line = LinearSponge(1.0, 0.0, -np.inf)
    plain, honest = (
        fit(CURVE, line, conditioning="keep", noise=noise)
        for noise in ("gaussian", "gaussian+misfit")
    )
    errors = [{p.name: p.stderr for p in f.parameters}["K"] for f in (plain, honest)]
    assert float(honest.noise_model.sigma) == pytest.approx(0.002, rel=0.1)
    assert errors[1] > 10 * errors[0]  # type: ignore[operator]
