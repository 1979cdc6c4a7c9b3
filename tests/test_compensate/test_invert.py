"""Forward after inverse gives back the output, and every status says what is the case."""

from dataclasses import replace
from functools import cache
from inspect import unwrap
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compensate import AbstractCompensator, Status, invert
from compensate.internal import Estimate
from hysteresis import (
    AbstractModel,
    Burgers,
    LinearSponge,
    MonotoneCurve,
    NonlinearMaxwell,
    Preisach,
    Scaled,
    Series,
    Sum,
)
from hysteresis.preisach import GridDensity
from tests.problems import (
    CELLS,
    HIGH,
    INVERTIBLE,
    LOW,
    SAMPLES,
    Problem,
    clock,
    histories,
    kinds_often,
    random_histories,
    tagged,
    variants_thorough,
    weights,
    without,
)
from tests.refusals import raises, refuses

seeds = st.integers(0, 2**32 - 1)
every = pytest.mark.parametrize("problem", variants_thorough(INVERTIBLE))
HISTORIES = 25
"""One number of them everywhere, so that a model's programs are compiled once."""


def times(problem: Problem, model: AbstractModel, seed: int) -> jax.Array:
    """Steps over four decades; for a held input none longer than its inverse stands."""
    t = clock(seed)
    if "rates" in problem.tags and isinstance(model, Burgers) and model.hold == "constant":
        t = np.cumsum(np.minimum(np.diff(t, prepend=0.0), 0.9 * model.largest_stable_step()))
    return jnp.asarray(t)


@eqx.filter_jit
def forward(model: AbstractModel, t: jax.Array, u: jax.Array) -> jax.Array:
    """`simulate` of every row of u."""
    return jax.vmap(lambda row: model.simulate(t, row))(u)


@eqx.filter_jit
def backward(compensator: AbstractCompensator, t: jax.Array, y: jax.Array) -> Estimate:
    return jax.vmap(lambda row: compensator.simulate(t, row))(y)


@eqx.filter_jit
def streamed(compensator: AbstractCompensator, t: jax.Array, y: jax.Array) -> Estimate:
    def scan(row: jax.Array) -> Estimate:
        step = lambda state, sample: compensator.step(state, *sample)  # noqa: E731
        return jax.lax.scan(step, compensator.init(), (t, row))[1]

    return jax.vmap(scan)(y)


class Reachable(NamedTuple):
    """A model, times, random inputs, the outputs they give, and what the inverse makes of those."""

    model: AbstractModel
    t: jax.Array
    u: np.ndarray
    y: np.ndarray
    found: Estimate


@cache
def reachable(problem: Problem) -> Reachable:
    model, rng = problem.model(), np.random.default_rng(0)
    u = random_histories(rng, problem.low, problem.high, (HISTORIES, SAMPLES))
    t = times(problem, model, 0)
    y = forward(model, t, jnp.asarray(u))
    return Reachable(model, t, u, np.asarray(y), backward(invert(model), t, y))


@pytest.mark.parametrize("problem", tagged("no-inverse"), ids=lambda p: p.name)
def test_a_model_without_an_inverse_is_refused(problem: Problem):
    refuses("not-invertible", lambda: invert(problem.model()))


@every
def test_forward_of_inverse_is_the_identity(problem: Problem):
    """To 1e-9 of the range of y, on random histories."""
    model, t, _, y, found = reachable(problem)
    again = np.asarray(forward(model, t, found.value))
    assert np.abs(again - y).max() <= 1e-9 * np.ptp(y)
    known = {Status.OK, Status.FLAT} if "flat" in problem.tags else {Status.OK}
    if "grid" in problem.tags:
        known |= {Status.FLAT}  # a branch starts flat, and so does an output that stands still
    if problem.name == "sponge-threshold":
        known |= {Status.BELOW_THRESHOLD}
    assert set(np.unique(found.status).tolist()) <= known


@every
def test_the_input_itself_is_found_where_the_slope_is_not_zero(problem: Problem):
    _, _, u, y, estimate = reachable(problem)
    found = np.asarray(estimate.value)
    if "grid" not in problem.tags:
        there = u >= 1.5 if problem.name == "sponge-threshold" else np.ones_like(u, bool)
        assert np.abs(found - u)[there].max() <= 1e-7 * np.ptp(u)
        return
    if "flat" in problem.tags:
        return
    # Where the last step moved the output by a thousandth of its range per range of input.
    du, dy = np.diff(u, axis=1, prepend=np.nan), np.diff(y, axis=1, prepend=np.nan)
    steep = np.abs(dy) * np.ptp(u) > 1e-3 * np.abs(du) * np.ptp(y)
    far = np.abs(du) > 1e-3 * np.ptp(u)
    assert np.mean(steep & far) > 0.5
    assert np.abs(found - u)[steep & far].max() <= 1e-7 * np.ptp(u)


