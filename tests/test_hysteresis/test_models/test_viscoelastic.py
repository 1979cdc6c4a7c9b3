"""Chains of springs and dashpots: Burgers and the general ones, against integrals and closed forms."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from compensate import invert
from hysteresis import Burgers, GeneralizedKelvinVoigt, GeneralizedMaxwell, StandardLinearSolid
from tests.problems import SAMPLES, clock, histories
from tests.refusals import refuses
from tests.thorough import rest_thorough

EPS = np.finfo(float).eps
BRANCHES = 3
seeds = st.integers(0, 2**32 - 1)
simulate = eqx.filter_jit(lambda model, t, u: model.simulate(t, u))


def numbers(seed: int) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Stiffnesses and time constants of the branches over four decades, a spring, a dashpot."""
    rng = np.random.default_rng(seed)
    E, tau = 10 ** rng.uniform(-1, 1, BRANCHES), 10 ** rng.uniform(-2, 2, BRANCHES)
    return E, tau, *map(float, 10 ** rng.uniform(-1, 1, 2))


def kelvin_voigt(seed: int, **options: Any) -> GeneralizedKelvinVoigt:
    E, tau, E0, eta0 = numbers(seed)
    return GeneralizedKelvinVoigt(E0, E, E * tau, eta0, **options)


def maxwell(seed: int, **options: Any) -> GeneralizedMaxwell:
    E, tau, E_inf, _ = numbers(seed)
    return GeneralizedMaxwell(E_inf, E, tau, **options)


@given(seeds)
def test_creep_compliance_and_its_integral(seed: int):
    E, tau, E0, eta0 = numbers(seed)
    model, t = kelvin_voigt(seed), np.append(0.0, np.geomspace(1e-4, 1e3, 30))
    x = t[:, None] / tau
    J = 1 / E0 + t / eta0 - (np.expm1(-x) / E).sum(1)
    np.testing.assert_allclose(model.creep_compliance(t), J, rtol=1e-14)
    # x + expm1(-x) loses eps * x of x^2 / 2; the spring's term t / E0 is far larger.
    integral = t / E0 + t**2 / (2 * eta0) + ((x + np.expm1(-x)) * tau / E).sum(1)
    np.testing.assert_allclose(model.ramp(t), integral, rtol=1e-12)


@given(seeds)
def test_relaxation_modulus_and_its_integral(seed: int):
    E, tau, E_inf, _ = numbers(seed)
    model, t = maxwell(seed), np.append(0.0, np.geomspace(1e-4, 1e3, 30))
    x = t[:, None] / tau
    G = E_inf + (E * np.exp(-x)).sum(1)
    # The model sums falls from G(0): eps of that.
    np.testing.assert_allclose(model.relaxation_modulus(t), G, rtol=0, atol=8 * EPS * G[0])
    integral = E_inf * t - (E * tau * np.expm1(-x)).sum(1)
    np.testing.assert_allclose(model.ramp(t), integral, rtol=0, atol=8 * EPS * G[0] * t.max())


@given(seeds)
def test_complex_modulus(seed: int):
    E, tau, E0, eta0 = numbers(seed)
    omega = np.geomspace(1e-3, 1e3, 13)
    s = 1j * omega[:, None]
    in_series = 1 / (1 / E0 + 1 / (s[:, 0] * eta0) + (1 / (E * (1 + s * tau))).sum(1))
    np.testing.assert_allclose(kelvin_voigt(seed).complex_modulus(omega), in_series, rtol=1e-13)
    beside = E0 + (E * s * tau / (1 + s * tau)).sum(1)
    np.testing.assert_allclose(maxwell(seed).complex_modulus(omega), beside, rtol=1e-12)


