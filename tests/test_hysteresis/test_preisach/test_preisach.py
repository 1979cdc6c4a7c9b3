"""The Preisach model against relays, an analytic density, and its laws; its dead band against a loop."""

from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hysteresis import Preisach
from hysteresis.preisach import GridDensity, input_noise
from tests.problems import CELLS, HIGH, LOW, SAMPLES, histories, play, weights
from tests.refusals import raises, refuses
from tests.thorough import rest_thorough

seeds = st.integers(0, 2**32 - 1)
EPS = np.finfo(float).eps


@eqx.filter_jit
def simulate(model: Preisach, u: jax.Array, t: Any = None, state: Any = None) -> jax.Array:
    return model.simulate(t, u, state)


def output(model: Preisach, u: np.ndarray) -> np.ndarray:
    return np.asarray(simulate(model, jnp.asarray(u)))


def rounding(model: Preisach) -> float:
    """Sums over samples and cells of parts of the total mass, each rounded."""
    assert isinstance(model.density, GridDensity)
    parts = np.abs(np.asarray(model.density.weights)).sum()
    if model.reversible is not None:
        parts += float(model.reversible.sum())
    return 4 * (SAMPLES + model.density.cells) * EPS * (parts + abs(float(model.offset)))


def uniform(cells: int) -> GridDensity:
    """mu = 1 on [0, 1]: a mass of 1/n^2 in every cell, half of it in half cells."""
    w = np.tril(np.full((cells, cells), cells**-2.0))
    w[np.diag_indices(cells)] /= 2
    return GridDensity(0.0, 1.0, w)


def refine(w: np.ndarray, m: int) -> np.ndarray:
    """The same density on a grid m times finer."""
    fine = np.kron(w, np.full((m, m), m**-2.0))
    n = len(w)
    for k in range(n):
        # A half cell becomes m half cells and m (m - 1) / 2 whole ones of twice their mass.
        part = np.tril(np.full((m, m), 2 * w[k, k] / m**2))
        part[np.diag_indices(m)] /= 2
        fine[k * m : (k + 1) * m, k * m : (k + 1) * m] = part
    return fine


def relay_loop(w: np.ndarray, nodes: np.ndarray, start: Literal[-1, 1] = -1) -> np.ndarray:
    """The slow oracle: every relay, for inputs that are nodes of the grid, given as their numbers.

    The relays of cell (i, j) switch up at inputs between nodes i and i+1, down between j and j+1.
    From node to node a cell therefore switches as a whole: up at node i+1 and above, down at node j
    and below. So do the half cells on the diagonal.
    """
    cells = len(w)
    i, j = np.indices((cells, cells))
    relay, y = np.full((cells, cells), start), []
    for k in nodes:
        relay[k >= i + 1] = 1
        relay[k <= j] = -1
        y.append((np.tril(w) * relay).sum())
    return np.array(y)


@settings(max_examples=40)
@given(data=st.data(), seed=seeds, start=st.sampled_from(["negative", "positive"]))
def test_equal_to_relays_at_every_third_of_a_cell(data: st.DataObject, seed: int, start: str):
    """On a grid three times finer the inputs are nodes, so the relay loop is exact there."""
    m, w = 3, np.tril(np.random.default_rng(seed).random((4, 4)))
    node = st.integers(0, len(w) * m)
    nodes = np.array(data.draw(st.lists(node, min_size=SAMPLES, max_size=SAMPLES), "nodes"))
    model = Preisach(GridDensity(0.0, 4.0, w), initial=start)
    wanted = relay_loop(refine(w, m), nodes, 1 if start == "positive" else -1)
    np.testing.assert_allclose(output(model, nodes / m), wanted, rtol=0, atol=rounding(model))


