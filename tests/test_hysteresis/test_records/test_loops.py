"""The table of loops: closed forms, loops that are open, cut or made of many turns, and honest errors."""

import json
from typing import Any

import numpy as np
import pytest
import scipy
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hysteresis import Record
from tests.refusals import refuses
from tests.thorough import rest_thorough

ROWS = 4000


def record_of(u: np.ndarray, y: np.ndarray, units: tuple[str, str] = ("mm", "N"), **more) -> Record:
    return Record.from_arrays(u, y, input_unit=units[0], output_unit=units[1], **more)


def angles(loops: int, rows: int = ROWS) -> np.ndarray:
    """From a trough on."""
    return 2 * np.pi * np.arange(loops * rows + 1) / rows - np.pi / 2


def one(table: Any, name: str) -> float:
    """A figure of the last loop."""
    return float(table[name].value[-1])


@given(
    stiffness=st.floats(0.1, 100), damping=st.floats(0.01, 10), size=st.floats(0.1, 50),
    offset=st.floats(-5, 5),
)  # fmt: skip
@example(stiffness=3.0, damping=0.7, size=2.0, offset=0.0)
@settings(max_examples=20)
def test_a_viscous_loop_has_the_figures_of_its_equation(stiffness, damping, size, offset):
    """F = k x + c v over x = a sin: area pi c a^2, width 2 c a, damping c / 2 k, loss factor c / k."""
    angle = angles(2)
    x = size * np.sin(angle)
    table = record_of(x, stiffness * x + damping * size * np.cos(angle) + offset).loops()
    assert len(table) == 2
    lost = np.pi * damping * size**2
    assert one(table, "energy lost") == pytest.approx(lost, rel=1e-6)
    assert one(table, "width at mid-range") == pytest.approx(-2 * damping * size, rel=1e-6)
    assert one(table, "largest width") == pytest.approx(-2 * damping * size, rel=1e-6)
    assert one(table, "loop width") == pytest.approx(lost / (2 * size), rel=1e-6)
    assert one(table, "damping ratio") == pytest.approx(damping / stiffness / 2, rel=1e-6)
    assert one(table, "loss factor") == pytest.approx(damping / stiffness, rel=1e-6)
    assert one(table, "stiffness") == pytest.approx(stiffness, rel=1e-5)
    assert one(table, "secant stiffness, loading") == pytest.approx(stiffness, rel=1e-6)
    assert one(table, "energy in") - one(table, "energy out") == pytest.approx(lost, rel=1e-6)
    assert one(table, "energy asymmetry") == pytest.approx(0, abs=1e-4)
    assert one(table, "softening") == pytest.approx(0, abs=1e-6)
    if abs(offset) < 1e-9 * size:  # F v is negative from the tip to the zero of F
        lag = np.arctan(damping / stiffness)
        back = np.cos(lag) - (np.pi / 2 - lag) * np.sin(lag)
        back *= size**2 * np.hypot(stiffness, damping)
        assert one(table, "energy out") == pytest.approx(back, rel=1e-4, abs=1e-6 * lost)


def test_a_load_that_drives_has_the_same_energy_and_damping():
    angle, lag = angles(2), 0.3
    table = record_of(5 * np.sin(angle), 2 * np.sin(angle - lag), ("N", "mm")).loops()
    assert (table["energy lost"].unit, table["stiffness"].unit) == ("N * mm", "N / mm")
    assert one(table, "energy lost") == pytest.approx(np.pi * 10 * np.sin(lag), rel=1e-6)
    assert one(table, "loss factor") == pytest.approx(np.tan(lag), rel=1e-5)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_record_that_stops_a_row_early_closes_within_its_error(noise):
    """Of 30 rows a loop the last one lacks 1 % of the input's range, and with it as much output."""
    x = np.sin(angles(5, 30)[:-1])
    y = 2 * x + noise * np.random.default_rng(0).normal(size=len(x))
    table = record_of(x, y).loops()
    assert len(table) == 5
    closure = table["closure"]
    assert (np.abs(closure.value) < 3 * closure.error + 1e-12).all()
    # Numbers without noise have that of rounding.
    assert (closure.error[:-1] < 3 * noise + 1e-4).all()