def stiff(model: Any, t: np.ndarray, load: np.ndarray) -> np.ndarray:
    """The slow oracle: Radau from knot to knot of a piecewise-linear load, from the elements' laws."""
    if isinstance(model, GeneralizedKelvinVoigt):
        E, eta, eta0 = (np.asarray(v) for v in (model.E, model.eta, model.eta0))
        rates = lambda u, x: np.append(u / eta0, (u - E * x[1:]) / eta)  # noqa: E731
        answer = lambda u, x: u / float(model.E0) + x.sum()  # noqa: E731
    else:
        assert isinstance(model, GeneralizedMaxwell)
        E, tau = np.asarray(model.E), np.asarray(model.tau)
        # x: the strains of the dashpots.
        rates = lambda u, x: (u - x) / tau  # noqa: E731
        answer = lambda u, x: float(model.E_inf) * u + E @ (u - x)  # noqa: E731
    x = np.zeros(BRANCHES + isinstance(model, GeneralizedKelvinVoigt))
    found = [answer(load[0], 0 * E)]
    for a, b, ua, ub in zip(t[:-1], t[1:], load[:-1], load[1:], strict=True):
        law = lambda s, x, a=a, b=b, ua=ua, ub=ub: rates(ua + (ub - ua) * (s - a) / (b - a), x)  # noqa: E731
        x = solve_ivp(law, (a, b), x, method="Radau", rtol=1e-9, atol=1e-12).y[:, -1]
        found.append(answer(ub, x))
    return np.array(found)


@pytest.mark.parametrize("make", [kelvin_voigt, maxwell])
@pytest.mark.parametrize("seed", rest_thorough([0, 1], 1))
def test_against_a_stiff_solver_both_ways(make: Any, seed: int):
    rng = np.random.default_rng(seed)
    t, load = np.cumsum(10 ** rng.uniform(-3, 1, 12)), rng.normal(size=12)
    model = make(seed)
    wanted = stiff(model, t, load)
    scale = np.abs(wanted).max()
    np.testing.assert_allclose(simulate(model, t, load), wanted, rtol=0, atol=1e-7 * scale)
    other = make(seed, leading=not model.leading)
    # Exactly the inverse: the load comes back to the solver's tolerance, times the condition.
    np.testing.assert_allclose(simulate(other, t, wanted), load, rtol=0, atol=1e-5)


@pytest.mark.parametrize("make", [kelvin_voigt, maxwell])
@pytest.mark.parametrize("hold", ["linear", "constant"])
@given(seed=seeds)
@settings(max_examples=10)
def test_a_step_is_exact_on_any_clock(make: Any, hold: str, seed: int):
    model, t = make(seed, hold=hold), clock(seed)
    answer = model.creep_compliance if model.creeps else model.relaxation_modulus
    wanted = np.asarray(answer(t - t[0]))
    got = simulate(model, t, np.ones_like(t))
    np.testing.assert_allclose(got, wanted, rtol=0, atol=16 * len(t) * EPS * np.abs(wanted).max())


@pytest.mark.thorough
@pytest.mark.parametrize("hold", ["linear", "constant"])
def test_an_even_clock_is_one_number(hold: str):
    """The same outputs and derivatives as step by step, in two sequences; second derivatives too."""
    t, u = np.linspace(3.0, 7.0, 25), jnp.asarray(np.random.default_rng(0).normal(size=25))
    model = kelvin_voigt(3, hold=hold)
    even = model.prepare(t, u, starts=(0, 11))
    steps = np.full(25, t[1] - t[0])
    steps[[0, 11]] = 0.0
    assert even.dt.shape == ()
    assert model.prepare(np.append(t[:-1], 7.1), u).dt.shape == (25,)

    def squares(E: jax.Array, u: jax.Array, dt: jax.Array) -> jax.Array:
        one = eqx.tree_at(lambda m: m.E, model, E)
        moved = even._replace(dt=dt, u=u, u_before=even.u_before * u)
        return jnp.sum(one.evaluate(moved) ** 2)

    for derivative in (jax.value_and_grad(squares, (0, 1)), jax.hessian(squares)):
        ours, plain = (
            jax.tree.leaves(jax.jit(derivative)(model.E, u, jnp.asarray(dt)))
            for dt in (even.dt, steps)
        )
        for x, y in zip(ours, plain, strict=True):
            np.testing.assert_allclose(x, y, rtol=0, atol=1e-12 * float(jnp.abs(y).max()))