@given(seed=seeds, u=histories(LOW - 1, HIGH + 1))
def test_leading_is_the_reversible_part_minus_the_lagging_relays(seed: int, u: np.ndarray):
    rng = np.random.default_rng(seed)
    density = GridDensity(LOW, HIGH, weights(rng))
    increments, offset = rng.random(density.cells), 0.7
    leading = Preisach(density, increments, offset, leading=True)
    relays = output(Preisach(density), u)
    nodes = np.linspace(LOW, HIGH, density.cells + 1)
    R = np.interp(u, nodes, np.append(0.0, np.cumsum(increments)))
    width = (HIGH - LOW) / density.cells
    R += increments[0] * np.minimum(u - LOW, 0) / width
    R += increments[-1] * np.maximum(u - HIGH, 0) / width
    wanted = offset + R - relays
    np.testing.assert_allclose(output(leading, u), wanted, rtol=0, atol=2 * rounding(leading))


nodes_of_thirds = st.lists(st.integers(0, 12), min_size=SAMPLES, max_size=SAMPLES).map(np.array)


@settings(max_examples=40)
@given(nodes=nodes_of_thirds, seed=seeds)
def test_relays_up_at_first_stay_up_until_they_are_visited(nodes: np.ndarray, seed: int):
    """Against relays, some of each cell up at first: at thirds of cells, half cells included."""
    m, rng = 3, np.random.default_rng(seed)
    w = np.tril(rng.random((4, 4)))
    up = w * rng.choice([0.0, 0.3, 1.0], w.shape)
    model = Preisach(GridDensity(0.0, 4.0, w), up=up)
    wanted = relay_loop(refine(w - up, m), nodes, -1) + relay_loop(refine(up, m), nodes, 1)
    np.testing.assert_allclose(output(model, nodes / m), wanted, rtol=0, atol=rounding(model))


def test_relays_that_cannot_be_up_at_first():
    w = weights(np.random.default_rng(0))
    density = GridDensity(LOW, HIGH, w)
    refuses("bad-state", lambda: Preisach(density, up=w, initial="positive"))
    refuses("wrong-shape", lambda: Preisach(density, up=np.ones((2, 2))), "(2, 2)", "(7, 7)")
    for factor in (1.5, -0.5):
        wrong = w.copy()
        wrong[5, 1] *= factor
        refuses("bad-state", lambda wrong=wrong: Preisach(density, up=wrong), "cell (5, 1)")


@settings(max_examples=4)
@given(seed=seeds, past=histories(LOW, HIGH, 6), u=histories(LOW, HIGH))
def test_a_staircase_is_a_past(seed: int, past: np.ndarray, u: np.ndarray):
    density = GridDensity(LOW, HIGH, weights(np.random.default_rng(seed)))
    model = Preisach(density, initial=tuple(past))
    wanted = output(Preisach(density), np.concatenate([past, u]))[len(past) :]
    got = model.evaluate(model.prepare(None, u))  # every staircase would compile anew
    np.testing.assert_allclose(got, wanted, rtol=0, atol=rounding(model))


def test_initial_states_that_are_refused():
    density = uniform(4)
    assert Preisach(density, initial=[1, 0.5]).initial == (1.0, 0.5)  # as a file gives it
    refuses("bad-option", lambda: Preisach(density, initial="virgin"), "'virgin'", "demagnetised")
    for u in (1.5, np.nan):
        refuses("out-of-range", lambda u=u: Preisach(density, initial=(0.5, u)), str(u))
    refuses("bad-option", lambda: Preisach(density, capacity=2))


def forgotten_loops(u: np.ndarray, capacity: int) -> np.ndarray:
    """2 E(a, b) at every sample, for the density 1; 0 while nothing that matters is forgotten.

    On a stack without a limit, a is the last reversal that the limited one keeps for sure, b the
    first that it may have forgotten.
    """
    stack, s, before, forgot, found = [0.0], 1, 0.0, False, []
    for x in u:
        if x != before and np.sign(x - before) != s:
            stack.append(before)
            s = -s
        forgot |= len(stack) > capacity
        while len(stack) >= 3 and s * x >= s * stack[-2]:
            del stack[-2:]
        forgot &= len(stack) >= capacity - 1
        a, b = stack[capacity - 3 : capacity - 1] if forgot else (0.0, 0.0)
        before = x
        found.append((a - b) ** 2)
    return np.array(found)


