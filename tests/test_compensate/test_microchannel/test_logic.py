"""Which places are pressed at once, by sums of levels."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from compensate.internal import LogicStatus
from compensate.microchannel import LogicTable
from hysteresis.rigs import MicrochannelRig
from tests.refusals import refuses

OK, COLLISION, CLOSE, UNKNOWN, NO_PRESS, INVALID = LogicStatus

PAPER = [[3, 2, 1], [1, 2, 3]]
FIVE = [[3, 2.5, 2, 1.5, 1], [1, 1.5, 2, 2.5, 3]]
ANY_FORCE = (0.1, 1.0)


def test_table_i_is_the_paper_s():
    assert str(LogicTable(PAPER, "ACE")).splitlines() == [
        "Contact Locations  V1     V2", "A                  3      1",
        "C                  2      2", "E                  1      3",
        "A, C               3+2    1+2", "A, E               3+1    1+3",
        "C, E               2+1    2+3", "A, C, E            3+2+1  1+2+3",
    ]  # fmt: skip


def unit_of(force: float) -> float:
    """V of E in layer 1: one level, at the end of a finger's press."""
    rise = force * np.sin(np.linspace(0, np.pi / 2, 12))
    return float(MicrochannelRig().follow(rise[:, None] * [0, 0, 0, 0, 1], 0.05)[-1, 0])


def test_table_iii_is_the_paper_s():
    """Three presses of each combination by fingers, none taken for another by most sensors.

    In the long run 99.3 % of such presses are right, 86 % of such tables: fingers are placed as they are.
    """
    table = LogicTable(PAPER, "ACE", unit=unit_of(4.0), noise=0.02)
    pressed = [s for s in table.combinations for _ in range(3)]
    force = [[4.0 * (k in s) for k in "ABCDE"] for s in pressed]
    right = []
    for seed in range(10):
        readings = MicrochannelRig(seed=seed).press_together(force)
        found = [table.decide(reading).places for reading in readings]
        right.append(sum(f == s for f, s in zip(found, pressed, strict=True)))
    assert np.median(right) == 21
    assert min(right) >= 19


@pytest.mark.parametrize(("unit", "apart"), [(1.0, 19), (ANY_FORCE, 8)])
def test_all_31_combinations_of_five_are_decided_or_named(unit, apart):
    """Read without scatter; each that is not decided is named among those that it collides with."""
    table = LogicTable(FIVE, unit=unit, common=0.01, differential=0.01)
    named = {s for group in table.collisions() for s in group}
    assert len(table.combinations) == 31
    assert len(named) == 31 - apart
    for pressed, reading in zip(table.combinations, table.sums, strict=True):
        found = table.decide(reading if unit == 1.0 else 0.4 * reading)
        if pressed in named:
            assert found.status == COLLISION
            assert pressed in (found.places, *found.alternatives)
        else:
            assert found == (pressed, (), found.probability, OK)
            assert found.probability > 0.99


@given(
    arrays(
        float,
        st.tuples(st.integers(1, 3), st.integers(1, 5)),
        elements=st.sampled_from([1, 1.5, 2, 3]),
    ),
    st.booleans(),
)
def test_collisions_are_all_equal_or_parallel_sums(levels, known):
    """Pair by pair, from the definition."""
    table = LogicTable(levels, unit=1.0 if known else (1e-6, 1e6))
    linked = set()
    for m, n in combinations(range(len(table.sums)), 2):
        s, t = table.sums[m], table.sums[n]
        parallel = np.isclose(s * t.sum(), t * s.sum(), rtol=1e-12).all()
        if np.array_equal(s, t) or (parallel and not known):
            linked |= {frozenset([m, n])}
    groups = table.collisions()
    at = {s: n for n, s in enumerate(table.combinations)}
    found = {frozenset([at[s], at[t]]) for group in groups for s, t in combinations(group, 2)}
    assert found == linked


@pytest.mark.parametrize(("levels", "unit"), [(FIVE, 1.0), (PAPER, ANY_FORCE), (FIVE, ANY_FORCE)])
def test_remedies_remove_every_collision(levels, unit):
    table = LogicTable(levels, unit=unit)
    assert table.collisions()
    remedies = table.remedies(most_changes=2)
    assert remedies
    for remedy in remedies:
        assert LogicTable(remedy.levels, unit=unit).collisions() == ()
        assert remedy.separation >= 0.02
        # What it says is what it does: the old levels are still there.
        old = np.array(levels, float)
        if len(remedy.levels) == len(old):
            assert np.array_equal(np.sort(remedy.levels), np.sort(old)) or (
                1 <= np.sum(remedy.levels != old) == remedy.change.count("instead")
            )
        else:
            np.testing.assert_array_equal(remedy.levels[: len(old)], old)
            new = remedy.levels[len(old) :]
            np.testing.assert_array_equal(np.sort(new), np.sort(old[:1]).repeat(len(new), 0))


def test_readings_of_nothing_and_of_no_combination():
    table = LogicTable(PAPER, "ACE", noise=0.02)
    assert table.decide([0.03, -0.05]) == (frozenset(), (), 0.0, NO_PRESS)
    assert table.decide([6.0, 0.5]).status == UNKNOWN
    assert table.decide([20.0, 20.0]).status == UNKNOWN
    assert table.decide([np.nan, 1.0]).status == INVALID
    assert table.decide([np.inf, 1.0]).status == INVALID
    # C and A+E at once as far off: both are told.
    close = LogicTable(PAPER, "ACE", common=0.3).decide([5.4, 5.4])
    assert close.status == CLOSE
    assert close.alternatives


@pytest.mark.parametrize("call", [
    lambda: LogicTable([1.0, 2.0]), lambda: LogicTable(np.ones((2, 11))),
    lambda: LogicTable([[1.0, 0.0]]), lambda: LogicTable([[1.0, np.nan]]),
    lambda: LogicTable(PAPER, "AAC"), lambda: LogicTable(PAPER, unit=(2.0, 1.0)),
    lambda: LogicTable(PAPER, unit=0.0), lambda: LogicTable(PAPER, common=0.0),
    lambda: LogicTable(PAPER).decide([1.0]),
])  # fmt: skip
def test_bad_arguments_are_refused(call):
    refuses("bad-option", call)
