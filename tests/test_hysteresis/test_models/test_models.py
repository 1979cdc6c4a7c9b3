"""The contract of `AbstractModel`, kept by every model of the table."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hysteresis import AbstractModel, parameters
from tests.problems import (
    KINDS,
    PROBLEMS,
    SAMPLES,
    Problem,
    clock,
    histories,
    kinds_often,
    variants_thorough,
)
from tests.refusals import refuses
from tests.thorough import rest_thorough

every = pytest.mark.parametrize("problem", variants_thorough(PROBLEMS))
kinds = pytest.mark.parametrize("problem", kinds_often(PROBLEMS))
seeds = st.integers(0, 2**32 - 1)
CUT = SAMPLES // 2
"""Both parts are of one length: their steps are compiled once."""
STARTS = (0, CUT, CUT + 1)
"""Sequences, one of them of a single sample."""


@eqx.filter_jit
def batch(model: AbstractModel, t: Any, u: Any, state: Any = None, starts=(0,)) -> Any:
    """`prepare` and `evaluate` under a trace: the shapes, and so the compilations, are the same for
    every history."""
    return model.evaluate(model.prepare(t, u, state, starts=starts))


def close(got: Any, wanted: Any, model: AbstractModel, steps: int = SAMPLES) -> None:
    """Equal to rounding: so many additions of numbers of the size of output and parameters."""
    sizes = [np.abs(value[np.isfinite(value)]).sum() for value in map(np.asarray, leaves(model))]
    scale = np.abs(np.asarray(wanted)).max() + sum(sizes)
    tolerance = 16 * steps * np.finfo(float).eps * scale
    np.testing.assert_allclose(np.asarray(got), np.asarray(wanted), rtol=0, atol=tolerance)


def leaves(model: AbstractModel) -> list[Any]:
    return [value for _, _, value in parameters(model) if value is not None]


def draw(problem: Problem, data: st.DataObject) -> tuple[AbstractModel, np.ndarray, np.ndarray]:
    seed = data.draw(seeds, "seed")
    u = data.draw(histories(problem.low, problem.high), "u")
    return problem.model(seed), clock(seed), u


@every
@settings(max_examples=15)
@given(data=st.data())
def test_simulate_is_the_scan_of_step(problem: Problem, data: st.DataObject):
    model, t, u = draw(problem, data)
    close(batch(model, t, u), model.stream(t, u)[1], model)


@pytest.mark.parametrize(
    "problem", [p for p in PROBLEMS if not p.model().traced], ids=lambda p: p.name
)
def test_what_is_prepared_depends_on_the_input_alone(problem: Problem):
    """A fit prepares once for all parameters, on some of which the first state may depend."""
    model, t, u = problem.model(1), clock(1), np.linspace(problem.low, problem.high, SAMPLES)
    prepared = problem.model(0).prepare(t, u)
    np.testing.assert_array_equal(model.evaluate(prepared), model.simulate(t, u))


@kinds
@settings(max_examples=10)
@given(data=st.data())
def test_a_record_may_be_cut_and_the_state_carried(problem: Problem, data: st.DataObject):
    model, t, u = draw(problem, data)
    whole = batch(model, t, u)
    state, head = model.stream(t[:CUT], u[:CUT])
    close(head, whole[:CUT], model)
    close(model.stream(t[CUT:], u[CUT:], state)[1], whole[CUT:], model)
    close(batch(model, t[CUT:], u[CUT:], state), whole[CUT:], model)


@kinds
@settings(max_examples=10)
@given(data=st.data())
def test_starts_are_independent_sequences(problem: Problem, data: st.DataObject):
    model, t, u = draw(problem, data)
    t[CUT:] -= t[CUT] - 0.5  # each sequence has its own clock
    every = batch(model, t, u, starts=STARTS)
    close(every[:CUT], model.stream(t[:CUT], u[:CUT])[1], model)
    # Of one sample; what comes later changes nothing, and the program of this length is there.
    close(every[CUT : CUT + 1], model.stream(t[CUT:], u[CUT:])[1][:1], model)
    last, rest = slice(CUT + 1, None), np.arange(CUT).clip(max=CUT - 2) + CUT + 1
    after = t[rest] + np.maximum(np.arange(CUT) - (CUT - 2), 0)
    close(every[last], model.stream(after, u[rest])[1][:-1], model)


@kinds
def test_vmap_over_parameters_and_inputs(problem: Problem):
    rng, t = np.random.default_rng(1), clock(1)
    models = [problem.model(seed) for seed in range(3)]
    u = rng.uniform(problem.low, problem.high, (3, SAMPLES))
    many = jax.tree.map(lambda *x: jnp.stack(x), *models)
    for run in (lambda m, x: batch(m, t, x), lambda m, x: m.stream(t, x)[1]):
        together = eqx.filter_jit(eqx.filter_vmap(run))(many, u)
        for k, model in enumerate(models):
            close(together[k], run(model, u[k]), model)


@every
def test_gradients_in_every_parameter_and_in_the_input(problem: Problem):
    """Against central differences along random directions.

    A step h = eps^(1/3) leaves eps^(2/3) = 4e-11 of both truncation and rounding, times third
    derivatives and condition: 1e-7 leaves three decades for those. The histories are random, so no
    two samples tie within h and the memory tree stays the same.
    """
    rng, t = np.random.default_rng(2), clock(2)
    model = problem.model(2)
    u = rng.uniform(problem.low, problem.high, SAMPLES)
    c, h = rng.normal(size=SAMPLES), np.finfo(float).eps ** (1 / 3)

    arrays, rest = eqx.partition(model, eqx.is_inexact_array)

    def value(arrays: Any, u: Any) -> jax.Array:
        return c @ batch(eqx.combine(arrays, rest), t, u)

    @jax.jit
    def slopes(arrays: Any, u: Any, du: Any) -> tuple[Any, jax.Array]:
        """By inputs forwards: laws that run outside JAX have no derivatives by them backwards."""
        return jax.grad(value)(arrays, u), jax.jvp(lambda u: value(arrays, u), (u,), (du,))[1]

    # On the host, so that moved and unmoved ones are of one type, and `batch` is compiled once.
    flat, structure = jax.tree.flatten(jax.tree.map(np.asarray, (arrays, u)))

    def at(flat: list[np.ndarray]) -> float:
        arrays, u = jax.tree.unflatten(structure, flat)
        return float(c @ np.asarray(batch(eqx.combine(arrays, rest), t, u)))

    directions = [rng.normal(size=leaf.shape) for leaf in flat]
    gradient, by_input = slopes(*jax.tree.unflatten(structure, flat), directions[-1])
    each = zip(jax.tree.leaves(gradient), directions, strict=False)
    along = [float(np.sum(np.asarray(slope) * d)) for slope, d in each] + [float(by_input)]
    size = abs(at(flat)) + float(np.abs(c).sum())
    for k, (leaf, direction) in enumerate(zip(flat, directions, strict=True)):
        up, down = ([*flat[:k], leaf + by * direction, *flat[k + 1 :]] for by in (h, -h))
        difference = (at(up) - at(down)) / (2 * h)
        if problem.name == "oscillator" and np.isnan(difference):
            assert leaf == 1.0  # it knows no exponent but 1
            continue
        assert abs(along[k] - difference) <= 1e-7 * (abs(along[k]) + size), k


@pytest.mark.parametrize(  # where time does not matter, two programs are compiled
    "problem", rest_thorough(PROBLEMS, lambda p: p.name in KINDS or "rates" in p.tags)
)
def test_time_is_needed_where_the_rate_matters_and_nowhere_else(problem: Problem):
    model, t = problem.model(), clock(0)
    u = np.linspace(problem.low, problem.high, SAMPLES)
    if "rates" in problem.tags:
        for run in (model.prepare, model.stream):
            refuses("no-time", lambda run=run: run(None, u))
        refuses("time-backwards", lambda: model.simulate(t[::-1], u))
        state = model.stream(t, u)[0]
        anew = model.simulate(t, u, state)  # its clock begins again: at once
        later = model.simulate(t + (t[-1] - t[0]), u, state)
        np.testing.assert_allclose(anew, later, rtol=1e-9)  # steps of shifted times are rounded
    else:
        np.testing.assert_array_equal(batch(model, None, u), batch(model, t, u))
    for columns in (u[:, None], np.stack([u, u], 1)):
        refuses("wrong-shape", lambda columns=columns: model.simulate(t, columns))
    for run in (model.simulate, model.stream):
        refuses("not-finite", lambda run=run: run(t, np.where(u == u[-1], np.nan, u)))
