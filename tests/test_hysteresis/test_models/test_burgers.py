"""The Burgers model against its closed forms, a stiff ODE solver, and thermodynamics."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hysteresis import Burgers, GeneralizedKelvinVoigt
from tests.problems import SAMPLES, clock

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