def test_steps_of_plain_numbers_are_compiled_once(caplog):
    model = Preisach(uniform(5))
    state, _ = model.step(model.init(), None, 0.25)
    with jax.log_compiles():
        model.step(state, None, 0.75)
    assert not caplog.records


@settings(max_examples=15)
@given(u=histories(0.0, 1.0), noise=seeds)
def test_a_full_stack_forgets_the_smallest_loop(u: np.ndarray, noise: int):
    """Let a be the youngest reversal the stack keeps and b the oldest one it forgot.

    All that differs is in the loop [a, b], so the output is off by at most twice its E until the
    input has left it; and exact from there on. So is the batch that goes on from such a state.
    """
    rng, cut = np.random.default_rng(noise), SAMPLES // 2
    u = np.clip(u + rng.uniform(-0.2, 0.2, SAMPLES) * rng.integers(2), 0.0, 1.0)
    model = Preisach(uniform(5), capacity=5)
    exact, error = output(model, u), forgotten_loops(u, 5)
    state, y = model.stream(None, u)
    assert np.all(np.abs(np.asarray(y) - exact) <= error + 1e-14)
    assert (int(state.loops.dropped) > 0) >= error.any()
    head, _ = model.stream(None, u[:cut])
    tail = simulate(model, jnp.asarray(u[cut:]), None, head)
    assert np.all(np.abs(np.asarray(tail) - exact[cut:]) <= error[cut:] + 1e-14)


def test_densities_that_are_refused():
    w = weights(np.random.default_rng(0))
    wrong = w.copy()
    wrong[4, 2] = -0.25
    with raises("parameter-out-of-bounds", "cell (4, 2) is -0.25", "leading=True", "signed=True"):
        GridDensity(LOW, HIGH, wrong)
    assert GridDensity(LOW, HIGH, wrong, signed=True).cells == len(w)
    refuses("zero-range", lambda: GridDensity(1.0, 1.0, w))
    refuses("wrong-shape", lambda: GridDensity(LOW, HIGH, w[:3]))
    refuses("not-finite", lambda: GridDensity(LOW, HIGH, np.where(w > 0.9, np.nan, w)))
    # What is above the diagonal is no cell.
    assert GridDensity(LOW, HIGH, w - 1 + np.tril(np.ones_like(w))).cells == len(w)


def test_reversible_parts_that_are_refused():
    density = uniform(4)
    refuses("length-mismatch", lambda: Preisach(density, np.ones(3)), "(3,)", "reversible (4)")
    refuses("parameter-out-of-bounds", lambda: Preisach(density, np.array([1.0, -0.1, 1.0, 1.0])))


@pytest.mark.parametrize("seed", rest_thorough(range(4), 1))
def test_least_slope_is_the_least_slope(seed: int):
    """No branch is flatter, and some branch is as flat: rising and falling, from every quarter cell."""
    rng = np.random.default_rng(seed)
    density = GridDensity(0.0, 3.0, np.tril(rng.normal(size=(3, 3))), signed=True)
    model = Preisach(density, rng.random(3))
    least, h = np.asarray(model.least_slope()), 1e-6
    quarters = np.arange(0, 3.01, 0.25)
    places = np.concatenate([quarters[:-1] + 1e-4, quarters[1:] - 2e-4])
    # Down to r and up, or up to r and down: r is a reversal, and the last two samples lie behind it.
    paths = [[3.0, r, x, x + h] for r in quarters for x in places if x > r]
    paths += [[0.0, r, x + h, x] for r in quarters for x in places if x + h < r]
    y = np.asarray(jax.jit(jax.vmap(lambda u: model.simulate(None, u)))(jnp.asarray(paths)))
    slope = (y[:, 3] - y[:, 2]) / (np.array(paths)[:, 3] - np.array(paths)[:, 2])
    cell = np.array(paths)[:, 2].astype(int)
    found = np.array([slope[cell == k].min() for k in range(3)])
    # Outputs of size 10 rounded and divided by h; the last 2e-4 of a cell are not probed.
    assert np.all(found >= least - 1e-7)
    assert np.all(found <= least + 1e-2)


