"""Bouc-Wen, worn and not: against stiff solvers and closed forms, and laws of a function of the path."""

from itertools import pairwise
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from hysteresis import BoucWen, DegradingBoucWen, InputError, Pinching
from hysteresis.laws._tree import node_of
from hysteresis.trees import plain
from tests.problems import SAMPLES, histories
from tests.refusals import refuses
from tests.thorough import rest_thorough

seeds = st.integers(0, 2**32 - 1)
simulate = eqx.filter_jit(lambda model, u: model.simulate(None, u))


def drawn(seed: int, least: float = -0.9) -> BoucWen:
    rng = np.random.default_rng(seed)
    n, ratio = rng.uniform(0.5, 10), rng.uniform(least, 1)
    return BoucWen(rng.uniform(0.5, 5), rng.random(), rng.uniform(0.1, 2), n, ratio, rng.normal())


def after(model: BoucWen, w: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Where the law's w comes to on these ways up, in parts of `yield_at`."""
    states: list[Any] = []
    law, found = node_of(plain(model.tree()), states, []), np.empty_like(w)
    for k in range(len(w)):
        states[0].u, states[0].w = 0.0, float(w[k])
        law.move(0.0, float(way[k] * model.yield_at))
        found[k] = states[0].w
    return found


def with_shape(n: float, ratio: float) -> BoucWen:
    return BoucWen(2.0, 0.2, 0.5, n, ratio, 0.1)


@pytest.mark.parametrize("ratio", rest_thorough([-0.5, 0.3, 0.0, 1.0], 1))
@pytest.mark.parametrize("n", rest_thorough([1.5, 1.0, 3.0], 1))
def test_against_a_stiff_solver(n: float, ratio: float):
    """The equation as it stands in the literature, along a path with minor loops."""
    k, alpha, beta, offset = 2.0, 0.2, 1.7, 0.1
    shape = {"alpha": alpha, "beta": beta, "gamma": ratio * beta, "n": n, "A": 1.3}
    model = BoucWen.of_coefficients(k=k, offset=offset, **shape)
    turns = np.array([0.0, 2.0, -1.5, 0.4, -0.6, 1.0, 0.9])
    z, u, wanted = 0.0, [], []
    for start, end in pairwise(turns):
        sign = np.sign(end - start)

        def slope(x: float, z: np.ndarray, sign: float = sign) -> np.ndarray:
            return 1.3 - beta * sign * abs(z) ** (n - 1) * z - ratio * beta * abs(z) ** n

        x = np.linspace(start, end, 12)
        strict = {"rtol": 1e-11, "atol": 1e-12, "max_step": 0.05}
        solved = solve_ivp(slope, (start, end), [z], "Radau", x, **strict)
        z = solved.y[0, -1]
        u.append(x)
        wanted.append(offset + alpha * k * x + (1 - alpha) * k * solved.y[0])
    got = np.asarray(model.simulate(None, np.concatenate(u)))
    # What the solver was asked for, with some error per step gathered.
    assert np.abs(got - np.concatenate(wanted)).max() <= 1e-8 * np.ptp(got)


@pytest.mark.parametrize("ratio", [-0.8, 0.0, 1.0])
def test_against_closed_forms(ratio: float):
    """n = 1 is an exponential to either side of 0, n = 2 a tangent and a hyperbolic tangent."""
    q, rng = (1 - ratio) / (1 + ratio), np.random.default_rng(0)
    w, way = rng.uniform(-1, 1, 200), 10.0 ** rng.uniform(-3, 1, 200)
    down = np.maximum(-w, 0)
    # Above 0, from w or from 0, with what is left of the way.
    to_zero = np.log1p(q * down) / q if q else down
    left = np.maximum(way - to_zero, 0)
    up = 1 - (1 - np.maximum(w, 0)) * np.exp(-left)
    below = -np.expm1(q * (to_zero - way)) / q if q else w + way
    one = np.where(way < to_zero, below, up)
    np.testing.assert_allclose(after(with_shape(1.0, ratio), w, way), one, rtol=0, atol=1e-13)
    root = np.sqrt(q)
    to_zero = np.arctan(root * down) / root if q else down
    left = np.tanh(np.maximum(way - to_zero, 0))
    up = (np.maximum(w, 0) + left) / (1 + np.maximum(w, 0) * left)
    below = -np.tan(root * np.maximum(to_zero - way, 0)) / root if q else w + way
    two = np.where(way < to_zero, below, up)
    np.testing.assert_allclose(after(with_shape(2.0, ratio), w, way), two, rtol=0, atol=1e-13)


@given(seed=seeds, u=histories(-3.0, 3.0))
def test_bounded_and_rising(seed: int, u: np.ndarray):
    model = drawn(seed)
    y = np.asarray(simulate(model, u))
    k, alpha = float(model.k), float(model.alpha)
    z = (y - float(model.offset) - alpha * k * u) / ((1 - alpha) * k)
    # z is a difference of numbers of the output's size, divided by a share of k.
    rounding = 1e-14 * (1 + np.abs(y).max()) / ((1 - alpha) * k)
    assert np.abs(z).max() <= float(model.yield_at) + rounding
    # The output goes where the input goes.
    du, dy = np.diff(u), np.diff(y)
    assert np.all(dy * np.sign(du) >= alpha * k * np.abs(du) - 1e-13 * (1 + np.abs(y).max()))
    assert np.all(np.abs(dy[du == 0]) <= 1e-14 * (1 + np.abs(y).max()))


def test_gradients_stay_finite_at_saturation_and_at_rest():
    """Where 1 - w rounds to 0, where the input turns, stands still or starts, and where z is 0."""
    u = jnp.array([0.0, 0.0, 40.0, 80.0, 80.0, -80.0, -79.9999, 3.0, 3.0, 0.0])
    gradient = eqx.filter_jit(jax.jacfwd(lambda point: point[0].simulate(None, point[1]).sum()))
    for n in (0.5, 1.0, 10.0):
        point = (with_shape(n, 0.5), u)
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient(point)))


