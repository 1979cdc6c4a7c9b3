"""The Burgers model against its closed forms, a stiff ODE solver, and thermodynamics."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hysteresis import Burgers, GeneralizedKelvinVoigt
from tests.problems import SAMPLES, clock, histories

modulus = st.floats(0.1, 10.0)
viscosity = st.floats(0.5, 100.0)
elements = st.tuples(modulus, viscosity, modulus, viscosity)
Element = tuple[float, float, float, float]
EPS = np.finfo(float).eps


@given(elements, st.integers(0, 99), st.booleans(), st.sampled_from(["linear", "constant"]))
def test_it_is_the_chain_of_one_branch(p: Element, seed: int, leading: bool, hold: str):
    """Whose creep, relaxation, spectrum and stability are tested against closed forms and a solver."""
    E1, eta1, E2, eta2 = p
    options: Any = {"leading": leading, "hold": hold}
    t, u = clock(seed), np.random.default_rng(seed).normal(size=SAMPLES)
    model = Burgers(*p, 0.3, **options)
    chain = GeneralizedKelvinVoigt(E1, [E2], [eta2], eta1, 0.3, **options)
    assert model.largest_stable_step() == chain.largest_stable_step()
    if t[-1] - t[0] < model.largest_stable_step() * SAMPLES or not leading:
        np.testing.assert_allclose(model.simulate(t, u), chain.simulate(t, u), rtol=1e-12)


@pytest.mark.parametrize("decade", [-8.0, -6.0, -5.1, -5.0, -4.0, -3.1, -3.0])
@given(p=elements)
@settings(max_examples=10)
def test_steps_too_small_to_divide_by_are_exact(decade: float, p: Element):
    """The series for small steps joins the formula: creep of a ramp at any step."""
    dt = 10.0**decade * p[3] / p[2]
    t = dt * np.arange(SAMPLES)
    model = Burgers(*p)
    E1, eta1, E2, eta2 = p
    tau = eta2 / E2
    x = t / tau
    # x - 1 + exp(-x) by its series; x is below 0.04, what is left out below 1e-16 of it.
    delayed = x**2 / 2 * (1 - x / 3 * (1 - x / 4 * (1 - x / 5 * (1 - x / 6 * (1 - x / 7)))))
    wanted = t / E1 + t**2 / (2 * eta1) + tau * delayed / E2
    y = np.asarray(model.simulate(t, t))
    # (phi - a) and (1 - phi) are differences of numbers near 1: eps of it, over x, per step.
    np.testing.assert_allclose(
        y, wanted, rtol=0, atol=SAMPLES * EPS * (t[-1] / E1 + t[-1] / E2) * 8
    )


@given(elements, histories(-1.0, 1.0), st.integers(0, 99))
def test_energy_is_never_made(p: Element, u: np.ndarray, seed: int):
    """Work done on the element, less what its springs hold, is what its dashpots have lost: >= 0.

    Along a straight step of force the work is exact: the trapezium misses what the creep curves
    within the step, so the step is divided until that is below the tolerance.
    """
    E1, _, E2, _ = p
    fine = 50
    t, F = clock(seed), np.append(u, 0.0)  # ends unloaded: the first spring is empty
    t = np.append(t, t[-1] + 1.0)
    grid = np.arange(len(t)), np.linspace(0, len(t) - 1, fine * (len(t) - 1) + 1)
    t, F = (np.interp(grid[1], grid[0], v) for v in (t, F))
    model = Burgers(*p)
    d = np.asarray(model.simulate(t, F))
    state, _ = model.stream(t, F)
    held = E2 * float(state.branches[1]) ** 2 / 2
    first = F[0] ** 2 / (2 * E1)
    work = np.sum((F[1:] + F[:-1]) / 2 * np.diff(d)) + first
    scale = np.sum(np.abs(np.diff(d))) * np.abs(F).max() + first
    # The trapezium's error falls with the square of the division: 1/12/50^2 = 3e-5 of each step.
    assert work - held >= -1e-4 * scale


def rounding(model: Burgers, t: np.ndarray, u: np.ndarray) -> float:
    """Each step rounds the creep displacements; the largest compliance bounds their size."""
    span = float(model.creep_compliance(t[-1] - t[0])) * np.abs(u).max()
    return 8 * len(t) * EPS * (span + 1e-300)


@given(elements)
def test_relaxation_modulus(p: Element):
    """The closed form G = [(q1 - q2 r1) exp(-r1 t) - (q1 - q2 r2) exp(-r2 t)] / A."""
    E1, eta1, E2, eta2 = p
    p1, p2 = eta1 / E1 + eta1 / E2 + eta2 / E2, eta1 * eta2 / (E1 * E2)
    q1, q2, A = eta1, eta1 * eta2 / E2, np.sqrt(p1**2 - 4 * p2)
    r1, r2 = (p1 - A) / (2 * p2), (p1 + A) / (2 * p2)
    t = np.linspace(0.0, 3 / r1, 41)
    G = ((q1 - q2 * r1) * np.exp(-r1 * t) - (q1 - q2 * r2) * np.exp(-r2 * t)) / A
    # r1 is a difference of numbers p1: eps * p1 / p2 of error, which t turns into one of the exponent.
    rounding = 16 * EPS * p[0] * (1 + r2 / r1)
    got = Burgers(*p).relaxation_modulus(t)
    np.testing.assert_allclose(got, G, rtol=0, atol=rounding)
