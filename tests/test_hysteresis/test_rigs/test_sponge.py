"""The virtual sponge rig, and the data sets it wrote."""

import csv
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks import datasets
from hysteresis import InputError
from hysteresis.rigs import SpongeRig

RIG = SpongeRig()
CYCLE = [*np.arange(0.0, 20.0, 2.0), *np.arange(20.0, -1.0, -2.0)]


def test_reproduces_the_paper():
    """Tsuji et al. 2014: gaps in mm, K in mm/N and b in mm of the fit to both branches."""
    of = RIG.five_cycles().statistics()
    # The rig was tuned to these to the digits printed: half of the last one.
    assert of.mean_gap == pytest.approx(3.93, abs=0.005)
    assert of.largest_gap == pytest.approx(5.67, abs=0.005)
    assert (of.largest_gap_force, of.largest_gap_cycle) == (8.0, 1)
    # K to its last digit; b is the one compromise, 0.008 mm low, a sixth of a reading's noise.
    assert abs(of.both.K - 1.298) < 0.0005
    assert abs(of.both.b - 6.186) < 0.01


def test_loses_the_work_that_flexible_foam_loses():
    """30 to 38 % in the first cycle, less and steady afterwards: bonds break and stay broken."""
    loss = RIG.five_cycles().statistics().loss
    assert 0.30 < loss[0] < 0.38
    assert np.all(loss[1:] < loss[0] - 0.04)
    assert np.ptp(loss[2:]) < 0.001  # measured 0.0001


@pytest.mark.parametrize(("thickness", "nonlinear"), [(50.0, False), (30.0, False), (10.0, True)])
def test_only_the_thinnest_block_is_strongly_nonlinear(thickness: float, nonlinear: bool):
    """The paper's finding; measured 3.4, 3.4 and 7.9 % of the range on the first loading."""
    force = np.arange(2.0, 21.0, 2.0)
    d = SpongeRig(thickness_mm=thickness).follow(force)
    off = d - np.polyval(np.polyfit(force, d, 1), force)
    assert (np.max(np.abs(off)) > 0.05 * np.ptp(d)) == nonlinear


def test_thickness_scales_the_linear_regime_as_the_law_says():
    """At equal strain F goes as (50/h)^(q-1), if neither densification nor f adds its own."""
    thick = replace(RIG, friction_n=1e-12, densification_n_per_mm2=1e-12)
    thin = replace(thick, thickness_mm=25.0)
    # The two 1e-12 stand for zero; each root is found to 1e-12 mm, over 80 of them.
    force = np.array(CYCLE)
    np.testing.assert_allclose(
        2 * thin.follow(force * 2**-0.4), thick.follow(force), rtol=0, atol=1e-9
    )


forces = st.lists(st.floats(0.0, 40.0), min_size=1, max_size=12)


@given(forces)
def test_stays_inside_the_block(path: list[float]):
    d = RIG.follow(path)
    assert np.all((d >= 0) & (d < 50))


def test_substeps_are_finer_sampling():
    """`substeps` means nothing else than the ramp's own samples in between."""
    fine = np.interp(np.arange(4 * len(CYCLE) - 3) / 4, np.arange(len(CYCLE)), CYCLE)
    np.testing.assert_allclose(
        RIG.follow(fine, dt=1.5, substeps=1)[::4],
        RIG.follow(CYCLE, dt=6.0, substeps=4),
        rtol=0,
        atol=1e-10,  # roots to 1e-12, over 84 of them
    )


def test_refining_the_substeps_converges_at_second_order():
    limit = RIG.follow(CYCLE, substeps=64)
    error = [np.max(np.abs(RIG.follow(CYCLE, substeps=n) - limit)) for n in (2, 4, 8)]
    assert error[1] < 0.002  # the default's 1 um, as documented
    assert all(coarse > 3 * fine for coarse, fine in pairwise(error))


def test_unloaded_block_comes_back():
    """It is left indented, creeps back monotonically, and has forgotten all but its first cycle."""
    d = RIG.follow([*CYCLE, *np.zeros(200)])
    rest = d[len(CYCLE) - 1 :]
    assert rest[0] > 2
    assert np.all(np.diff(rest) <= 0)
    assert rest[-1] < 0.001