@pytest.mark.parametrize(("arguments", "words"), [
    ({"k": 0.0}, "k = 0"), ({"alpha": 1.1}, "alpha"), ({"yield_at": np.nan}, "yield_at"),
    ({"n": 0.4}, "n = "), ({"gamma_over_beta": -1.0}, "gamma_over_beta"),
])  # fmt: skip
def test_bad_arguments_are_refused(arguments: dict[str, float], words: str):
    good = {"k": 1.0, "alpha": 0.5, "yield_at": 1.0}
    refuses("parameter-out-of-bounds", lambda: BoucWen(**(good | arguments)), words)


@pytest.mark.parametrize(("A", "beta", "gamma"), [(0.0, 1.0, 0.0), (1.0, 0.5, -0.5), (1, 0.5, 0.6)])
def test_inadmissible_coefficients_are_refused(A: float, beta: float, gamma: float):
    with pytest.raises(InputError, match="parameter-out-of-bounds"):
        BoucWen.of_coefficients(k=1.0, alpha=0.5, beta=beta, gamma=gamma, n=1.0, A=A)


@given(seed=seeds, u=histories(-3.0, 3.0))
def test_the_yielding_spring_gives_back_no_more_than_it_stores(seed: int, u: np.ndarray):
    """Integral of z dx >= change of z^2 / 2 on any path, so that no closed one gives energy.

    z is concave along its way, so its values in the middle of the steps give no less than the integral.
    """
    model = eqx.tree_at(lambda m: (m.k, m.alpha, m.offset), drawn(seed), (1.0, 0.0, 0.0))
    at = np.arange(SAMPLES)
    z = np.asarray(simulate(model, np.interp(np.arange(2 * SAMPLES - 1) / 2, at, u)))
    z, middle = z[::2], z[1::2]
    work = np.cumsum(np.diff(u) * middle)
    assert np.all(work >= (z[1:] ** 2 - z[0] ** 2) / 2 - 1e-13)


SLIP = Pinching(slip=0.8, onset=0.3, level=0.2, spread=0.3, severity=0.3, widening=0.01)
TURNS = (0.0, 4.0, -4.0, 8.0, -4.0, 0.0, -8.0, 8.0, 0.0)
OFF_BY = {1: 4e-5, 5: 5e-4, 20: 2e-3}
"""Of z in parts of yield_at, for samples as many fifths of yield_at apart: as documented."""


def drawn_worn(seed: int, loss: float = 1.0) -> DegradingBoucWen:
    """Losing strength at most at `loss` times the speed at which the output could fall."""
    rng = np.random.default_rng(seed)
    alpha, n = rng.random(), rng.uniform(0.5, 3)
    k, Z = rng.uniform(0.5, 5), rng.uniform(0.1, 2)
    inner = BoucWen(k, alpha, Z, n, rng.uniform(-0.5, 1), rng.normal())
    slip = Pinching(rng.uniform(0, 0.95), 10.0 ** rng.uniform(-2, 1), *rng.uniform(0.1, 0.9, 3))
    strength = loss * rng.uniform(0, min(n * alpha / (1 - alpha), 0.5))
    return DegradingBoucWen(inner, strength, rng.uniform(0, 0.5), slip)


