"""Rows with a standard deviation each: fits, errors, noise and verdict weigh them by its inverse square."""

from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.optimize import curve_fit

import hysid
import hysteresis
import identify
from hysteresis import Note, Record
from hysteresis.curves import PolynomialCurve
from tests.refusals import raises, refuses
from tests.thorough import rest_thorough

U = np.tile(np.concatenate([np.linspace(0, 2, 30), np.linspace(2, 0, 30)]), 3)


def made(seed: int = 0, y: np.ndarray | None = None, spread: float = 0.6) -> Record:
    """Cycles of a cubic, or of `y`, with readings of very different scatter."""
    random = np.random.default_rng(seed)
    sigma = random.uniform(0.05, spread, U.size)
    y = 1 + 2 * U - 0.7 * U**2 + 0.1 * U**3 if y is None else y
    y = y + 0.1 * sigma * random.normal(size=U.size)
    return Record.from_arrays(U, y, 0.1 * np.arange(U.size), sigma=sigma)


def cubic(record: Record) -> identify.FitResult:
    start = PolynomialCurve([0.0, 1.0, 0.0, 0.0], 0.0, 2.0)
    return identify.fit(record, start, noise="gaussian", starts=1)


def test_a_polynomial_is_that_of_curve_fit():
    record = made()
    found = cubic(record)
    at, covariance = curve_fit(
        lambda x, *c: np.polynomial.polynomial.polyval(x, c), record.input - 1, record.output,
        p0=[0, 1, 0, 0], sigma=record.sigma,
    )  # fmt: skip
    values = np.array([p.value for p in found.parameters[:4]])
    errors = np.array([p.stderr for p in found.parameters[:4]])
    assert values == pytest.approx(at, rel=1e-6)
    # Ours are wider by the uncertainty of the noise's size, alike for all.
    assert errors / np.sqrt(np.diagonal(covariance)) == pytest.approx(1.0, abs=0.01)


@settings(max_examples=5, deadline=None)
@given(
    rows=st.lists(st.integers(1, U.size - 2), min_size=1, max_size=20, unique=True),
    wrong=st.floats(-1e3, 1e3),
)
def test_rows_of_a_huge_sigma_have_no_influence(rows, wrong):
    record = made()
    y, sigma = record.output.copy(), record.sigma.copy()
    y[rows], sigma[rows] = wrong, 1e9
    mask = np.ones(U.size, bool)
    mask[rows] = False
    spoilt = Record.from_arrays(U, y, record.time, sigma=sigma)
    without = Record.from_arrays(U, record.output, record.time, sigma=record.sigma, mask=mask)
    one, other = cubic(spoilt), cubic(without)
    values = [[p.value for p in found.parameters] for found in (one, other)]
    assert values[0] == pytest.approx(values[1], rel=1e-9)
    assert one.metrics["train"] == pytest.approx(other.metrics["train"], nan_ok=True)


@pytest.mark.parametrize("value", ["0", "-1", "", "inf"])
def test_a_sigma_that_is_none_is_refused_with_its_line(tmp_path: Path, value):
    path, cells = tmp_path / "rig.csv", ["0.1"] * 30
    cells[7] = value
    path.write_text("force,x,s\n" + "".join(f"{k},{k},{s}\n" for k, s in enumerate(cells)))
    code = "not-finite" if value == "inf" else "bad-deviation"
    with raises(code, "line 9", "'s'", "Fix: "):
        hysteresis.read_csv(path, "force", "x", sigma="s")


def test_a_sigma_survives_whatever_is_done_to_a_record(tmp_path: Path):
    y, groups = np.concatenate([U, U]), np.repeat(["a", "b"], U.size)
    sigma = 1 + np.arange(y.size) / 100
    record = Record.from_arrays(y, 2 * y, 0.1 * np.arange(y.size), groups, sigma=sigma)
    assert record.take_rows(5, 50).sigma == pytest.approx(sigma[5:50])
    assert record.take_sequences(["b"]).sigma == pytest.approx(sigma[U.size :])
    train, test = record.split_cycles(1)
    assert train.sigma == pytest.approx(sigma)
    assert test.weights[train.mask].max(initial=0) == 0
    assert np.mean(test.weights[test.mask] ** 2) == pytest.approx(1.0)
    assert record.resample(0.2).sigma == pytest.approx(sigma[::2], abs=0.011)
    assert record.select("both").sigma is not None
    assert record.digest() != Record.from_arrays(y, 2 * y, record.time, groups).digest()
    fit = identify.fit(train, "LinearSponge", starts=1, noise="gaussian", test=test)
    identify.save(fit, tmp_path / "kept")
    kept = identify.load(tmp_path / "kept")
    assert kept.train.weights == pytest.approx(train.weights)
    assert kept.test.sigma == pytest.approx(sigma)


def test_the_verdict_tells_the_reduced_chi_square():
    found = cubic(made())
    (note,) = [one for one in map(Note.of, found.verdict.reasons) if one.code == "sigma"]
    record = found.train
    chi2 = np.sum((found.residuals / record.sigma) ** 2) / (len(record) - 4)
    assert note.values["chi2"] == pytest.approx(chi2, rel=1e-9)
    assert note.values["chi2"] == pytest.approx(0.01, rel=0.2)
    assert "reduced chi-square" in note.text


@pytest.mark.parametrize("model", rest_thorough(["Preisach", "Composition"], 1))
def test_the_posterior_of_weights_has_the_noise_of_weighted_rows(model):
    record = made()
    found = identify.fit(record, model)
    posterior = identify.sample(found, steps=400, ensembles=2)
    sigma = posterior.draws[..., posterior.names.index("sigma")]
    assert sigma.mean() == pytest.approx(found.noise.sigma, rel=0.2)
    assert found.noise.sigma == pytest.approx(0.1 * record.typical_sigma, rel=0.2)


def test_predicted_bands_are_as_wide_as_each_rows_sigma():
    found = cubic(made())
    bands = identify.predictive(found)
    wide = (bands.high - bands.low)[1]
    assert np.corrcoef(wide, found.train.sigma[bands.rows])[0, 1] > 0.99
    assert 0.8 < bands.coverage[1] < 0.97


def test_an_oscillator_refuses_sigma():
    refuses("bad-option", lambda: identify.fit(made(), "Oscillator"), "sigma")


def test_moduli_are_weighted_by_their_sigma(tmp_path: Path):
    w = np.geomspace(0.01, 100, 40)
    modulus, wrong = 1 + 2j * w / (1 + 1j * w), np.arange(w.size) % 4 == 1
    storage, sigma = modulus.real * (1 + 0.2 * wrong), np.where(wrong, 5.0, 0.01)
    columns = (w / (2 * np.pi), storage, modulus.imag, sigma)
    path = tmp_path / "sweep.csv"
    np.savetxt(
        path, np.column_stack(columns), delimiter=",", header="f (Hz),G1 (Pa),G2 (Pa),s",
        comments="",
    )  # fmt: skip
    off = {}
    for name in ("", "s"):
        columns = {"frequency": "f (Hz)", "output": "G1 (Pa)", "loss": "G2 (Pa)"}
        read = hysid.records(path, **columns, sigma=name or None)
        off[name] = abs(identify.fit_step(read[""][0], terms=1)["tau1"].value - 1)
    assert off["s"] < 0.01 * off[""]