def test_coulomb_friction_and_rayleigh_loops():
    """A stop in parallel to a spring: area 4 f (a - f / k); Rayleigh: area 4 b a^3 / 3, width b a^2."""
    x = np.interp(np.arange(4 * ROWS + 1) / ROWS, [0, 1, 2, 3, 4], [-1, 1, -1, 1, -1])
    friction, stop = [], -0.5
    for step in np.diff(x, prepend=x[0]).tolist():
        stop = min(max(stop + 4 * step, -0.5), 0.5)
        friction.append(stop)
    table = record_of(x, 2 * x + np.array(friction)).loops()
    assert one(table, "energy lost") == pytest.approx(4 * 0.5 * (1 - 0.5 / 4), rel=1e-6)
    assert abs(one(table, "width at mid-range")) == pytest.approx(1.0, rel=1e-6)
    assert one(table, "tangent stiffness, loading") == pytest.approx(2, rel=1e-6)
    assert one(table, "initial stiffness, loading") == pytest.approx(6, rel=1e-6)
    assert one(table, "energy in") - one(table, "energy out") == pytest.approx(1.75, rel=1e-6)
    a, b = 1.0, 0.6
    side = np.where(np.diff(x, append=x[-2]) > 0, 1, -1)
    table = record_of(x, (1 + b * a) * x + side * b / 2 * (a**2 - x**2)).loops()
    assert one(table, "energy lost") == pytest.approx(4 * b * a**3 / 3, rel=1e-6)
    assert abs(one(table, "largest width")) == pytest.approx(b * a**2, rel=1e-6)


def magnetic(rows: int = ROWS, noise: float = 0.0) -> Record:
    """Loops from saturation on: coercive field 10, bias 2, saturation 50, slope 0.02."""
    angle = 2 * np.pi * np.arange(3 * rows + 1) / rows
    field = 100 * np.cos(angle)
    shift = np.where(np.sin(angle) > 0, -8, 12)  # falling: crosses zero at -8
    moment = 50 * np.tanh((field - shift) / 15) + 0.02 * (field - shift)
    moment += noise * np.random.default_rng(0).normal(size=len(field))
    names = {"input_name": "field", "output_name": "magnetization"}
    return record_of(field, moment, ("kA/m", "kA/m"), **names)


def test_a_magnetic_loop_is_known_by_its_units():
    table = magnetic().loops()
    assert table.kind == "magnetic"
    assert one(table, "coercive field, rising") == pytest.approx(12, rel=1e-6)
    assert one(table, "coercive field, falling") == pytest.approx(-8, rel=1e-6)
    assert one(table, "coercive field") == pytest.approx(10, rel=1e-6)
    assert one(table, "bias field") == pytest.approx(2, rel=1e-6)
    at_zero = [50 * np.tanh(s / 15) + 0.02 * s for s in (8, -12)]
    assert one(table, "remanence, falling") == pytest.approx(at_zero[0], rel=1e-4)
    assert one(table, "remanence") == pytest.approx((at_zero[0] - at_zero[1]) / 2, rel=1e-4)
    assert one(table, "saturation") == pytest.approx(50, rel=2e-3)
    assert one(table, "high-field slope") == pytest.approx(0.02, abs=1e-3)
    squareness = one(table, "remanence") / one(table, "saturation")
    assert one(table, "squareness") == pytest.approx(squareness, rel=1e-9)
    assert table["loss a cycle and volume"].unit == "J/m^3"
    expected = 4e-7 * np.pi * 1e6 * one(table, "loop width") * 200
    assert one(table, "loss a cycle and volume") == pytest.approx(expected, rel=1e-4)
    assert "damping ratio" not in table.names


@pytest.mark.parametrize("dense", rest_thorough([0.1, 1.0, 0.3], 1))
@pytest.mark.parametrize("steep", [3, 30])
def test_intervals_of_a_field_that_goes_in_uneven_steps(dense, steep):
    """Ten times as many rows where the loop is steep; it begins and ends at its largest field.

    A parabola over even steps told 1.47 for that field, means of two rows 0.9988, and intervals held the
    coercive field of steep loops once in ten. Of 40 loops 90 % intervals hold 36, less 6 by chance.
    """
    fall = np.linspace(1, -1, 801)
    fall = fall[(np.abs(fall) < dense) | (np.arange(801) % 10 == 0)]
    field = np.concatenate([fall, fall[-2::-1]])
    moment = np.tanh(steep * field + np.where(np.arange(len(field)) <= field.argmin(), 0.6, -0.6))
    truth = {
        "highest input": 1, "lowest input": -1, "coercive field": 0.6 / steep, "remanence": np.tanh(0.6),
        "width at mid-range": 2 * np.tanh(0.6), "largest width": 2 * np.tanh(0.6),
    }  # fmt: skip
    held = dict.fromkeys(truth, 0)
    for seed in range(40):
        noise = np.random.default_rng(seed).normal(size=(2, len(field)))
        table = record_of(field + 1e-4 * noise[0], moment + 1e-3 * noise[1], ("T", "A*m²")).loops()
        for name, value in truth.items():
            held[name] += abs(one(table, name) - value) < 1.645 * table[name].error[-1]
    assert min(held.values()) >= 30, held