def path(turns: tuple[float, ...], longest: float) -> np.ndarray:
    """Straight from turn to turn, in steps of at most `longest`."""
    ends = [(a, b, 1 + int(np.ceil(abs(b - a) / longest))) for a, b in pairwise(turns)]
    ways = [np.linspace(*each)[1:] for each in ends]
    return np.concatenate([[turns[0]], *ways])


@pytest.mark.parametrize(
    ("n", "ratio", "slip"),
    rest_thorough([(1.0, -0.5, SLIP), (1.5, 0.9, None), (3.0, 0.0, SLIP), (1.0, -0.5, None)], 1),
)
def test_wear_against_a_stiff_solver(n: float, ratio: float, slip: Pinching | None):
    """The equations as they stand in the literature, in z and its own energy."""
    Z, k, alpha, strength, stiffness = 0.7, 2.0, 0.1, 0.08, 0.1
    inner = BoucWen(k, alpha, Z, n, ratio, 0.1)
    model = DegradingBoucWen(inner, strength * Z**2, stiffness * Z**2, slip)
    beta = Z**-n / (1 + ratio)
    gamma = ratio * beta

    def h(z: float, energy: float, sign: float) -> float:
        if slip is None:
            return 1.0
        limit = (1 / ((1 + strength * energy) * (beta + gamma))) ** (1 / n)
        lost = float(slip.slip) * (1 - np.exp(-float(slip.onset) / Z**2 * energy))
        widening = 0.0 if slip.widening is None else float(slip.widening)
        spread = Z * (float(slip.spread) + widening / Z**2 * energy)
        width = spread * (float(slip.severity) + lost)
        return 1 - lost * np.exp(-(((z * sign - float(slip.level) * limit) / width) ** 2))

    u = Z * path(TURNS, 0.2)
    state, wanted = np.zeros(2), [0.0]
    for start, end in pairwise(Z * np.array(TURNS)):
        sign = np.sign(end - start)

        def slope(x: float, at: np.ndarray, sign: float = sign) -> list[float]:
            z, energy = at
            bent = beta * sign * abs(z) ** (n - 1) * z + gamma * abs(z) ** n
            worn = 1 + stiffness * energy
            return [h(z, energy, sign) / worn * (1 - (1 + strength * energy) * bent), z]

        x = np.linspace(start, end, 1 + round(abs(end - start) / (0.2 * Z)))
        solved = solve_ivp(slope, (start, end), state, "Radau", x, rtol=1e-9, atol=1e-11)
        state = solved.y[:, -1]
        wanted.extend(solved.y[0, 1:])
    for fifths, off_by in OFF_BY.items():
        at = u[::fifths]
        y = np.asarray(model.simulate(None, at))
        z = (y - 0.1 - alpha * k * at) / ((1 - alpha) * k)
        assert np.abs(z - np.array(wanted)[::fifths]).max() <= off_by * Z


def test_without_wear_it_is_the_exact_model():
    inner = BoucWen(2.0, 0.2, 0.5, 1.5, 0.3, 0.1)
    u = np.random.default_rng(0).uniform(-1, 1, SAMPLES)
    wanted = np.asarray(inner.simulate(None, u))
    for none in (None, 0.0):
        got = simulate(DegradingBoucWen(inner, none, none), u)
        assert np.abs(got - wanted).max() <= OFF_BY[20] * 1.6 * 0.5


@given(seed=seeds, u=histories(-3.0, 3.0))
@settings(max_examples=15)
def test_z_stays_within_its_limit_and_the_output_rises(seed: int, u: np.ndarray):
    model = drawn_worn(seed)
    k, alpha, Z = (float(getattr(model.inner, name)) for name in ("k", "alpha", "yield_at"))
    y = np.asarray(simulate(model, u))
    z = (y - float(model.inner.offset) - alpha * k * u) / ((1 - alpha) * k)
    assert np.abs(z).max() <= Z * (1 + 1e-13) + 1e-14 * np.abs(y).max() / ((1 - alpha) * k)
    du, dy = np.diff(u), np.diff(y)
    least = float(model.least_slope())
    # In the limit z falls as its limit does; the substeps follow that to their accuracy.
    assert np.all(dy * np.sign(du) >= least * np.abs(du) - OFF_BY[20] * k * Z)
