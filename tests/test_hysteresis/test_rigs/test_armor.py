"""Virtual armors: of sponge and box as the paper has it, and of foam on a frame that gives."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hysteresis.internal import ChannelGeometryRig, FoamBlock, ForceSensor, GaugeSensor, force_path
from hysteresis.rigs import INWARD, ArmorRig, SpongeRig
from tests.refusals import refuses

EXACT = ForceSensor(crosstalk=0, hysteresis=0, noise_n=0, noise_nm=0)
LINES = SpongeRig().five_cycles().statistics()
RIGS = range(100, 112)
"""Seeds that nothing is tuned on."""


def located(rig: ArmorRig, presses: Any, K: float = 0.0, b: float = 0.0) -> np.ndarray:
    """Errors in mm: the line of action r + t F, cut with the known surface at the depth K F_n + b.

    Written here and not taken from the solver, which these data will be used to judge.
    """
    F, M = np.split(presses.wrench[:, -1], 2, axis=1)
    n = INWARD[presses.surface - 1]
    dx, dy, dz1, _ = rig.size
    offset = np.array([dz1, dy, dy, dx, dx])[presses.surface - 1]
    r = np.cross(F, M) / np.sum(F * F, axis=1, keepdims=True)
    pushing = np.sum(n * F, axis=1)
    depth = 1e-3 * (K * pushing + b) - offset - np.sum(n * r, axis=1)
    found = r + (depth / pushing)[:, None] * F
    return 1e3 * np.linalg.norm(found - presses.contact[:, -1], axis=1)


def test_contact_errors_are_the_papers():
    """Tsuji et al. 2014, fig 14: 27.2, 16.3 and 13.2 mm; this rig's forerunner had 28.1, 15.2 and
    13.2 with standard deviations of 1.9, 2.3 and 3.0 from rig to rig."""
    found = []
    for seed in RIGS:
        soft, rigid = ArmorRig(seed=seed), ArmorRig(seed=seed, soft=False)
        presses, bare = (rig.press(*rig.points_of_the_body()) for rig in (soft, rigid))
        both = LINES.both
        errors = located(soft, presses), located(soft, presses, *both), located(rigid, bare)
        found.append([e.mean() for e in errors])
    mean, sd = np.mean(found, axis=0), np.array([1.9, 2.3, 3.0])
    # Of twelve rigs the mean is uncertain by 0.3 sd; the play may add the rest.
    np.testing.assert_array_less(np.abs(mean - [28.1, 15.2, 13.2]), sd)
    np.testing.assert_array_less(np.abs(mean - [27.2, 16.3, 13.2]), 2 * sd)


def test_approximations_err_as_the_papers_do():
    """Fig 12: 1.7, 3.3 and 4.7 mm on average, none above 10 mm; this rig: 1.83, 3.26, 4.69 and 6.4."""
    off = []
    for seed in RIGS:
        rig = ArmorRig(seed=seed)
        d = 1e3 * rig.press(*rig.points_of_surface_1()).displacement[:, -1]
        lines = (LINES.loading, LINES.both, LINES.unloading)
        off.append([np.abs(15 * K + b - d) for K, b in lines])
    # 0.6 mm of scatter over 76 points and 12 rigs: 0.02 mm; of a rig's largest 0.28 mm: 0.08.
    np.testing.assert_allclose(np.mean(off, axis=(0, 2)), [1.83, 3.26, 4.69], atol=0.06)
    assert np.mean(np.max(off, axis=(1, 2))) == pytest.approx(6.4, abs=0.25)
    assert np.max(off) < 10


histories = st.lists(st.floats(0.0, 40.0), min_size=1, max_size=6)
faces = st.integers(1, 5)
offsets = st.floats(-0.2, 0.2)


@given(histories, faces, offsets, offsets, offsets, st.booleans())
def test_records_obey_statics(force, surface, u, v, slope, soft):
    """Without the sensor's errors the reading is f u and P^e x f u, and P^e = P^i + d n."""
    rig = ArmorRig(soft=soft, sensor=EXACT)
    middle = np.array([0, 0, rig.size.dz1 / 2])
    normal, lateral = INWARD[surface - 1], INWARD[surface - 1] == 0
    point = middle - normal * [rig.size.dx, rig.size.dy, rig.size.dz1 / 2]
    point[lateral] += [u, v]
    direction = normal + slope * np.roll(normal, 1)
    made = rig.press([point], [surface], force, direction=[direction])
    F, M = np.split(made.wrench[0], 2, axis=1)
    np.testing.assert_array_equal(made.wrench, made.load)
    expected = np.outer(force, made.direction[0])
    np.testing.assert_allclose(made.direction[0], direction / np.linalg.norm(direction), rtol=1e-15)
    # Rounding: forces to 40 N, moments to 40 N m, both of magnitude 2^6.
    np.testing.assert_allclose(F, expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(M, np.cross(made.contact[0], F), rtol=0, atol=1e-13)
    shift = made.contact[0] - made.touched[0]
    np.testing.assert_allclose(shift, made.displacement[0][:, None] * normal, rtol=0, atol=1e-15)
    if not soft:
        assert np.all(made.displacement == 0)


RIG = ArmorRig()
TOP = RIG.points_of_surface_1()._replace(points=np.array([[0.0, 0.0, 0.55]]), surface=np.array([1]))


@pytest.mark.parametrize("bad", [
    lambda: ArmorRig(seed=-1), lambda: ArmorRig(sheet=0.0),
    lambda: ArmorRig(scatter_mm=float("nan")), lambda: ForceSensor(crosstalk=-0.1),
    lambda: ForceSensor(full_scale_n=0.0), lambda: ForceSensor(hysteresis=0.1, travel=0.05),
    lambda: RIG.press([[0.0, 0.0, 550.0]], [1]), lambda: RIG.press([[0.4, 0.0, 0.55]], [1]),
    lambda: RIG.press([[0.0, 0.0, 0.55]], [2]), lambda: RIG.press([[0.0, 0.0, 0.55]], [6]),
    lambda: RIG.press([[0.0, 0.0, float("nan")]], [1]), lambda: RIG.press([0.0, 0.0, 0.55], [1]),
    lambda: RIG.press(*TOP, [41.0]), lambda: RIG.press(*TOP, [-1.0]), lambda: RIG.press(*TOP, []),
    lambda: RIG.press(*TOP, [[1.0], [2.0]]), lambda: RIG.press(*TOP, dt=0.0),
    lambda: RIG.press(*TOP, direction=[[0.0, 0.0, 1.0]]), lambda: RIG.random_points(0),
    lambda: RIG.random_points(5, margin=0.3), lambda: force_path(()),
])  # fmt: skip
def test_bad_arguments_are_refused_with_a_remedy(bad):
    refuses("bad-option", bad, "Fix: ")


def test_a_sponge_that_has_aged_is_softer():
    path = force_path((0.0, 20.0, 0.0), 2.0)
    fresh, aged = (block.follow(path) for block in (FoamBlock(), FoamBlock().at_age(0.05)))
    assert (aged[:10] > fresh[:10]).all()


def test_the_foam_has_the_papers_figures():
    found = FoamBlock().five_cycles().statistics()
    assert found.mean_gap == pytest.approx(3.93, abs=0.01)
    assert found.largest_gap == pytest.approx(5.67, abs=0.01)
    assert (found.largest_gap_force, found.largest_gap_cycle) == (8.0, 1)
    assert pytest.approx(1.298, abs=0.001) == found.both.K
    assert found.both.b == pytest.approx(6.186, abs=0.01)


@pytest.mark.parametrize("seed", range(5))
def test_the_sensor_keeps_its_data_sheet(seed: int):
    """1 % of full scale of hysteresis and of nonlinearity on each axis, and crosstalk beside them."""
    sensor = GaugeSensor(noise_n=1e-12, noise_nm=1e-12)
    specimen = sensor.specimen(np.random.default_rng([seed, 0]))
    level = force_path((0.0, 1.0, -1.0, 1.0), 0.05)
    load = level[:, None] * np.eye(6)[:, None] * sensor.full_scale
    shown = sensor.read(load, specimen, np.random.default_rng(0)) / sensor.full_scale
    down, up = level[19:60], level[59:]
    np.testing.assert_allclose(down, up[::-1], atol=1e-12)
    for k in range(6):
        one, other = shown[k, 59:, k], shown[k, 19:60, k][::-1]
        assert np.abs(one - other).max() <= 0.0101
        middle = (one + other) / 2
        assert np.abs(middle - np.polyval(np.polyfit(up, middle, 1), up)).max() <= 0.01
    assert np.abs(np.delete(shown[2], 2, axis=1)).max() > 1e-3


def test_a_plate_sags_as_navier_says():
    """Square and supported all round: w = 0.0116 F a^2/D in the middle; nothing at the edges."""
    frame = replace(ArmorRig.of_foam(3).frame, modes=30)
    half, top = np.full((3, 2), 0.25), np.zeros(3, bool)
    at = np.array([[0, 0], [0.25, 0.1], [0.1, -0.25]])
    D = 3e9 * 5e-3**3 / (12 * (1 - 0.37**2))
    sag = 1e3 * 0.0116 * 0.25 / D
    assert frame.compliance(at, half, top) == pytest.approx([sag, 0, 0], rel=2e-3)
    free, held = frame.compliance(np.array([[0, -0.24], [0, 0.24]]), half[:2], ~top[:2])
    assert free > 50 * held


def test_a_skin_by_geometry_gives_and_takes_with_time():
    rig, force = ChannelGeometryRig(seed=1), np.zeros((400, 5))
    force[:200, 2] = 5.0
    held = rig.follow(force, dt=0.02)[:, 0]
    assert held[199] > held[20] > 0
    assert 0 < held[399] < 0.02 * held[199]
