"""A compensator over a record is that of each of its sequences; known stretches end its run-in."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compensate import Status, adaptive, calibrated, estimate, invert, qualify
from compensate.internal import BracketedCompensator
from hysteresis import Burgers, PrandtlIshlinskii, Preisach, Record
from hysteresis.internal import Units, with_units
from hysteresis.preisach import GridDensity
from tests.problems import HIGH, INVERTIBLE, KINDS, LOW, Problem, random_histories, weights
from tests.refusals import refuses
from tests.thorough import rest_thorough

BURGERS = Burgers(2.0, 40.0, 1.0, 5.0)
GRID = Preisach(GridDensity(LOW, HIGH, weights(np.random.default_rng(0))), np.full(7, 0.5))
PLAYS = PrandtlIshlinskii([0.5], [1.0], 1.0, [0.1])
COMPENSATORS: dict[str, Callable[[], Any]] = {
    "Preisach": lambda: invert(GRID),
    "Burgers": lambda: invert(BURGERS),
    "plays that move with the rate": lambda: invert(PLAYS),
    "bisection": lambda: BracketedCompensator(GRID, LOW, HIGH),
    "draws": lambda: invert(
        jax.tree.map(lambda *x: np.stack(x), BURGERS, Burgers(3.0, 60.0, 2.0, 9.0))
    ),
}
"""How each is made, which takes longer than to collect the tests."""
made = cache(lambda name: COMPENSATORS[name]())


def record(seed: int, lengths: list[int], gaps: float = 0.0) -> Record:
    """Sequences of these lengths with a clock of their own, uneven."""
    rng, n = np.random.default_rng(seed), sum(lengths)
    t = np.concatenate([rng.normal() + np.cumsum(rng.uniform(0.1, 1, k)) for k in lengths])
    u = rng.uniform(LOW, HIGH, n)
    y = np.where(rng.random(n) < gaps, np.nan, rng.uniform(-3, 3, n))
    groups = np.repeat(np.arange(len(lengths)), lengths)
    return Record.from_arrays(u, y, t, groups, nan="omit")


@pytest.mark.parametrize("name", rest_thorough(COMPENSATORS, 2))
@settings(max_examples=8)
@given(
    seed=st.integers(0, 2**31),
    lengths=st.lists(st.sampled_from([1, 5, 8]), min_size=1, max_size=4),
    gaps=st.sampled_from([0.0, 0.3]),
)
def test_it_is_simulate_of_each_sequence(name: str, seed: int, lengths: list[int], gaps: float):
    """Of a single sample, of a power of two, and of a length that is made longer to one."""
    compensator, data = made(name), record(seed, lengths, gaps)
    # NumPy's rows: JAX would compile a program for each slice.
    found = jax.tree.map(np.asarray, estimate(compensator, data))
    for _, rows in data.sequences():
        alone = compensator.simulate(data.time[rows], data.output[rows])
        # The parallel recurrence of Burgers adds up in another order where there are more samples.
        for whole, part in zip(found, alone, strict=True):
            np.testing.assert_allclose(whole[..., rows], part, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(found.status == Status.INVALID, np.isnan(data.output))


def test_without_a_clock_and_without_rows():
    u = np.linspace(0, 1, 5)
    assert estimate(invert(GRID), Record.from_arrays(u, u)).value.shape == (5,)
    refuses("no-rows", lambda: estimate(invert(GRID), Record.from_arrays([], [])), "no rows")


FIRST, LAST, ROWS = 50, 90, 120
EACH = [p for p in INVERTIBLE if p.name != "burgers-lagging-constant"]


def looped(problem: Problem, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Times, and inputs that are one loop in the known rows."""
    rng = np.random.default_rng(seed)
    (u,) = random_histories(rng, problem.low, problem.high, (1, ROWS))
    way = 0.5 - 0.4 * np.cos(np.linspace(0, 2 * np.pi, LAST - FIRST))
    u[FIRST:LAST] = problem.low + (problem.high - problem.low) * way
    return np.cumsum(rng.uniform(0.2, 2, ROWS)), u


@pytest.mark.parametrize(  # relays take four fifths of the time
    "problem", rest_thorough(EACH, lambda p: p.name in KINDS - {"preisach-up"})
)
def test_a_known_loop_ends_the_run_in(problem: Problem):
    t, u = looped(problem)
    model = with_units(problem.model(1), None, (problem.low, problem.high))
    y, span = np.asarray(model.simulate(t, u)), problem.high - problem.low
    compensator = invert(
        model, trained=(problem.low, problem.high), start="unknown", past=(t, u), deviation=span / 100
    )  # fmt: skip
    own = slice(FIRST, LAST)
    state = compensator.state_from(t[own], u[own], y[own])
    found = compensator.simulate(t[LAST:], y[LAST:], state)
    assert found.status[0] == Status.OK
    status, off = np.asarray(found.status), np.abs(np.asarray(found.value) - u[LAST:])
    assert off[status == Status.OK].max() < 0.03 * span
    # A loop may leave open what matters later: said where the estimate is off by it, and only there.
    assert (off[status == Status.RUN_IN] > span / 200).all()


def test_a_record_with_known_rows_is_estimated_from_them():
    problem = next(p for p in INVERTIBLE if p.name == "bouc-wen")
    t, u = looped(problem)
    model = problem.model(1)
    y, own = np.asarray(model.simulate(t, u)), slice(FIRST, ROWS)
    record = Record.from_arrays(u[own], y[own], t[own])
    known = np.arange(ROWS - FIRST) < LAST - FIRST
    record = replace(record, columns=record.columns | {"known_rows": known})
    found = estimate(invert(model), record)
    assert np.allclose(found.value[LAST - FIRST :], u[LAST:], atol=1e-6)


def adapted(one: Any, given: Record) -> Any:
    return adaptive(one.model, given)


def in_units(**other: str) -> tuple[Any, Record]:
    """A compensator of N behind mm over seconds, and a record in these or in other units."""
    units = {"input_unit": "mm", "output_unit": "N", "time_unit": "s"} | other
    return invert(with_units(BURGERS, Units("mm", "N"))), replace(record(0, [24]), **units)


@pytest.mark.parametrize("other", [{"output_unit": "mN"}, {"input_unit": "m"}, {"time_unit": "ms"}])
@pytest.mark.parametrize("used", [estimate, calibrated, qualify, adapted])
def test_a_record_in_other_units_judges_and_teaches_nothing(used: Callable, other: dict[str, str]):
    """The input is not looked at where nothing but the readings counts."""
    if used is estimate and "input_unit" in other:
        used(*in_units(**other))
    else:
        refuses("wrong-unit", lambda: used(*in_units(**other)))


@pytest.mark.parametrize("made", [calibrated, adapted])
def test_units_are_those_of_what_is_inside(made: Callable):
    compensator, given = in_units()
    assert made(compensator, given).units == compensator.units