def triangle(a: float, b: float, samples: int) -> np.ndarray:
    """From a to b and back to a."""
    return np.concatenate([np.linspace(a, b, samples), np.linspace(b, a, samples)[1:]])


limits = st.tuples(st.floats(LOW, HIGH), st.floats(LOW, HIGH)).map(sorted)


@given(seed=seeds, one=histories(LOW, HIGH, 12), other=histories(LOW, HIGH, 12), between=limits)
def test_minor_loops_between_the_same_limits_are_congruent(seed: int, one, other, between):
    """They differ by a vertical shift alone, whatever happened before."""
    model = Preisach(GridDensity(LOW, HIGH, weights(np.random.default_rng(seed))))
    low, high = between
    loop, shapes = triangle(low, high, 14), []
    for past in (one, other):
        # The first way up still closes older loops; from the top on the loop is a loop.
        y = output(model, np.concatenate([past, [low, high], loop]))[len(past) + 2 :]
        shapes.append(y - y[0])
    np.testing.assert_allclose(*shapes, rtol=0, atol=rounding(model))


@given(seed=seeds, past=histories(LOW, HIGH, 20), excursion=histories(0.0, 1.0, 18))
def test_return_point_memory(seed: int, past: np.ndarray, excursion: np.ndarray):
    """However the input moves between its last reversal and itself, coming back restores y."""
    model = Preisach(GridDensity(LOW, HIGH, weights(np.random.default_rng(seed))))
    # Down to the bound and up to the last sample: the branch's anchor is the bound.
    x = past[-1]
    u = np.concatenate([past, [LOW, x], LOW + excursion * (x - LOW), [x]])
    y = output(model, u)
    np.testing.assert_allclose(y[-1], y[len(past) + 1], rtol=0, atol=rounding(model))


HALF_WIDTH = 0.3


def model(seed: int, dead_band: float) -> Preisach:
    rng = np.random.default_rng(seed)
    density = GridDensity(LOW, HIGH, weights(rng))
    return Preisach(density, rng.random(CELLS), rng.normal(), dead_band=dead_band)


@eqx.filter_jit
def simulated(model: Preisach, u: np.ndarray) -> jax.Array:
    return model.simulate(None, u)


def output_behind_the_band(model: Preisach, u: np.ndarray) -> np.ndarray:
    return np.asarray(simulated(model, u))


@given(seed=seeds, u=histories(LOW - 1, HIGH + 1))
def test_relays_see_the_play_and_the_reversible_part_the_input(seed: int, u: np.ndarray):
    v = play(u, HALF_WIDTH)
    plain, banded = model(seed, 0.0), model(seed, HALF_WIDTH)
    memoryless = Preisach(GridDensity(LOW, HIGH, np.zeros((CELLS, CELLS))), plain.reversible)
    wanted = (
        output_behind_the_band(plain, v)
        + output_behind_the_band(memoryless, u)
        - output_behind_the_band(memoryless, v)
    )
    # Additions of numbers of size one.
    np.testing.assert_allclose(output_behind_the_band(banded, u), wanted, rtol=0, atol=1e-12)
    np.testing.assert_allclose(banded.stream(None, u)[1], wanted, rtol=0, atol=1e-12)


@given(seed=seeds, sigma=st.floats(1e-3, 10.0))
@settings(max_examples=25)
def test_input_noise_of_a_smooth_path(seed: int, sigma: float):
    """The median of 5,000 such correlated differences scatters by 2 %: five times that."""
    k = np.arange(5000)
    path = 1e3 * sigma * np.sin(2 * np.pi * k / 5000) + np.where(k > 2500, 1e4 * sigma, 0.0)
    noisy = path + np.random.default_rng(seed).normal(0, sigma, len(k))
    assert input_noise(noisy) == pytest.approx(sigma, rel=0.1)


def test_what_is_refused():
    refuses("too-few-rows", lambda: input_noise(np.array([1.0, 2.0])))
    for wrong in (-0.1, np.nan, np.inf):
        refuses("bad-option", lambda wrong=wrong: model(0, wrong))