def test_what_a_loop_does_not_tell_has_a_reason():
    field = magnetic()
    emu = record_of(field.input, field.output, ("Oe", "emu")).loops()
    assert np.isnan(emu["loss a cycle and volume"].value).all()
    assert "volume" in emu["loss a cycle and volume"].reason[0]
    assert emu["loss a cycle"].unit == "J"
    weak = field.input, field.input**3 / 1e4 + np.where(np.diff(field.input, append=0) > 0, -5, 5)
    table = record_of(*weak, ("kA/m", "kA/m")).loops()
    assert "saturate" in table["saturation"].reason[0]
    few = 20 * np.cos(np.arange(601) * np.pi / 100)
    minor = 50 * np.tanh((few - np.where(np.gradient(few) < 0, -8, 12)) / 15)
    minor += 2 * np.random.default_rng(0).normal(size=601)  # hides that the slope still changes
    less = record_of(few, minor, ("kA/m", "kA/m")).loops()
    assert all("saturate" in reason for reason in less["saturation"].reason)
    above = record_of(field.input, field.output + 200, ("kA/m", "kA/m")).loops()
    assert "cross zero" in above["coercive field"].reason[0]
    ramp = record_of(np.linspace(0, 1, 50), np.linspace(0, 1, 50)).loops()
    assert len(ramp) == 0
    assert str(ramp).startswith("No loop")
    x = np.array([0, 1, 2, 3, 2, 1.4] * 1, float)
    path = np.interp(np.linspace(0, 5, 200), np.arange(6), x)
    open_one = record_of(path, np.arange(200.0)).loops()
    assert "first input" in open_one["energy lost"].reason[0]
    assert np.isfinite(open_one["width at mid-range"].value[0])
    unknown = record_of(*weak, ("1", "1")).loops()
    assert unknown.kind == "plain"
    assert "loop area" in unknown.names
    assert unknown.summary[-1].name == "softening"
    refuses("bad-option", lambda: field.loops("electric"))


def legs(*ends: float) -> np.ndarray:
    """Straight legs of 100 rows from end to end."""
    places = np.arange(100 * (len(ends) - 1) + 1) / 100
    return np.interp(places, np.arange(len(ends)), ends)


def test_a_period_of_many_turns_is_one_loop():
    t = np.linspace(0, 10 * np.pi, 10001)
    x, v = np.sin(t) + 0.6 * np.sin(3 * t), np.cos(t) + 1.8 * np.cos(3 * t)
    table = record_of(x, x + 0.2 * v).loops()
    full = np.flatnonzero(table.full)
    assert len(full) >= 3
    # int c v^2 dt over a period
    assert table["energy lost"].value[full] == pytest.approx(0.2 * np.pi * (1 + 1.8**2), rel=1e-3)
    # Cycles that shrink and grow again do not repeat each other: each is a loop.
    a = angles(10)
    x = np.sin(a) * np.interp(a, [0, a[-1] / 2, a[-1]], [1, 0.5, 1])
    assert len(record_of(x, x + 0.1 * np.cos(a)).loops().full) == 10


def test_rows_that_do_not_count_empty_their_loops():
    x = np.sin(angles(3, 200))
    record = record_of(x, 2 * x + np.cos(angles(3, 200)))
    rows = np.arange(len(x))
    table = record.exclude((rows > 210) & (rows < 260)).loops()
    assert np.isfinite(table["energy lost"].value).tolist() == [True, False, True]
    assert "count" in table["energy lost"].reason[1]
    whole, few = record.loops(), record.exclude(rows % 50 == 7).loops()
    assert few["energy lost"].value == pytest.approx(whole["energy lost"].value, rel=1e-3)


