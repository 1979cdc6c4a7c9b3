"""Coupled oscillators: a chain of one, frequency responses, energy, convergence."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hysteresis import BoucWenForce, CoupledOscillators, GeneralizedPlays, InputError, parameters

SPRING = BoucWenForce(alpha=4e4, beta_gamma=700.0, beta_delta=-900.0)
PLAYS = GeneralizedPlays([0.0, 2e-4], [2e-3] * 2, np.linspace(1, -1, 8).reshape(2, 4) * 20)
MASS, DAMPING, STIFFNESS = [1.7, 0.9], [12.0, 8.0], [4.5e4, 3e4]
SKEW = [[1.0, 2.0], [0.0, 1.0]]
T = np.arange(300) / 750
FORCE = 40 * np.sin(2 * np.pi * (18 * T + 40 * T**2)) * np.minimum(1, 20 * T)


def chain(*links, **options) -> CoupledOscillators:
    return CoupledOscillators(MASS, DAMPING, STIFFNESS, links or (SPRING, PLAYS), **options)


def test_matrices_of_a_chain_are_the_chain():
    model = chain(substeps=3)
    M, C, K, L = model.system()
    matrices = CoupledOscillators(M, C, K, model.hysteresis, L, substeps=3)
    forces = np.zeros((60, 2))
    forces[:, 1] = FORCE[:60]
    both = matrices.displacements(T[:60], forces)
    alone = np.asarray(model.simulate(T[:60], FORCE[:60]))
    np.testing.assert_allclose(both[:, 1], alone, rtol=0, atol=1e-15)


def test_the_linear_limit_has_the_analytic_frequency_responses():
    """All four entries of the matrix, in steady state; the trapezoidal rule shifts them by (w h)^2 / 12."""
    model = CoupledOscillators(MASS, [60.0, 40.0], STIFFNESS, (None, None), substeps=8)
    n, line, rate = 128, 5, 750
    M, C, K, _ = (np.asarray(one) for one in model.system())
    w = 2 * np.pi * line * rate / n
    between = np.sinc(line / n) ** 2  # of the straight lines between the samples of the force
    wanted = between * np.linalg.inv(K - w**2 * M + 1j * w * C)
    t = np.arange(6 * n) / rate
    for driven in (0, 1):
        forces = np.zeros((len(t), 2))
        forces[:, driven] = 1e6 * np.cos(w * t)
        y = model.displacements(t, forces)[-n:] / 1e6
        got = 2 * np.fft.rfft(y, axis=0)[line] / n
        assert np.abs(got - wanted[:, driven]).max() <= 2e-3 * np.abs(wanted).max()


def test_energy_balance():
    """The work of the forces is what masses and springs hold and dampers and links took."""
    model = chain(substeps=1)
    t = np.arange(6000) / 15000
    u = np.interp(t, T, FORCE)
    forces = np.stack([0.3 * u, u], 1)
    y = model.displacements(t, forces)
    M, C, K, L = (np.asarray(one) for one in model.system())
    h = t[1]
    v = np.gradient(y, h, axis=0)
    d, rate = y @ L.T, v @ L.T
    z = np.stack(
        [np.asarray(link.simulate(None, d[:, k])) for k, link in enumerate((SPRING, PLAYS))], 1
    )
    work = np.cumsum(np.sum(forces * v, 1)) * h
    held = 0.5 * (np.einsum("ti,ij,tj->t", v, M, v) + np.einsum("ti,ij,tj->t", y, K, y))
    taken = np.cumsum(np.einsum("ti,ij,tj->t", v, C, v) + np.sum(z * rate, 1)) * h
    assert np.abs(work - held - taken)[5:-5].max() <= 5e-3 * np.abs(work).max()
    assert taken[-1] > 0.3 * np.abs(work).max()


@pytest.mark.parametrize(("integrator", "order"), [("newmark", 2), ("runge-kutta", 4)])
def test_order_of_convergence_against_an_independent_solver(integrator: str, order: int):
    """Before any link turns."""
    M, C, K, L = (np.asarray(one) for one in chain().system())
    alpha, loss = np.array([4e4, 2e4]), np.array([-200.0, -100.0])
    links = (BoucWenForce(4e4, 700.0, -900.0), BoucWenForce(2e4, 300.0, -400.0))

    def rate(_: float, x: np.ndarray) -> np.ndarray:
        y, v, z = x[:2], x[2:4], x[4:]
        w = L @ v
        a = np.linalg.solve(M, np.array([30.0, 30.0]) - C @ v - K @ y - L.T @ z)
        return np.concatenate([v, a, w * (alpha - loss * np.abs(z))])

    end = 0.008
    found = solve_ivp(rate, (0, end), np.zeros(6), "DOP853", rtol=1e-12, atol=1e-16)
    assert (L @ found.y[2:4][:, 1:] > 0).all()
    forces = np.full((2, 2), 30.0)
    errors = []
    for substeps in (8, 16):
        model = chain(*links, substeps=substeps, integrator=integrator)
        got = model.displacements(np.array([0.0, end]), forces)
        errors.append(np.abs(got[-1] - found.y[:2, -1]).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.4)


def test_units_are_those_of_forces_and_displacements():
    model = chain()
    words = model.unit_words("N", "m", "s")
    units = {name: info.in_units(words) for name, info, _ in parameters(model)}
    assert units["mass"] == "kg"
    assert units["damping"] == "N * s / m"
    assert units["hysteresis.0.alpha"] == "N / m"
    assert units["hysteresis.0.beta_gamma"] == "1 / m"


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda: CoupledOscillators([0.0], [1.0], [1.0], (None,)), "parameter-out-of-bounds"),
        (lambda: CoupledOscillators(-np.eye(1), [1.0], [1.0], (None,)), "parameter-out-of-bounds"),
        (lambda: CoupledOscillators([1.0], [1.0, 1.0], [1.0, 1.0], (None,)), "length-mismatch"),
        (lambda: CoupledOscillators([1.0], [1.0], [1.0], (None,), [[1.0, 0.0]]), "length-mismatch"),
        (lambda: CoupledOscillators([1.0] * 2, [1.0] * 2, SKEW, (None,) * 2), "parameter-out-of-bounds"),
        (lambda: CoupledOscillators([1.0], [1.0], [1.0], ()), "bad-parts"),
        (lambda: chain(driven=2), "bad-option"),
        (lambda: chain(integrator="euler"), "bad-option"),
        (lambda: chain(substeps=0), "bad-option"),
        (lambda: chain().simulate(None, FORCE), "no-time"),
        (lambda: chain().displacements(T, FORCE), "length-mismatch"),
    ],
)  # fmt: skip
def test_bad_arguments_are_refused(make, code: str):
    with pytest.raises(InputError) as caught:
        make()
    assert caught.value.code == code
