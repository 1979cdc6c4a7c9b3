"""Bouc-Wen with wear: what its substeps leave against a stiff solver, and laws of a worn spring."""

from itertools import pairwise

import equinox as eqx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from hysteresis import BoucWen, DegradingBoucWen, Pinching
from tests.problems import SAMPLES, histories
from tests.thorough import rest_thorough

seeds = st.integers(0, 2**32 - 1)
simulate = eqx.filter_jit(lambda model, u: model.simulate(None, u))
SLIP = Pinching(slip=0.8, onset=0.3, level=0.2, spread=0.3, severity=0.3, widening=0.01)
TURNS = (0.0, 4.0, -4.0, 8.0, -4.0, 0.0, -8.0, 8.0, 0.0)
OFF_BY = {1: 4e-5, 5: 5e-4, 20: 2e-3}
"""Of z in parts of yield_at, for samples as many fifths of yield_at apart: as documented."""


def drawn(seed: int, loss: float = 1.0) -> DegradingBoucWen:
    """Losing strength at most at `loss` times the speed at which the output could fall."""
    rng = np.random.default_rng(seed)
    alpha, n = rng.random(), rng.uniform(0.5, 3)
    inner = BoucWen(
        rng.uniform(0.5, 5), alpha, rng.uniform(0.1, 2), n, rng.uniform(-0.5, 1), rng.normal()
    )
    slip = Pinching(rng.uniform(0, 0.95), 10.0 ** rng.uniform(-2, 1), *rng.uniform(0.1, 0.9, 3))
    return DegradingBoucWen(
        inner, loss * rng.uniform(0, min(n * alpha / (1 - alpha), 0.5)), rng.uniform(0, 0.5), slip
    )


def path(turns: tuple[float, ...], longest: float) -> np.ndarray:
    """Straight from turn to turn, in steps of at most `longest`."""
    ways = [
        np.linspace(a, b, 1 + int(np.ceil(abs(b - a) / longest)))[1:] for a, b in pairwise(turns)
    ]
    return np.concatenate([[turns[0]], *ways])


@pytest.mark.parametrize(
    ("n", "ratio", "slip"),
    rest_thorough([(1.0, -0.5, SLIP), (1.5, 0.9, None), (3.0, 0.0, SLIP), (1.0, -0.5, None)], 1),
)
def test_against_a_stiff_solver(n: float, ratio: float, slip: Pinching | None):
    """The equations as they stand in the literature, in z and its own energy."""
    Z, k, alpha, strength, stiffness = 0.7, 2.0, 0.1, 0.08, 0.1
    model = DegradingBoucWen(
        BoucWen(k, alpha, Z, n, ratio, 0.1), strength * Z**2, stiffness * Z**2, slip
    )
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
    model = drawn(seed)
    k, alpha, Z = (float(getattr(model.inner, name)) for name in ("k", "alpha", "yield_at"))
    y = np.asarray(simulate(model, u))
    z = (y - float(model.inner.offset) - alpha * k * u) / ((1 - alpha) * k)
    assert np.abs(z).max() <= Z * (1 + 1e-13) + 1e-14 * np.abs(y).max() / ((1 - alpha) * k)
    du, dy = np.diff(u), np.diff(y)
    least = float(model.least_slope())
    # In the limit z falls as its limit does; the substeps follow that to their accuracy.
    assert np.all(dy * np.sign(du) >= least * np.abs(du) - OFF_BY[20] * k * Z)
