"""Jumps, drift and loss of the zero are found and placed; what a specimen does is none of them."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hysteresis import InputError, Record, read_csv
from hysteresis.internal import check_identifiable
from tests.problems import play
from tests.thorough import rest_thorough

ZEROS = {"zero-jump", "zero-moves", "lost-contact"}
CYCLE = 100
"""Rows."""
SEEDS = st.integers(0, 1000)


def motion(seed: int, cycles: int = 6) -> np.ndarray:
    """Triangles from 0 to peaks of 70 to 100."""
    peaks = np.random.default_rng(seed).uniform(70, 100, cycles)
    return np.concatenate([peak * (1 - np.abs(np.linspace(-1, 1, CYCLE))) for peak in peaks])


def loop(u: np.ndarray, seed: int) -> np.ndarray:
    """A bent loop, of 0 to some 3, with noise of 0.1 % of it."""
    y = 0.01 * u + 0.01 * play(u, 8.0) + 1e-4 * u * u
    return y + 0.003 * np.random.default_rng(seed).normal(size=len(u))


def said(u: np.ndarray, y: np.ndarray) -> dict[str, Any]:
    """What is said of the zero, by its code; lines are rows, from 0."""
    record = Record.from_arrays(u, y, 0.1 * np.arange(len(u)), line=np.arange(len(u)))
    return {note.code: note.values for note in check_identifiable(record) if note.code in ZEROS}


@given(
    SEEDS, st.floats(0.1, 0.5), st.sampled_from([-1, 1]), st.floats(0.2, 0.8),
    st.sampled_from([(1.0, 1.0), (1e-6, 1e9), (25.4, -0.001)]), st.floats(-3, 3),
)  # fmt: skip
def test_a_jump_is_placed_and_sized_in_any_unit(seed, share, sign, place, units, offset):
    u = motion(seed)
    y = loop(u, seed)
    row, size = int(place * len(u)), sign * share * np.ptp(y)
    y[row:] += size
    a, b = units
    (jump,) = said(a * (u + offset), b * (y + offset))["zero-jump"]["jumps"]
    assert jump["line"] == row
    assert jump["size"] == pytest.approx(b * size, abs=0.05 * abs(b) * np.ptp(y))


@given(SEEDS, st.floats(0.1, 0.5), st.sampled_from([-1, 1]))
def test_a_drift_is_sized_among_loops_of_any_size(seed: int, share: float, sign: int):
    u = motion(seed)
    y = loop(u, seed)
    size = sign * share * np.ptp(y)
    y += size * np.linspace(0, 1, len(u))
    found = said(u, y)
    assert found.keys() == {"zero-moves"}
    # Where cycles are compared, the first and the last of their size may lie well inside of the record.
    assert 0.5 < found["zero-moves"]["moved"] / size < 1.2


@given(SEEDS, st.floats(0.1, 0.5))
def test_a_drift_of_the_input_is_none_of_the_output(seed: int, share: float):
    """The load returns to zero in every cycle, while the sensor's reading drifts away."""
    load = np.maximum(motion(seed) - np.median(motion(seed)), 0)
    reading = loop(load, seed) + share * np.ptp(load) * np.linspace(0, 1, len(load))
    assert not said(reading, load)


@given(SEEDS, st.floats(0.15, 0.7), st.booleans(), st.sampled_from([0.0, 1.5]))
def test_lost_contact_is_placed(seed: int, place: float, regained: bool, zero: float):
    """The zero is the first reading, or 0."""
    u = motion(seed)
    first = int(place * len(u))
    last = first + CYCLE - 1 if regained else len(u) - 1
    y = loop(u, seed) + zero
    y[first : last + 1] = zero + 0.003 * np.random.default_rng(seed).normal(size=last + 1 - first)
    notes = said(u, y)
    assert notes.keys() == {"lost-contact"}
    found = notes["lost-contact"]
    # What is read in contact may be the zero, too.
    assert abs(found["first"] - first) <= 0.15 * CYCLE
    assert abs(found["last"] - last) <= 0.15 * CYCLE
    assert found["zero"] == pytest.approx(zero, abs=0.02)
    assert found["stretches"] == 1