@every
def test_a_reading_that_stands_is_no_sure_input_where_the_input_may_move(problem: Problem):
    model, t, u, _, _ = reachable(problem)
    rng, span = np.random.default_rng(1), problem.high - problem.low
    moved = u.copy()
    aside = rng.choice([-1, 1], u[:, ::2].shape) * rng.choice([0.01, 0.03, 0.1], u[:, ::2].shape)
    aside = np.clip(u[:, ::2] + span * aside, problem.low, problem.high)
    moved[:, 1::2] = aside[:, : u[:, 1::2].shape[1]]
    y = forward(model, t, jnp.asarray(moved))
    found = backward(invert(model), t, y)
    stands = np.diff(np.asarray(y), axis=1, prepend=np.nan) == 0
    stands[:, ::2] = False
    off = np.abs(np.asarray(found.value) - moved)
    assert off[stands & (np.asarray(found.status) == Status.OK)].max(initial=0.0) <= 1e-6 * span


@pytest.mark.parametrize("problem", kinds_often(INVERTIBLE))
@settings(max_examples=4)
@given(seed=seeds, data=st.data())
def test_drawn_histories_with_ties_and_plateaus(problem: Problem, seed: int, data: st.DataObject):
    row = histories(problem.low, problem.high)
    u = np.stack(data.draw(st.lists(row, min_size=HISTORIES, max_size=HISTORIES), "u"))
    model = problem.model(seed)
    t = times(problem, model, seed)
    y = np.asarray(forward(model, t, jnp.asarray(u)))
    found = backward(invert(model), t, jnp.asarray(y))
    again = np.asarray(forward(model, t, found.value))
    # One history may span little; what is added up to give it is of the size of the parameters.
    spread = np.maximum(np.maximum(np.ptp(y, axis=1), np.abs(y).max(1)), 1e-3)
    assert (np.abs(again - y).max(1) <= 1e-9 * spread).all()


@pytest.mark.parametrize(
    "problem", kinds_often(p for p in INVERTIBLE if "grid" not in p.tags or p.name == "preisach-up")
)
def test_nan_holds_the_last_value_and_the_next_sample_is_right(problem: Problem):
    """In batch and in stream alike."""
    model, t, u, y, _ = reachable(problem)
    compensator = invert(model)
    if "rates" in problem.tags:
        t = 0.1 * t  # without its neighbours a sample is a longer step; a held input bears no such
        y = np.asarray(forward(model, t, jnp.asarray(u)))
    rng = np.random.default_rng(2)
    hole = rng.random(y.shape) < 0.2
    hole[:, 5:8], hole[3] = True, True
    hole[4, :2] = True
    broken = np.where(hole, rng.choice([np.nan, np.inf, -np.inf], y.shape), y)
    value, status = map(np.asarray, backward(compensator, t, jnp.asarray(broken)))
    np.testing.assert_array_equal(status == Status.INVALID, hole)
    assert np.isfinite(value).all()
    assert np.all((value[:, 1:] == value[:, :-1]) | ~hole[:, 1:])
    if "grid" not in problem.tags:  # where `simulate` is the scan of `step`
        steps = streamed(compensator, t, jnp.asarray(broken))
        # The same sums in another order, amplified by the steepest inverse slope.
        np.testing.assert_allclose(steps.value, value, rtol=0, atol=1e-9 * np.ptp(u))
        np.testing.assert_array_equal(steps.status, status)
    # The good samples are those of a record that never had the others.
    good = ~hole[5]
    t, y = without(hole[5], np.asarray(t), y[5])
    alone = backward(compensator, jnp.asarray(t), jnp.tile(y, (HISTORIES, 1))).value[0]
    np.testing.assert_allclose(alone[: good.sum()], value[5][good], rtol=0, atol=1e-9 * np.ptp(u))


def preisach(reversible: float, sparse: bool = False, **options: Any) -> Preisach:
    rng = np.random.default_rng(3)
    increments = np.full(CELLS, reversible) if reversible else None
    return Preisach(GridDensity(LOW, HIGH, weights(rng, sparse)), increments, **options)


