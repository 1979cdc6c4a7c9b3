"""Turning points, branches and cycles; fits of one branch; change from cycle to cycle."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import hysid
from hysteresis import InputError, Record, read_csv
from hysteresis.internal import check_identifiable
from hysteresis.records._change import change
from hysteresis.records._cycles import noise_level
from tests.refusals import refuses


def cycles(u: np.ndarray) -> np.ndarray:
    """The cycle of each row, 0 where it is in none."""
    return Record.from_arrays(u, u).cycle


def branches(u: np.ndarray) -> np.ndarray:
    return Record.from_arrays(u, u).branch


def triangles(n_cycles: int, samples: int) -> np.ndarray:
    """`n_cycles` triangles 0 -> 1 -> 0, `samples` samples a leg."""
    return np.interp(
        np.arange(2 * n_cycles * samples + 1),
        samples * np.arange(2 * n_cycles + 1),
        np.arange(2 * n_cycles + 1) % 2,
    )


def test_triangle_wave_by_hand():
    u = np.array([0, 1, 2, 1, 0, 1, 2, 1, 0], float)
    assert branches(u).tolist() == [1, 1, 1, -1, -1, 1, 1, -1, -1]
    assert cycles(u).tolist() == [1, 1, 1, 1, 1, 2, 2, 2, 2]


@pytest.mark.parametrize("n", range(4))
def test_short_and_constant_sequences(n):
    u = np.zeros(n)
    assert cycles(u).tolist() == [0] * n
    assert branches(u).tolist() == [1] * n


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
    rng = np.random.default_rng(5)
    u = np.sin(np.linspace(0, 60, 20_000))
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
    for options, code in (
        ({"range": (2.0, 1.0)}, "zero-range"),
        ({"range": (5.0, 6.0)}, "no-rows"),
    ):
        with pytest.raises(InputError, match=code):
            record.select(**options)
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
