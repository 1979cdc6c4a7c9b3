"""Turning points, branches and cycles; what changes between cycles, and jumps and drift of the zero."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import hysid
from hysteresis import InputError, Record, read_csv
from hysteresis.internal import check_identifiable
from hysteresis.records._change import change
from hysteresis.records._cycles import noise_level
from tests.problems import play
from tests.refusals import refuses
from tests.thorough import rest_thorough


def cycles(u: np.ndarray) -> np.ndarray:
    """The cycle of each row, 0 where it is in none."""
    return Record.from_arrays(u, u).cycle


def branches(u: np.ndarray) -> np.ndarray:
    return Record.from_arrays(u, u).branch


def triangles(n_cycles: int, samples: int) -> np.ndarray:
    """`n_cycles` triangles 0 -> 1 -> 0, `samples` samples a leg."""
    turns = np.arange(2 * n_cycles + 1)
    return np.interp(np.arange(2 * n_cycles * samples + 1), samples * turns, turns % 2)


def test_triangle_wave_by_hand():
    u = np.array([0, 1, 2, 1, 0, 1, 2, 1, 0], float)
    assert branches(u).tolist() == [1, 1, 1, -1, -1, 1, 1, -1, -1]
    assert cycles(u).tolist() == [1, 1, 1, 1, 1, 2, 2, 2, 2]


@pytest.mark.parametrize("n", range(4))
def test_short_and_constant_sequences(n):
    u = np.zeros(n)
    assert (cycles(u).tolist(), branches(u).tolist()) == ([0] * n, [1] * n)


def test_slow_ramp_and_hold_after_the_last_cycle_belong_to_none():
    u = np.concatenate([np.zeros(50), triangles(3, 40), np.linspace(0, 1, 300), np.ones(200)])
    c = cycles(u)
    assert c.max() == 3
    assert np.all(c[:50] == 1)
    assert np.all(c[50 + 242 :] == 0)  # the trough is two samples long


@pytest.mark.parametrize(("end", "complete"), [(0.1, 1), (0.45, 1), (0.55, 0), (0.95, 0)])
def test_the_last_cycle_must_come_half_way_back(end, complete):
    u = np.concatenate([np.linspace(0, 1, 50), np.linspace(1, end, 50)[1:]])
    assert cycles(u).max() == complete


@given(st.integers(1, 12), st.integers(15, 60), st.floats(0, 0.02), st.integers(0, 2**32 - 1))
def test_the_default_dead_band_survives_gaussian_noise(n_cycles, samples, sd, seed):
    u = triangles(n_cycles, samples)
    assert cycles(u + np.random.default_rng(seed).normal(0, sd, len(u))).max() == n_cycles


@given(st.integers(4, 60), st.integers(1, 10))
def test_coarse_sines_keep_their_cycles(samples, n_cycles):
    u = -np.cos(2 * np.pi * np.arange(n_cycles * samples + 1) / samples)
    assert cycles(u).max() == n_cycles


def test_foam_has_six_cycles_and_a_tail_in_none(measured_data: Path):
    path = measured_data / "foam-midsole-compression" / "tidy.csv"
    rows = np.genfromtxt(path, delimiter=",", skip_header=1, dtype=None, encoding="utf-8")
    samples = rows["f0"]
    for sample in np.unique(samples):
        for column in ("f2", "f3"):  # compression; force
            assert cycles(rows[column][samples == sample]).max() == 6, (sample, column)


def test_noise_level_finds_white_noise_on_a_smooth_signal():
    rng, u = np.random.default_rng(5), np.sin(np.linspace(0, 60, 20_000))
    assert noise_level(u) < 1e-6
    # Smallest of five estimates, each good to about 1 % at 20,000 samples.
    assert noise_level(u + rng.normal(0, 0.01, len(u))) == pytest.approx(0.01, rel=0.05)
    long = np.sin(np.linspace(0, 500, 1_500_000))
    assert noise_level(long + rng.normal(0, 0.01, len(long))) == pytest.approx(0.01, rel=0.01)


SPONGE = Path(__file__).parents[3] / "datasets" / "sponge-50mm-cycles.csv"
COLUMNS = {"input": "force (N)", "output": "displacement (mm)", "time": "time (s)"}


# The figures of the card beside the file, to its last digit.
@pytest.mark.parametrize(
    ("branch", "K", "b"),
    [("loading", 1.3821, 3.480), ("both", 1.2981, 6.174), ("unloading", 1.2142, 8.869)],
)
def test_the_three_published_approximations(branch: str, K: float, b: float):
    record, _ = hysid.records(SPONGE, **COLUMNS, branch=branch, range=(2.0, 20.0))[""]
    fit = hysid.fit(record, "LinearSponge", conditioning="keep", noise="gaussian")
    found = {one.name: one.value for one in fit.parameters}
    assert (round(found["K"], 4), round(found["b"], 3)) == (K, b)
    assert np.asarray(fit.model.trained).tolist() == [2.0, 20.0]


def test_a_turning_sample_belongs_to_both_branches():
    u = np.array([0.0, 1, 2, 2, 1, 0, 1, 2, 1])
    record = hysid.Record.from_arrays(u, u + 0.1, groups=["a"] * 6 + ["b"] * 3)
    rising = record.select("loading").mask.tolist()
    falling = record.select("unloading").mask.tolist()
    assert rising == [True, True, True, True, False, False, True, True, False]
    assert falling == [False, False, False, True, True, True, False, True, True]
    both = record.select("both")
    assert both.labels == ("a loading", "a unloading", "b loading", "b unloading")
    assert both.mask.sum() == sum(rising) + sum(falling)
    np.testing.assert_array_equal(both.input, np.r_[u[:6], u[:6], u[6:], u[6:]])


def test_ranges_and_branches_that_are_none_are_refused():
    record = hysid.Record.from_arrays([0.0, 1, 2, 1], [0.0, 1, 2, 1])
    for span, code in (((2.0, 1.0), "zero-range"), ((5.0, 6.0), "no-rows")):
        refuses(code, lambda span=span: record.select(range=span))
    refuses("zero-range", lambda: hysid.records(SPONGE, **COLUMNS, range=(2.0,)))


def cycled(per_cycle: float, cycles: int = 8, noise: float = 0.01) -> Record:
    """A loop of 1 N over 10 mm whose zero moves at a steady rate."""
    t = np.linspace(0, cycles, 60 * cycles + 1)
    u = 5 - 5 * np.cos(2 * np.pi * t)
    y = u + 0.5 * np.sin(2 * np.pi * t) + per_cycle * t
    y += np.random.default_rng(0).normal(0, noise, len(t))
    return Record.from_arrays(u, y, t, input_unit="mm", output_unit="N", output_name="force")


def test_of_four_cycles_chance_seldom_makes_a_rate():
    random, t = np.random.default_rng(1), np.linspace(0, 4, 81)
    u = 5 - 5 * np.cos(2 * np.pi * t)
    found = [change(Record.from_arrays(u, u + random.normal(size=81), t)) for _ in range(400)]
    assert sum(one is not None and one.is_sure for one in found) <= 12  # 4 expected, 3 in a hundred


def test_of_very_many_cycles_some_tell_the_rate():
    u = np.append(np.tile([0.0, 1.0, 2.0, 1.0], 20_000), 0.0)
    found = change(Record.from_arrays(u, u + 1e-4 * np.arange(len(u))))
    assert found.rate == pytest.approx(4e-4)
    assert (found.first, found.last) == (1, 20_000)


def test_a_zero_that_moves_far_is_told_first():
    (first, *_) = check_identifiable(cycled(0.3))
    assert first.code == "zero-moves"
    assert first.values["moved"] == pytest.approx(2.1, rel=0.05)
    assert all(note.code != "zero-moves" for note in check_identifiable(cycled(0.05)))


def test_a_sign_is_turned_and_said(tmp_path):
    record, file = cycled(0.0), tmp_path / "run.csv"
    rows = zip(record.input, record.output, strict=True)
    file.write_text("x,force\n" + "".join(f"{float(u)!r},{float(y)!r}\n" for u, y in rows))
    back = read_csv(file, "x", "force", turn=["force"])
    np.testing.assert_array_equal(back.output, -record.output)
    np.testing.assert_array_equal(back.input, record.input)
    assert "Turned the sign of 'force'." in back.history
    with pytest.raises(InputError, match="'torque' is not used"):
        read_csv(file, "x", "force", turn=["torque"])
    columns = {"x (mm)": record.input, "F (N)": record.output}
    fit = hysid.fit(
        columns, input="x (mm)", output="F (N)", turn="F (N)", model="LinearSponge",
        noise="gaussian", starts=1,
    )  # fmt: skip
    np.testing.assert_array_equal(fit.train.output, -record.output)


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


def said(u: np.ndarray, y: np.ndarray, **more: Any) -> dict[str, Any]:
    """What is said of the zero, by its code; lines are rows, from 0."""
    record = Record.from_arrays(u, y, 0.1 * np.arange(len(u)), line=np.arange(len(u)), **more)
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
    pressure = np.linspace(1, 2, len(u))  # which may be what moved it
    assert not said(u, y, columns={"p": pressure}, conditions={"p": "bar"})


@given(SEEDS, st.floats(0.1, 0.5))
def test_a_drift_of_the_input_is_none_of_the_output(seed: int, share: float):
    """The load returns to zero in every cycle, while the sensor's reading drifts away."""
    load = np.maximum(motion(seed) - np.median(motion(seed)), 0)
    reading = loop(load, seed) + share * np.ptp(load) * np.linspace(0, 1, len(load))
    assert not said(reading, load)


@given(SEEDS, st.floats(15, 40))
def test_small_loops_on_either_branch_move_no_zero(seed: int, radius: float):
    """They pass the same inputs, and the larger loop around them sets the output."""
    way = np.array([0, 25, 5, 50, 30, 75, 55, 100, 75, 95, 50, 70, 25, 45] * 4, float)
    u = np.interp(np.arange(40 * len(way) - 39), 40 * np.arange(len(way)), way)
    y = (u - play(u, radius)) / radius + 0.002 * u
    assert not said(u, y + 0.01 * np.random.default_rng(seed).normal(size=len(u)))


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
    rng, u = np.random.default_rng(seed), motion(seed)
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
