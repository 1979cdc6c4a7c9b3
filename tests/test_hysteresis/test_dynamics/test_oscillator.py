"""An oscillator: order of convergence, energy, the linear limit, and its recorder."""

import json
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hysteresis
from hysteresis import BoucWenForce, DuhemForce, GeneralizedPlays, InputError, Oscillator, Sum
from tests.refusals import refuses

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
            again = hysteresis.load_model(file).displacement(T, FORCE)
            assert again == pytest.approx(model.displacement(T, FORCE))
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


@pytest.mark.parametrize(("make", "code"), [
    (lambda: Oscillator(0.0, 1.0, 1.0, MIXED), "parameter-out-of-bounds"),
    (lambda: plant(BoucWenForce(alpha=4e4, n=1.5)), "bad-parts"),
    (lambda: plant(hysteresis.BoucWen(4e4, 0.3, 3e-4)), "bad-parts"),
    (lambda: plant(substeps=0), "bad-option"),
    (lambda: DuhemForce([1.0, 1.0], [1.0, 1.0]), "length-mismatch"),
    (lambda: GeneralizedPlays([0.1], [1.0], [[1.0]]), "length-mismatch"),
    (lambda: GeneralizedPlays([-0.1], [1.0], [[1.0, 2.0]]), "parameter-out-of-bounds"),
    (lambda: BoucWenForce(alpha=-1.0), "parameter-out-of-bounds"),
    (lambda: hysteresis.decimated(np.zeros(8), (2,)), "too-few-rows"),
])  # fmt: skip
def test_bad_arguments_are_refused(make, code: str):
    refuses(code, lambda: make())


def test_the_linear_limit_has_the_analytic_frequency_response():
    """Without hysteresis, in steady state; the trapezoidal rule shifts frequencies by (w h)^2 / 12."""
    n, f0 = 1024, 8
    model = Oscillator(2.0, 60.0, 5e4, BoucWenForce(alpha=1e-9))
    u = np.cos(2 * np.pi * f0 * np.arange(n) / n) * 10
    fine = np.tile(hysteresis.interpolated(u, 40, periodic=True), 4)
    model = replace(model, substeps=1)
    y = model.displacement(np.arange(len(fine)) / (750 * 40), fine)[-40 * n :]
    w = 2 * np.pi * f0 * 750 / n
    wanted = 10 / (5e4 - 2.0 * w**2 + 60j * w)
    got = 2 * np.fft.rfft(y[::40])[f0] / n
    assert abs(got - wanted) <= 1e-5 * abs(wanted)


PLAYS = GeneralizedPlays([0.0, 2e-4, 6e-4], [2e-3] * 3, np.linspace(1, -1, 12).reshape(3, 4) * 20)


def test_energy_balance():
    """The work of the force is what mass and spring hold and damper and hysteresis took."""
    model = plant(Sum(MIXED, PLAYS), substeps=1)
    h, fine = 1 / 30000, hysteresis.interpolated(FORCE, 40)
    y = model.displacement(h * np.arange(len(fine)), fine)
    v = np.gradient(y, h)
    z = fine - 1.7 * np.gradient(v, h) - 12 * v - 4.5e4 * y
    thin = slice(0, None, 40)
    own = np.sum([part.simulate(None, y[:4000]) for part in (MIXED, PLAYS)], 0)
    np.testing.assert_allclose(own[20:-20], z[20:3980], rtol=0, atol=2e-3 * np.abs(z).max())
    work = np.cumsum(fine * v) * h
    held = 0.85 * v**2 + 2.25e4 * y**2
    taken = np.cumsum(12 * v**2 + z * v) * h
    left = (work - held - taken)[thin][2:-2]
    assert np.abs(left).max() <= 2e-3 * np.abs(work).max()