def test_beyond_saturation_the_reversible_part_goes_on():
    model = preisach(0.5)
    u = np.array([0.0, HIGH, HIGH + 0.7, 1.0, LOW, LOW - 0.4, 0.5])
    found = invert(model).simulate(None, np.asarray(model.simulate(None, u)))
    np.testing.assert_allclose(found.value, u, rtol=0, atol=1e-7)  # slopes vanish at a reversal
    np.testing.assert_array_equal(found.status[jnp.array([0, 3, 6])], Status.OK)
    np.testing.assert_array_equal(found.status[jnp.array([2, 5])], Status.EXTRAPOLATED)


def test_signed_densities_that_fall_are_refused():
    w = np.tril(np.ones((3, 3)))
    w[2, 1] = -3.0
    with raises("not-invertible", "can fall"):
        invert(Preisach(GridDensity(0.0, 3.0, w, signed=True)))
    # With a reversible part as steep as the relays fall it is invertible.
    model = Preisach(GridDensity(0.0, 3.0, w, signed=True), np.full(3, 6.0))
    u = random_histories(np.random.default_rng(0), 0.0, 3.0, (50, SAMPLES))
    y = forward(model, jnp.zeros(SAMPLES), jnp.asarray(u))
    again = forward(model, jnp.zeros(SAMPLES), backward(invert(model), jnp.zeros(SAMPLES), y).value)
    np.testing.assert_allclose(again, y, rtol=0, atol=1e-9 * float(jnp.ptp(y)))


def test_readings_of_another_byte_order_are_numbers():
    swapped = np.array([1.0, 3.0]).astype(np.dtype(float).newbyteorder())
    found = invert(LinearSponge(2.0, 1.0)).simulate(None, swapped)
    np.testing.assert_allclose(found.value, [0.0, 1.0])


def test_a_line_without_slope_is_refused():
    refuses("not-invertible", lambda: invert(LinearSponge(K=0.0, b=1.0)), "slope K is 0")
    for what in ("sponge", LinearSponge):
        # Behind the check of types, which only tests have.
        refuses("not-invertible", lambda it=what: unwrap(invert)(it), "neither a model nor a fit")


def test_steps_too_long_for_a_held_input_are_refused():
    """With the largest step that works: below it the round trip holds, above it is 1e97 off."""
    model = Burgers(2.0, 40.0, 1.0, 5.0, hold="constant")
    compensator = invert(model)
    limit = replace(model, leading=True).largest_stable_step()
    k, u = np.arange(200), np.random.default_rng(0).normal(size=200)
    for t in (10.0 * k, 1.001 * limit * k):
        with raises("unstable-step", f"{limit:.4g}"):
            compensator.simulate(t, np.asarray(model.simulate(t, u)))
    t = 0.95 * limit * k
    y = np.asarray(model.simulate(t, u))
    again = np.asarray(model.simulate(t, compensator.simulate(t, y).value))
    assert np.abs(again - y).max() <= 1e-9 * np.ptp(y)
    linear, t = Burgers(2.0, 40.0, 1.0, 5.0), 10.0 * k
    y = np.asarray(linear.simulate(t, u))
    again = np.asarray(linear.simulate(t, invert(linear).simulate(t, y).value))
    assert np.abs(again - y).max() <= 1e-9 * np.ptp(y)


@pytest.mark.parametrize(("strength", "falls"), [(3.0, True), (0.2, False)])
def test_a_model_that_falls_in_a_state_of_its_past_has_no_inverse(strength: float, falls: bool):
    """After a jump from 0 to u the output is u - strength u^2: on [0, 1] it falls from 1 / 2 on."""
    strengths = np.array([[0.0, strength]])
    creep = NonlinearMaxwell(0.0, 1.0, np.ones(1), strengths=strengths, leading=False)
    model = Sum((LinearSponge(K=1.0, b=0.0), creep))
    past = (np.arange(9.0), np.tile([0.0, 1.0, 0.0], 3))
    invert(model, trained=(0.0, 1.0))  # nothing is known of its states
    if not falls:
        invert(model, trained=(0.0, 1.0), past=past)
        return
    refuses("not-invertible", lambda: invert(model, trained=(0.0, 1.0), past=past), "falls")


def curve(*increments: float) -> MonotoneCurve:
    return MonotoneCurve.even(0.0, 2.0, np.array(increments))


@pytest.mark.parametrize("factor", [-1.5, -4.0])
def test_a_sum_that_falls_somewhere_has_none(factor: float):
    falling = Series([curve(0.0, 1.0, 0.0), Scaled(LinearSponge(1.0), factor)])
    model = Sum([curve(1.0, 1.0, 1.0), falling])
    refuses("not-invertible", lambda: invert(model), "the output of Sum falls")