def test_loops_lag_and_rest_is_rest():
    cycle = RIG.five_cycles()
    assert np.all(cycle.statistics().loss > 0)
    assert np.all(RIG.follow(np.zeros(5)) == 0)
    assert np.all(np.diff(RIG.follow(np.full(20, 15.0))) > 0)  # creep


def test_noise_is_the_seeds():
    quiet = RIG.five_cycles().displacement
    one = RIG.five_cycles(noise=0.05, seed=1).displacement
    np.testing.assert_array_equal(one, RIG.five_cycles(noise=0.05, seed=1).displacement)
    assert not np.array_equal(one, RIG.five_cycles(noise=0.05, seed=2).displacement)
    assert np.std(one - quiet) == pytest.approx(0.05, rel=0.25)  # 101 readings: 3.5 sigma


@pytest.mark.parametrize(
    "bad",
    [
        lambda: SpongeRig(thickness_mm=-50.0),
        lambda: SpongeRig(thickness_mm=float("nan")),
        lambda: SpongeRig(friction_gain=1.5),
        lambda: SpongeRig(strut_share=(0.5, 0.5)),
        lambda: SpongeRig(strut_share=(0.5, 0.5, 0.5)),
        lambda: SpongeRig(relaxation_s=(4.0, -40.0)),
        lambda: RIG.follow([1.0, -1.0]),
        lambda: RIG.follow([1.0, 41.0]),
        lambda: RIG.follow([1.0, float("nan")]),
        lambda: RIG.follow([[1.0]]),
        lambda: RIG.follow([1.0], dt=0.0),
        lambda: RIG.follow([1.0], substeps=0),
        lambda: SpongeRig(densification_mm=60.0).follow([40.0]),
        lambda: RIG.five_cycles(peak=20.0, step=3.0),
        lambda: RIG.five_cycles(step=-2.0),
        lambda: RIG.five_cycles(noise=-0.1),
    ],
)
def test_bad_arguments_are_refused_with_a_remedy(bad):
    with pytest.raises(InputError) as caught:
        bad()
    assert caught.value.fix
    assert caught.value.code == "bad-option"


@pytest.mark.thorough
def test_data_sets_are_byte_for_byte_what_the_rig_writes():
    for path, text in datasets.made():
        assert path.read_bytes() == text.encode(), path.name


def test_every_data_set_has_an_author_and_a_card():
    stems = {path.stem for path in datasets.FOLDER.iterdir() if path.name != "catalogue.toml"}
    assert stems == set(datasets.TABLES)


def read(stem: str) -> tuple[list[str], np.ndarray]:
    with (datasets.FOLDER / f"{stem}.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    return header, np.array(rows, float)


def test_shipped_cycles_have_the_papers_statistics_within_their_noise():
    header, table = read("sponge-50mm-cycles")
    assert header == ["time (s)", "force (N)", "displacement (mm)", "cycle"]
    of = type(SpongeRig().five_cycles())(*table.T).statistics()
    sd = datasets.READING_NOISE
    # Three standard errors each: the mean of 45 differences, the largest one's own difference,
    # a line through 100 points whose forces have standard deviation 5.7 N about 11 N.
    assert of.mean_gap == pytest.approx(3.93, abs=3 * sd * np.sqrt(2 / 45))
    assert of.largest_gap == pytest.approx(5.67, abs=3 * sd * np.sqrt(2))
    assert (of.largest_gap_force, of.largest_gap_cycle) == (8.0, 1)
    assert abs(of.both.K - 1.298) < 3 * sd / 10 / 5.7
    assert abs(of.both.b - 6.186) < 3 * sd / 10 * np.hypot(1, 11 / 5.7)


def test_shipped_minor_loops_hold_what_their_card_says():
    header, table = read("sponge-50mm-minor-loops")
    assert header == ["time (s)", "force (N)", "displacement (mm)", "loop"]
    time, force, _, loop = table.T
    assert set(np.diff(time)) == {1.5}
    assert set(np.abs(np.diff(force))) == {0.5}
    for n, turns in enumerate(datasets.MINOR_LOOPS, start=1):
        path = np.concatenate([[0.0], force[loop == n]]) if n > 1 else force[loop == 1]
        turning = np.flatnonzero(np.diff(np.sign(np.diff(path)))) + 1
        np.testing.assert_array_equal(path[[0, *turning, -1]], turns)
