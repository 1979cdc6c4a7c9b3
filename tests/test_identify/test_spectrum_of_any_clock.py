"""One spectrum for every clock: moduli, joint fits, known strengths, temperatures, measured ones."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hysteresis import GeneralizedKelvinVoigt, GeneralizedMaxwell, InputError
from identify import Response, master_curve, spectrum
from tests.refusals import refuses
from tests.thorough import rest_thorough

SOLID = GeneralizedMaxwell(0.5, [1.0, 4.0, 2.0], [0.1, 2.0, 30.0])
T, W = np.geomspace(0.01, 300.0, 120), np.geomspace(0.003, 100.0, 80)
TEMPERATURES = [28.0, 34.0, 40.0, 50.0, 60.0, 70.0]


def noisy(y: np.ndarray, size: float, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=len(y))
    return y * (1 + size * (noise + 1j * rng.normal(size=len(y)) if np.iscomplexobj(y) else noise))


def moduli(model: Any, omega: np.ndarray = W) -> np.ndarray:
    return np.asarray(model.complex_modulus(omega))


def rms(found: Any, model: Any, t: np.ndarray = T) -> float:
    wanted = np.asarray(model.relaxation_modulus(t))
    return float(
        np.sqrt(np.mean((np.asarray(found.model.relaxation_modulus(t)) / wanted - 1) ** 2))
    )


def test_moduli_have_the_spectrum_of_relaxation():
    found = spectrum(Response(W, noisy(moduli(SOLID), 1e-3), "modulus"))
    assert isinstance(found.model, GeneralizedMaxwell)
    np.testing.assert_allclose(found.model.tau, SOLID.tau, rtol=0.02)
    np.testing.assert_allclose(found.model.E, SOLID.E, rtol=0.02)
    assert found.notes == ()
    # What is fitted over frequency foretells time.
    assert rms(found, SOLID) < 2e-3


def test_storage_alone_is_enough():
    found = spectrum(Response(W, moduli(SOLID).real, "modulus"), terms=3)
    np.testing.assert_allclose(found.model.tau, SOLID.tau, rtol=1e-3)


@pytest.mark.thorough
def test_records_of_all_clocks_are_fitted_together():
    """Relaxation tells the slow part, moduli the fast one, a ramp and hold and cycles what lies between."""
    truth = GeneralizedMaxwell(0.5, [1.0, 4.0, 2.0, 1.0], [1e-3, 0.1, 20.0, 4000.0])
    t, cycles = np.arange(0.0, 60.0, 0.1), np.arange(0.0, 40.0, 0.05)
    u, s = np.minimum(t / 2.0, 1.0), np.sin(cycles) + 0.3 * np.sin(0.37 * cycles)
    late, fast = np.geomspace(10.0, 2e4, 60), np.geomspace(1.0, 3e4, 60)
    parts = (
        Response(late, noisy(np.asarray(truth.relaxation_modulus(late)), 2e-3), "relaxation"),
        Response(fast, noisy(moduli(truth, fast), 2e-3, 1), "modulus"),
        Response(t, np.asarray(truth.simulate(t, u)), "relaxation", input=u, weight=0.5),
        Response(cycles, np.asarray(truth.simulate(cycles, s)), "relaxation", input=s),
    )
    found = spectrum(*parts, terms=4)
    np.testing.assert_allclose(found.model.tau, truth.tau, rtol=0.05)
    np.testing.assert_allclose(found.model.E, truth.E, rtol=0.05)
    # Each alone misses what the others tell.
    assert rms(spectrum(parts[0]), truth, np.geomspace(1e-4, 1.0, 50)) > 0.1


def test_creep_beside_relaxation_and_beside_moduli():
    solid = GeneralizedKelvinVoigt(2.0, [1.0, 4.0], [0.5, 80.0])
    creep = Response(T, noisy(np.asarray(solid.creep_compliance(T)), 1e-3))
    both = spectrum(creep, Response(T, np.asarray(solid.relaxation_modulus(T)), "relaxation"))
    assert isinstance(both.model, GeneralizedMaxwell)
    assert rms(both, solid) < 5e-3
    over = spectrum(creep, Response(W, moduli(solid), "modulus"))
    assert isinstance(over.model, GeneralizedKelvinVoigt)
    np.testing.assert_allclose(over.model.creep_compliance(T), solid.creep_compliance(T), rtol=5e-3)


def test_known_strengths_times_and_bounds():
    y = Response(T, noisy(np.asarray(SOLID.relaxation_modulus(T)), 1e-3), "relaxation")
    liquid = spectrum(y, terms=4, fixed={"E_inf": 0.0})
    assert float(liquid.model.E_inf) == 0.0
    assert "E_inf" not in liquid.answers[0].names
    given_times = spectrum(y, tau=[30.0, 0.1, 2.0], fixed={"E_inf": 0.5})
    np.testing.assert_allclose(given_times.model.tau, [0.1, 2.0, 30.0])
    np.testing.assert_allclose(given_times.model.E, SOLID.E, rtol=0.01)
    variance = np.diagonal(given_times.answers[0].covariance)
    assert (variance[1::2] > 0).all()  # E1, E2, E3
    assert (variance[2::2] == 0).all()
    inside = spectrum(y, terms=3, bounds=(0.5, 10.0))
    assert 0.499 < float(np.min(inside.model.tau)) <= float(np.max(inside.model.tau)) < 10.001
    creep = Response(T, np.asarray(GeneralizedKelvinVoigt(2.0, [1.0], [3.0]).creep_compliance(T)))
    assert float(spectrum(creep, fixed={"E0": 2.0}).model.E0) == 2.0
    for name, value in (("tau1", 1.0), ("E_inf", -1.0)):
        with pytest.raises(InputError, match=r"\[bad-option\]"):
            spectrum(y, fixed={name: value})


def test_storage_and_loss_that_contradict_each_other():
    y = moduli(SOLID)
    found = spectrum(Response(W, y.real + 1.6j * y.imag, "modulus"))
    assert any("contradict" in note for note in found.notes)


@pytest.mark.parametrize(
    ("responses", "code"),
    [
        ((), "too-few-rows"),
        ((Response(W[:3], moduli(SOLID)[:3], "modulus"),), "too-few-rows"),
        ((Response(-W, moduli(SOLID), "modulus"),), "not-finite"),
    ],
)
def test_what_is_refused(responses: Any, code: str):
    refuses(code, lambda: spectrum(*responses))


def wlf(temperature: float) -> float:
    return -12.0 * (temperature - 40.0) / (60.0 + temperature - 40.0)


def runs(kind: Any, off: float = 0.0) -> list[Response]:
    """Readings at TEMPERATURES, every two of which are all too large and the next two too small."""
    tau = 10.0 ** np.arange(-3.0, 8.0)
    truth = GeneralizedMaxwell(0.3, 3.0 * np.exp(-0.1 * (np.arange(11) - 5.0) ** 2) + 0.2, tau)
    x, parts = np.geomspace(0.1, 100.0, 13), []
    for k, one in enumerate(TEMPERATURES):
        a = 10.0 ** wlf(one)
        y = (
            moduli(truth, x * a)
            if kind == "modulus"
            else np.asarray(truth.relaxation_modulus(x / a))
        )
        parts.append(Response(x, noisy(y, 3e-3, k) * (1 + off * (-1) ** (k // 2)), kind))
    return parts


@pytest.mark.parametrize("kind", rest_thorough(["relaxation", "modulus"], 1))
def test_temperatures_are_shifted_onto_each_other(kind: Any):
    found, shifts = master_curve(runs(kind), TEMPERATURES, 40.0)
    apart = shifts.log_a - [wlf(one) for one in TEMPERATURES]
    assert (np.abs(apart) <= 4 * shifts.error + 1e-9).all()
    assert shifts.error.max() < 0.1
    assert shifts.law == "WLF"
    np.testing.assert_allclose(shifts.constants, (12.0, 60.0), rtol=0.2)
    assert abs(shifts.at(55.0) - wlf(55.0)) < 0.05
    assert shifts.at(60.3) == shifts.log_a[4]
    assert found.row.rms < 5e-3
    # Nothing is left over where superposition holds.
    assert np.mean(shifts.left) < 1.5 * np.mean(shifts.alone) + 1e-3


@pytest.mark.parametrize("kind", rest_thorough(["relaxation", "modulus"], 1))
def test_what_superposition_leaves_over_widens_the_errors(kind: Any):
    """By noise alone these factors would lie up to 8.8 standard errors off."""
    shifts = master_curve(runs(kind, 0.03), TEMPERATURES, 40.0).shifts
    apart = shifts.log_a - [wlf(one) for one in TEMPERATURES]
    assert (np.abs(apart) <= 4 * shifts.error + 1e-9).all()
    assert shifts.error.max() < 1.0


def test_arrhenius_and_what_superposition_leaves_over():
    x, parts = np.geomspace(0.1, 100.0, 13), []
    temperatures = [0.0, 10.0, 20.0, 30.0]
    for one in temperatures:
        a = np.exp(100.0 / 8.314462618e-3 * (1 / (one + 273.15) - 1 / 293.15))
        parts.append(Response(x, noisy(moduli(SOLID, x * a), 1e-3), "modulus"))
    shifts = master_curve(parts, temperatures, 20.0).shifts
    assert shifts.law == "Arrhenius"
    np.testing.assert_allclose(shifts.constants, (100.0,), rtol=0.1)
    turned = parts[1]._replace(y=np.asarray(parts[1].y) * (1 + 0.3 * np.linspace(-1, 1, 13)))
    odd = master_curve([parts[0], turned, *parts[2:]], temperatures, 20.0).shifts
    assert odd.left.max() > 3 * shifts.left.max()
    refuses("too-few-rows", lambda: master_curve(parts[:1], temperatures[:1]))
    with pytest.raises(InputError, match=r"\[too-few-rows\]"):  # a ramp of the temperature
        master_curve(
            [Response(x[:1], np.asarray(one.y)[:1], "modulus") for one in parts], temperatures
        )


def measured(folder: Path, name: str) -> np.ndarray:
    path = folder / "relaxation-master" / name
    return np.loadtxt(path, delimiter=",", skiprows=2, encoding="utf-8-sig")


def test_a_public_master_curve(measured_data: Path):
    """Non-negative least squares of 62 terms leaves 0.10 %, Ansys with 31 leaves 0.25 %."""
    t, y = measured(measured_data, "time_user_master.csv").T
    found = spectrum(Response(t, y, "relaxation"))
    assert found.dense
    assert found.row.rms < 0.0012
    assert found.order < 4 * np.log10(t[-1] / t[0])


def test_creep_that_flows_is_shifted_too():
    flowing = GeneralizedKelvinVoigt(2.0, [1.0, 4.0], [0.5, 80.0], 300.0)
    t, parts = np.geomspace(0.1, 100.0, 20), []
    for k, a in enumerate((20.0, 1.0, 0.05)):
        y = np.asarray(flowing.creep_compliance(t / a))
        parts.append(Response(t, noisy(y, 1e-3, k)))
    found, shifts = master_curve(parts, [10.0, 20.0, 30.0], 20.0)
    apart = np.abs(shifts.log_a - np.log10([20.0, 1.0, 0.05]))
    assert (apart <= 4 * shifts.error + 1e-9).all()
    assert shifts.error.max() < 0.05
    assert isinstance(found.model, GeneralizedKelvinVoigt)
    assert found.model.eta0 is not None
    np.testing.assert_allclose(float(found.model.eta0), 300.0, rtol=0.02)
