"""First-order reversal curves: found in any history, turned into a density and into a model."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from hysteresis import Record, read_csv
from identify import everett_surface, fit, forc_curves, forc_diagram, load, sample, save
from identify.internal import Forc
from tests.problems import HIGH, LOW, histories
from tests.refusals import refuses
from tests.thorough import rest_thorough

RANGE = HIGH - LOW


def uniform_forc(b: float, u: np.ndarray) -> np.ndarray:
    """y(u | b) of relays spread evenly: E(a, b) = (a - b)^2, and E(high, low) at saturation."""
    return RANGE**2 + 2 * ((u - b) ** 2 - (HIGH - b) ** 2)


def uniform_output(u: np.ndarray) -> float:
    """The last output of a path from saturation, from the dominant extrema by their definition."""
    y, rising, here, rest = -(RANGE**2), True, LOW, u
    while True:
        extreme = rest.max() if rising else rest.min()
        y += (2 if rising else -2) * (extreme - here) ** 2
        if extreme == rest[-1]:
            return float(y)
        rest = rest[len(rest) - int(np.argmax(rest[::-1] == extreme)) :]
        here, rising = extreme, not rising


def gaussian_curve(b: float, u: np.ndarray) -> Forc:
    """Thresholds normal about 1 and -1, deviation 0.3: E(a, b) = F(a - 1) (1 - F(b + 1)).

    The part below the diagonal is less than 1e-5: thresholds lie 4.7 deviations apart.
    """
    E = norm.cdf(u, 1, 0.3) * norm.sf(b, -1, 0.3)
    return Forc(b, u, 2 * E - 2 * norm.sf(b, -1, 0.3))


def quadratic(rng: np.random.Generator, noise: float = 0.0) -> tuple[tuple[Forc, ...], float]:
    """Curves of a quadratic surface at uneven places, and its rho."""
    a, curves = rng.normal(size=6), []
    for b in np.cumsum(rng.uniform(0.5, 1.5, 30)):
        u = b + np.append(0.0, np.cumsum(rng.uniform(0.5, 1.5, 40)))
        y = a[0] + a[1] * b + a[2] * b**2 + a[3] * u + a[4] * u**2 + a[5] * b * u
        curves.append(Forc(float(b), u, y + noise * rng.normal(size=u.shape)))
    return tuple(curves), -a[5] / 2


@given(histories(LOW, HIGH))
def test_every_curve_found_is_one(history: np.ndarray):
    """Of any history, minor loops and all, that visits nothing near the top but the top itself."""
    u = np.append(HIGH, np.where(history > HIGH - 0.02 * RANGE, HIGH, history))
    y = np.array([uniform_output(u[: k + 1]) for k in range(len(u))])
    record = Record.from_arrays(u, y)
    last = u[np.flatnonzero(u == HIGH)[-1] :]
    # Where it ends at its lowest, it does not turn.
    turned = u[: -len(last)] if last[-1] == last.min() else u
    if turned.min(initial=HIGH) == HIGH:
        refuses("too-few-curves", lambda: forc_curves(record))
        return
    curves = forc_curves(record)
    assert min(curve.reversal for curve in curves) <= np.min(turned[turned < HIGH])
    for b, x, y in curves:
        assert x[0] == b
        assert (np.diff(x) > 0).all()
        np.testing.assert_allclose(y, uniform_forc(b, x), atol=1e-12 * RANGE**2)


def test_a_record_of_reversal_curves_is_read_off(tmp_path: Path):
    """Relays spread evenly, 14 curves of which one sequence holds one; held-out ones lie between."""
    down = np.linspace(LOW, HIGH - 0.2 * RANGE, 14)
    rows = [np.linspace(b, HIGH, 25) for b in down]
    y = np.concatenate([uniform_forc(b, row) for b, row in zip(down, rows, strict=True)])
    record = Record.from_arrays(np.concatenate(rows), y, groups=np.repeat(np.arange(14), 25))
    found = fit(record, "EverettSurface")
    # Between nodes the output is bilinear. Held out, the first and the last curve are extrapolated.
    assert np.abs(found.residuals).max() < 5e-3 * RANGE**2
    assert found.score < 3
    again = load(save(found, tmp_path / "fit"))
    assert again.detail.words() == found.detail.words() == {"reversal_curves": 14}
    np.testing.assert_array_equal(again.predict(record), found.predict(record))
    refuses("no-posterior", lambda: sample(found))


@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
@settings(max_examples=20)
def test_a_quadratic_surface_is_reproduced(seed: int, smoothing: int):
    curves, rho = quadratic(np.random.default_rng(seed))
    diagram = forc_diagram(curves, smoothing)
    scale = max(np.ptp(np.concatenate([c.output for c in curves])), 1.0)
    # Rounding of y over the smallest window, about 1 x 1: 1e-16 times its condition, 1e4 at worst.
    np.testing.assert_allclose(diagram.density, rho, atol=1e-11 * scale)
    assert diagram.standard_error.max() < 1e-11 * scale
    np.testing.assert_allclose(diagram.bias + diagram.coercivity, diagram.input)
    np.testing.assert_allclose(diagram.bias - diagram.coercivity, diagram.reversal)
    # Of the smallest window six points are left at an edge, too few: of 30 curves 2, of 41 samples 2.
    assert len(diagram.input) > 0.87 * sum(len(c.input) for c in curves)


def test_standard_errors_are_calibrated():
    z = []
    for seed in range(10):
        curves, rho = quadratic(np.random.default_rng(seed), noise=0.1)
        diagram = forc_diagram(curves, 3)
        z.append((diagram.density - rho) / diagram.standard_error)
    # 10 x 30 x 40 points with windows of 49: some 250 independent ones, so 0.05 of deviation;
    # Student's t with 43 degrees of freedom has 1.02, with the fewer at the edges a little more.
    assert 0.87 < np.std(np.concatenate(z)) < 1.18


def curves_of(seed: int) -> tuple[Forc, ...]:
    """Any curves at all: nine, uneven, noisy, ending anywhere."""
    rng, curves = np.random.default_rng(seed), []
    for b in np.cumsum(rng.uniform(0.5, 1.5, 9)):
        u = b + np.append(0.0, np.cumsum(rng.uniform(0.2, 0.6, int(rng.integers(10, 30)))))
        curves.append(Forc(float(b), u, rng.normal(size=u.shape) + rng.normal() * u))
    return tuple(curves)


@pytest.mark.parametrize("seed", rest_thorough([0, 1, 2], 1))
def test_the_model_reproduces_any_curves_at_the_nodes(seed: int):
    curves = curves_of(seed)
    surface = everett_surface(curves, cells=40)
    nodes, model = surface.nodes, surface.model
    assert set(nodes) >= {curve.reversal for curve in curves}
    pieces = [nodes[(nodes >= c.reversal) & (nodes <= c.input[-1])] for c in curves]
    measured = [np.interp(u, c.input, c.output) for u, c in zip(pieces, curves, strict=True)]
    u, starts = np.concatenate(pieces), np.cumsum([0, *map(len, pieces[:-1])])
    y = np.asarray(model.evaluate(model.prepare(None, u, starts=tuple(starts.tolist()))))
    # Sums of some hundred numbers of that size.
    np.testing.assert_allclose(y, np.concatenate(measured), atol=1e-12 * np.abs(y).max())
    for x, z in zip(pieces, measured, strict=True):
        at = np.searchsorted(nodes, x)
        E = surface.everett[at, at[0]]
        np.testing.assert_allclose(E, (z - z[0]) / 2, atol=1e-12 * np.abs(y).max())


@pytest.mark.thorough
def test_real_curves_held_out(measured_data: Path):
    """Every other curve of a nanowire array from the ones between."""
    file = measured_data / "forc-magnetic" / "tidy_feco_nanowires.csv"
    if not file.is_file():
        pytest.skip(f"no {file.name}")
    record = read_csv(file, input="field_Oe", output="moment_emu", group="curve")
    train, test = record.split_groups([str(k) for k in range(0, 152, 2)])
    model = everett_surface(forc_curves(train)).model
    starts = tuple(test.starts.tolist())
    y = np.asarray(model.evaluate(model.prepare(None, test.input, starts=starts)))
    error = np.sqrt(np.mean((y - test.output) ** 2)) / np.ptp(test.output)
    # Third differences along a curve show a noise of 0.015 %, so 0.018 % is the least.
    assert error < 0.03e-2


def with_ties() -> tuple[Forc, ...]:
    curve = gaussian_curve(0.0, np.linspace(0, 2, 30))
    return tuple([curve] * 7)


@pytest.mark.parametrize(("code", "call"), [
    ("bad-option", lambda: forc_diagram(curves_of(0), 0)),
    ("too-few-curves", lambda: forc_diagram(curves_of(0), 5)),
    ("too-few-curves", lambda: everett_surface(curves_of(0)[:1])),
    ("not-increasing", lambda: forc_diagram(with_ties(), 3)),
    ("not-increasing", lambda: everett_surface(curves_of(0)[::-1])),
    ("too-few-rows",
     lambda: forc_diagram(tuple(Forc(c.reversal, *np.array(c[1:])[:, :6]) for c in curves_of(0)))),
    ("too-few-curves", lambda: forc_curves(Record.from_arrays(np.arange(5.0)[::-1], np.zeros(5)))),
])  # fmt: skip
def test_bad_input_is_answered(code: str, call):
    refuses(code, call)
