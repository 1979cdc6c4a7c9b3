"""An oscillator: order of convergence, energy, the linear limit, and its recorder."""

import json
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hysteresis
from hysteresis import BoucWenForce, DuhemForce, GeneralizedPlays, InputError, Oscillator

MIXED = BoucWenForce(alpha=4e4, beta_gamma=700.0, beta_delta=-900.0)
T = np.arange(300) / 750
FORCE = 40 * np.sin(2 * np.pi * (18 * T + 40 * T**2)) * np.minimum(1, 20 * T)


def plant(hysteresis: hysteresis.AbstractModel = MIXED, **options) -> Oscillator:
    return Oscillator(1.7, 12.0, 4.5e4, hysteresis, **options)


def test_a_motion_begins_as_it_is_said():
    """In one sixteenth of a period of the undamped oscillation."""
    model, w = plant(BoucWenForce(alpha=1e-9), substeps=40), np.sqrt(4.5e4 / 1.7)
    t = np.array([0.0, np.pi / (8 * w)])
    free = replace(model, damping=jnp.asarray(1e-12))
    _, y = free.stream(t, [0.0, 0.0], model.moving(1e-3, 0.2))
    np.testing.assert_allclose(y, 1e-3 * np.cos(w * t) + 0.2 / w * np.sin(w * t), rtol=1e-3)


def test_order_of_convergence_against_an_independent_solver():
    """Between turning points of the velocity, where the equation is smooth."""
    t = np.linspace(0, 0.02, 9)
    u = 30 * np.ones_like(t)
    m, c, k, alpha, loss = 1.7, 12.0, 4.5e4, 4e4, -200.0

    def rate(_: float, x: np.ndarray) -> list[float]:
        y, v, z = x
        return [v, (30 - c * v - k * y - z) / m, v * (alpha - loss * abs(z))]

    end = 0.012  # the velocity is positive up to here
    found = solve_ivp(rate, (0, end), [0, 0, 0], "DOP853", rtol=1e-12, atol=1e-16)
    assert (found.y[1][1:] > 0).all()
    clock = np.array([0.0, end])
    errors = []
    for substeps in (10, 20):
        model = plant(substeps=substeps)
        got = eqx.filter_jit(lambda m: m.stream(clock, u[:2])[1])(model)
        errors.append(abs(float(got[-1]) - found.y[0, -1]))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.35)


def test_a_model_of_a_version_with_integrators_loads(tmp_path):
    model, file = plant(), tmp_path / "plant.json"
    hysteresis.save_model(model, file)
    known = file.read_text()
    for integrator, loads in (("newmark", True), ("runge-kutta", False)):
        field = f'"substeps": 20, "between": "linear", "integrator": "{integrator}"'
        file.write_text(json.dumps(json.loads(known.replace('"substeps": 20', field))))
        if loads:
            assert hysteresis.load_model(file).displacement(T, FORCE) == pytest.approx(
                model.displacement(T, FORCE)
            )
        else:
            with pytest.raises(InputError):
                hysteresis.load_model(file)


def test_interpolation_is_exact_for_what_is_limited_in_band():
    t, fine = np.arange(400), np.arange(399 * 8 + 1) / 8
    wave = lambda x: np.sin(0.4 * np.pi * x + 0.3) + 0.5 * np.cos(0.21 * np.pi * x)  # noqa: E731
    found = hysteresis.interpolated(wave(t), 8)
    assert np.abs(found - wave(fine)).max() < 2e-5
    assert np.abs(found - wave(fine))[400:-400].max() < 1e-6
    n = 60
    period = np.sin(2 * np.pi * 7 * np.arange(n) / n)
    wide = hysteresis.interpolated(period, 4, periodic=True)
    np.testing.assert_allclose(wide, np.sin(2 * np.pi * 7 * np.arange(4 * n) / (4 * n)), atol=1e-12)


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda: Oscillator(0.0, 1.0, 1.0, MIXED), "parameter-out-of-bounds"),
        (lambda: plant(BoucWenForce(alpha=4e4, n=1.5)), "bad-parts"),
        (lambda: plant(hysteresis.BoucWen(4e4, 0.3, 3e-4)), "bad-parts"),
        (lambda: plant(substeps=0), "bad-option"),
        (lambda: plant().simulate(None, FORCE), "no-time"),
        (lambda: DuhemForce([1.0, 1.0], [1.0, 1.0]), "length-mismatch"),
        (lambda: GeneralizedPlays([0.1], [1.0], [[1.0]]), "length-mismatch"),
        (lambda: GeneralizedPlays([-0.1], [1.0], [[1.0, 2.0]]), "parameter-out-of-bounds"),
        (lambda: BoucWenForce(alpha=-1.0), "parameter-out-of-bounds"),
        (lambda: hysteresis.decimated(np.zeros(8), (2,)), "too-few-rows"),
    ],
)
def test_bad_arguments_are_refused(make, code: str):
    with pytest.raises(InputError) as caught:
        make()
    assert caught.value.code == code
