"""Masses with hysteretic links, as a `Feedback`: an independent solver, the linear limit, matrices."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hysteresis import BoucWenForce, Feedback, GeneralizedPlays
from tests.refusals import refuses

LINKS = BoucWenForce(4e4, 700.0, -900.0), BoucWenForce(2e4, 300.0, -400.0)
PLAYS = GeneralizedPlays([0.0, 2e-4], [2e-3] * 2, np.linspace(1, -1, 8).reshape(2, 4) * 20)
MASS, DAMPING, STIFFNESS = [1.7, 0.9], [12.0, 8.0], [4.5e4, 3e4]
L = np.array([[1.0, 0.0], [-1.0, 1.0]])
M, C, K = np.diag(MASS), L.T @ np.diag(DAMPING) @ L, L.T @ np.diag(STIFFNESS) @ L
SKEW = [[1.0, 2.0], [0.0, 1.0]]
RATE = 750
T = np.arange(150) / RATE
FORCE = np.stack([0 * T, 40 * np.exp(-(((T - 0.1) / 0.03) ** 2)) * np.sin(220 * T)], 1)


def test_an_independent_solver_finds_the_same_motion():
    """Both links turn; a force that ends in nothing is the same to both."""
    alpha, gamma, delta = (np.array([float(getattr(x, n)) for x in LINKS])
                           for n in ("alpha", "beta_gamma", "beta_delta"))  # fmt: skip

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        y, v, z = x[:2], x[2:4], x[4:]
        w = L @ v
        push = np.array([0.0, 40 * np.exp(-(((t - 0.1) / 0.03) ** 2)) * np.sin(220 * t)])
        a = np.linalg.solve(M, push - C @ v - K @ y - L.T @ z)
        return np.concatenate([v, a, w * (alpha - (np.sign(w * z) * gamma + delta) * np.abs(z))])

    found = solve_ivp(rate, (0, T[-1]), np.zeros(6), "DOP853", T, rtol=1e-10, atol=1e-14).y
    assert (np.diff(np.sign(L @ found[2:4])) != 0).sum() > 10
    wanted = found[:2].T
    model = Feedback.of_masses(MASS, DAMPING, STIFFNESS, LINKS)
    errors = [np.abs(model.simulate(FORCE, 1 / RATE, k) - wanted).max() for k in (8, 16)]
    size = np.abs(wanted).max()
    # Straight lines between fine steps: of second order in their length.
    assert errors[1] < 3e-4 * size
    assert errors[0] / errors[1] > 2.5


def test_matrices_of_a_chain_are_the_chain():
    chain = Feedback.of_masses(MASS, DAMPING, STIFFNESS, (LINKS[0], PLAYS))
    matrices = Feedback.of_masses(M, C, K, (LINKS[0], PLAYS), L)
    both = [model.simulate(FORCE[:60], 1 / RATE) for model in (chain, matrices)]
    np.testing.assert_allclose(*both, rtol=0, atol=1e-12)


@pytest.mark.parametrize("damping", [[60.0, 40.0], [2000.0, 40.0]], ids=["modes", "a real pole"])
def test_the_linear_limit_has_the_analytic_frequency_responses(damping: list[float]):
    model = Feedback.of_masses(MASS, damping, STIFFNESS)
    s = 2j * np.pi * np.array([0.5, 10.0, 25.0, 40.0, 90.0])
    own = L.T @ np.diag(damping) @ L
    wanted = np.array([np.linalg.inv(x**2 * M + x * own + K) for x in s])
    np.testing.assert_allclose(model.response(s), wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


def test_a_link_without_hysteresis_has_no_channel():
    model = Feedback.of_masses(MASS, DAMPING, STIFFNESS, (None, PLAYS))
    assert (model.inputs, model.outputs, len(model.channels)) == (2, 2, 1)


@pytest.mark.parametrize(("arguments", "code"), [
    (([0.0], [1.0], [1.0]), "parameter-out-of-bounds"),
    ((-np.eye(1), [1.0], [1.0]), "parameter-out-of-bounds"),
    (([1.0], [0.0], [1.0]), "parameter-out-of-bounds"),
    (([1.0], [1.0, 1.0], [1.0, 1.0]), "length-mismatch"),
    (([1.0], [1.0], [1.0], (None,), [[1.0, 0.0]]), "length-mismatch"),
    (([1.0] * 2, [1.0] * 2, SKEW), "parameter-out-of-bounds"),
    (([1.0], [1.0], [1.0], (None, None)), "length-mismatch"),
])  # fmt: skip
def test_bad_arguments_are_refused(arguments: tuple, code: str):
    refuses(code, lambda: Feedback.of_masses(*arguments))