def spectral_radius(model: Any, dt: float) -> float:
    """Of the step of (load, branches), run against the chain with no input."""
    states = jnp.eye(model.chain().all_rates.size + 1)
    rest = model.init(0.0)

    def move(state: jax.Array) -> jax.Array:
        after, _ = model.step(rest._replace(load=state[0], branches=state[1:]), dt, 0.0)
        return jnp.append(after.load, after.branches)

    return float(np.abs(np.linalg.eigvals(np.asarray(jax.vmap(move)(states)))).max())


@pytest.mark.parametrize("seed", rest_thorough(range(6), 2))
def test_largest_stable_step(seed: int):
    E, tau, *_ = numbers(seed)
    held = {"leading": True, "hold": "constant"}
    stiff = GeneralizedKelvinVoigt(3 * E.sum(), E, E * tau, **held)
    for model in (kelvin_voigt(seed, **held), stiff):
        limit = model.largest_stable_step()
        assert spectral_radius(model, (1 - 1e-6) * limit) <= 1 + 1e-11
        assert spectral_radius(model, (1 + 1e-6) * limit) > 1
    # Delayed parts stiffer in sum than the spring can never throw it over; relaxation never does.
    stiffest = GeneralizedKelvinVoigt(0.9 / (1 / E).sum(), E, E * tau, **held)
    relaxing = maxwell(seed, leading=False, hold="constant"), maxwell(seed, leading=False)
    for model in (stiffest, *relaxing, kelvin_voigt(seed, leading=True)):
        assert model.largest_stable_step() == np.inf
        assert max(spectral_radius(model, dt) for dt in (1e-3, 0.1, 10.0, 1e3)) <= 1 + 1e-11


@pytest.mark.parametrize(("make", "code"), [
    (lambda: StandardLinearSolid(1.0, 0.0, 1.0), "parameter-out-of-bounds"),
    (lambda: GeneralizedKelvinVoigt(1.0, [1.0, -1.0], [1.0, 1.0]), "parameter-out-of-bounds"),
    (lambda: GeneralizedKelvinVoigt(1.0, [1.0], [1.0], 0.0), "parameter-out-of-bounds"),
    (lambda: GeneralizedKelvinVoigt(np.inf, [1.0], [1.0], leading=True), "not-invertible"),
    (lambda: GeneralizedMaxwell(-1.0, [1.0], [1.0]), "parameter-out-of-bounds"),
    (lambda: GeneralizedMaxwell(1.0, [1.0], [np.nan]), "parameter-out-of-bounds"),
    (lambda: StandardLinearSolid(1, 1, 1).simulate([0], [1, 2]), "length-mismatch"),
    (lambda: invert(StandardLinearSolid(1, 1, 1)).simulate([0], [1, 2]), "length-mismatch"),
])  # fmt: skip
def test_what_is_refused(make: Any, code: str):
    refuses(code, lambda: make())


modulus = st.floats(0.1, 10.0)
viscosity = st.floats(0.5, 100.0)
elements = st.tuples(modulus, viscosity, modulus, viscosity)
Element = tuple[float, float, float, float]


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
    t, model = dt * np.arange(SAMPLES), Burgers(*p)
    E1, eta1, E2, eta2 = p
    tau = eta2 / E2
    x = t / tau
    # x - 1 + exp(-x) by its series; x is below 0.04, what is left out below 1e-16 of it.
    delayed = x**2 / 2 * (1 - x / 3 * (1 - x / 4 * (1 - x / 5 * (1 - x / 6 * (1 - x / 7)))))
    wanted = t / E1 + t**2 / (2 * eta1) + tau * delayed / E2
    y = np.asarray(model.simulate(t, t))
    # (phi - a) and (1 - phi) are differences of numbers near 1: eps of it, over x, per step.
    tolerance = SAMPLES * EPS * (t[-1] / E1 + t[-1] / E2) * 8
    np.testing.assert_allclose(y, wanted, rtol=0, atol=tolerance)


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