def _snap(u: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A snap-through at an input that varies from cycle to cycle."""
    state, found, at = 0, np.empty(len(u)), (60.0, 30.0)
    for k, x in enumerate(u):
        if (x > at[0]) if not state else (x < at[1]):
            state, at = 1 - state, (rng.uniform(55, 65), rng.uniform(25, 35))
        found[k] = 0.02 * x + 0.8 * state
    return found


def _relay(u: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return _snap(u, rng) - 0.02 * u


def _stick_slip(u: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A slide that sticks within a band, drawn anew at every slip."""
    at, band, found = u[0], 12.0, np.empty(len(u))
    for k, x in enumerate(u):
        if abs(x - at) > band:
            at, band = x - 0.3 * band * np.sign(x - at), rng.uniform(6, 18)
        found[k] = at
    return found


def _magnetic(u: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.tanh((u - 40 - 15 * np.sign(np.gradient(u))) / 1.5)


def _friction(u: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.sign(np.gradient(u)) + 0.002 * u


def _backlash(u: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return play(u, 12.0)


def _quantised(u: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.round(play(u, 5.0) / 8)


def _dead_band(u: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """No contact below 40 in any cycle."""
    return np.maximum(u - 40, 0) ** 1.5


def _outlier(u: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    y = play(u, 5.0)
    y[rng.integers(20, len(u) - 20)] += 40
    return y


SPECIMENS = [
    _snap, _relay, _stick_slip, _magnetic, _friction, _backlash, _quantised, _dead_band, _outlier,
]  # fmt: skip


@pytest.mark.parametrize("specimen", rest_thorough(SPECIMENS, 3))
@given(SEEDS)
def test_what_a_specimen_does_by_itself_is_no_change_of_the_zero(specimen, seed):
    rng = np.random.default_rng(seed)
    u = motion(seed)
    y = specimen(u, rng)
    assert not said(u, y + 0.002 * np.ptp(y) * rng.normal(size=len(y)))


@given(SEEDS, st.integers(2, 10))
def test_steps_of_the_input_are_no_jumps(seed: int, steps: int):
    """Square waves and stairs: the output steps, creeps or relaxes after each."""
    rng = np.random.default_rng(seed)
    level = np.repeat(np.r_[0, rng.permutation(np.arange(1.0, steps + 1)), 0, steps, 0], 40)
    for u in (level, 10.0 * (level > steps / 2)):
        y, at = np.empty(len(u)), 0.0
        for k, x in enumerate(u):
            at += 0.05 * (x - at)
            y[k] = 2 * x - at + 0.01 * rng.normal()
        assert not said(u, y)


def test_a_jump_is_taken_out_by_its_line_and_only_when_asked(tmp_path):
    u, file = motion(3), tmp_path / "run.csv"
    y = loop(u, 3)
    y[250:] += 0.5
    text = "x (mm),F (N)\n" + "".join(f"{a:.6f},{b:.6f}\n" for a, b in zip(u, y, strict=True))
    file.write_text(text)
    record = read_csv(file, "x (mm)", "F (N)")
    note = next(n for n in check_identifiable(record) if n.code == "zero-jump")
    (jump,) = note.values["jumps"]
    assert jump["line"] == 252
    asked = f"252:{jump['size']:.4g}"
    assert f"--rezero {asked} " in note
    mended = read_csv(file, "x (mm)", "F (N)", rezero=[asked])
    assert mended.history[-1].code == "rezeroed"
    assert not ZEROS & {n.code for n in check_identifiable(mended)}
    np.testing.assert_allclose(mended.output[250:], record.output[250:] - float(asked[4:]))
    np.testing.assert_array_equal(mended.output[:250], record.output[:250])


def test_a_jump_ends_with_its_sequence_and_odd_ones_are_refused(tmp_path):
    file = tmp_path / "run.csv"
    file.write_text("x,y,run\n0,0,1\n1,0,1\n2,0,1\n3,0,2\n4,0,2\n5,0,2\n")
    two = read_csv(file, "x", "y", group="run", rezero=["3:3"])
    np.testing.assert_array_equal(two.output, [0, -3, -3, 0, 0, 0])
    for odd in ("2", "2:", "two:1", "2:nan", "2:1,5"):
        with pytest.raises(InputError, match="is not a line and the size of a jump"):
            read_csv(file, "x", "y", rezero=[odd])
    with pytest.raises(InputError, match="No row of the file is on line 9"):
        read_csv(file, "x", "y", rezero=["9:1"])