def test_every_run_has_its_loops_and_softening_is_from_loop_to_loop():
    angle = angles(3, 400)
    x = np.sin(angle)
    number = np.minimum(np.arange(len(x)) // 400, 2)
    force = (3 - 0.3 * number) * (x + 1) + 0.2 * np.cos(angle)
    both = record_of(np.tile(x, 2), np.tile(force, 2), groups=np.repeat(["a", "b"], len(x)))
    table = both.loops()
    assert (table.run.tolist(), table.cycle.tolist()) == (["a"] * 3 + ["b"] * 3, [1, 2, 3, 1, 2, 3])
    assert table["softening"].value[[1, 2]] == pytest.approx([10, 100 / 9], abs=0.3)
    assert np.isnan(table["softening"].value[[0, 3]]).all()
    told = {row.name: row for row in table.summary}["stiffness"]
    assert (told.first, told.later) == pytest.approx((3, 2.55), rel=0.02)
    assert told.scatter == pytest.approx(np.std(table["stiffness"].value, ddof=1))
    assert json.dumps(table.document())
    assert len(table.columns()["stiffness (N / mm)"]) == 6


@given(
    ends=st.lists(st.integers(-20, 20), min_size=2, max_size=12),
    rows=st.lists(st.integers(1, 150), min_size=11, max_size=11),
    noise=st.sampled_from([0.0, 1e-3, 0.05]),
    units=st.sampled_from([("mm", "N"), ("N", "mm"), ("1", "1"), ("Oe", "emu"), ("V", "uC")]),
)
@settings(max_examples=60, deadline=None)
def test_any_motion_has_a_table(ends, rows, noise, units):
    """Long legs beside short ones, with noise and without: a figure is a number, or has a reason."""
    at = np.cumsum([0, *rows[: len(ends) - 1]])
    x = np.interp(np.arange(at[-1] + 1), at, ends)
    more = noise * np.random.default_rng(0).normal(size=(2, len(x)))
    table = record_of(x + more[0], x**3 + more[1], units).loops()
    for figure in table.figures:
        told = figure.reason == ""
        assert np.isfinite(figure.value[told]).all()
        assert (figure.error[told] >= 0).all()
        assert np.isnan(figure.value[~told]).all()
    assert json.dumps(table.document())
    assert ".e" not in str(table)


@pytest.mark.parametrize(
    ("rows", "loops", "keeps"),
    [(120.37, 300, 0), (500.37, 300, 0), (600.37, 300, 0.9), (6000.37, 60, 0.9)],
)
def test_intervals_hold_the_truth_as_often_as_they_say(rows, loops, keeps):
    """Loops that no row begins; 300 of them, so that 90 % is told to 1.7 %.

    Of noise that keeps 0.9 from row to row, intervals by white noise held the stiffness of one loop in ten.
    """
    angle = 2 * np.pi * np.arange(int((loops + 1) * rows)) / rows + 1.7
    x, force = 2 * np.sin(angle), 6 * np.sin(angle) + 1.4 * np.cos(angle)
    noise = np.random.default_rng(1).normal(size=(2, len(x)))
    noise = scipy.signal.lfilter([np.sqrt(1 - keeps**2)], [1, -keeps], noise)
    table = record_of(x + 0.004 * noise[0], force + 0.02 * noise[1]).loops()
    truth = {
        "energy lost": 1.4 * 2 * np.pi, "width at mid-range": -2.8, "damping ratio": 0.7 / 6,
        "stiffness": 3.0, "highest input": 2.0, "secant stiffness, loading": 3.0,
    }  # fmt: skip
    for name, value in truth.items():
        off = np.abs(table[name].value - value) / table[name].error
        assert 0.82 <= np.mean(off[1:-1] < 1.645) <= 1.0, name


def test_the_mean_of_loops_knows_how_much_they_differ():
    """Noise that outlasts a leg of 30 rows is seen from loop to loop alone: 90 %, and 4.7 % by chance."""
    angle = angles(5, 60)
    x, held = np.sin(angle), []
    for seed in range(40):
        white = np.random.default_rng(seed).normal(size=len(x))
        noise = scipy.signal.lfilter([1], [1, -0.97], white)
        row = record_of(x, 3 * x + 0.5 * np.cos(angle) + 0.01 * noise).loops().summary
        one = {row.name: row for row in row}["stiffness"]
        held.append(abs(one.value - 3) <= 1.645 * one.error)
    assert np.mean(held) >= 0.8


def test_a_turn_of_two_rows_is_not_read_beyond_its_readings():
    """np.r_[up, up[::-1]], as many rigs are driven: the tip is written twice."""
    up = np.linspace(0.0, 100.0, 200)
    x = np.tile(np.r_[up, up[::-1]], 30)
    fall = np.tile(np.repeat([-0.01, 0.01], 200), 30)
    y = 0.5 + 0.02 * x + fall * np.sin(np.pi * x / 100)
    y += 1e-4 * np.random.default_rng(0).normal(size=len(x))
    table = record_of(x, y, ("N", "V")).loops()
    truth = {"highest output": 2.5, "lowest output": 0.5, "output at lowest input": 0.5}
    for name, value in truth.items():
        off = np.abs(table[name].value - value) / table[name].error
        assert np.mean(off < 1.645) >= 0.75, name


def test_a_loop_that_does_not_close_counts_in_no_mean():
    """A play of 0.5 that gives 3 J between -2 and 2; the second loop ends at -1.2, and softens nothing."""
    turns = (-2, 2, -2, 2, -1.2, 1.5, -1.5, 2, -2, 2, -2)
    x = np.interp(np.arange(1001), np.arange(11) * 100, turns)
    force = [-1.5]
    for at in x[1:]:
        force.append(max(at - 0.5, min(at + 0.5, force[-1])))
    table = record_of(x, np.array(force), ("m", "N")).loops()
    assert table.full.tolist() == [True, False, False, False, True]
    assert np.isnan(table["softening"].value).all()
