"""Rigs of which no model is the whole: foam in layers, a plate frame, strain gauges, channel geometry."""

from dataclasses import replace

import numpy as np
import pytest

from hysteresis.internal import ChannelGeometryRig, FoamBlock, GaugeSensor, force_path
from hysteresis.rigs import ArmorRig


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
    assert frame.compliance(at, half, top) == pytest.approx(
        [1e3 * 0.0116 * 0.25 / D, 0, 0], rel=2e-3
    )
    free, held = frame.compliance(np.array([[0, -0.24], [0, 0.24]]), half[:2], ~top[:2])
    assert free > 50 * held


def test_a_skin_by_geometry_gives_and_takes_with_time():
    rig = ChannelGeometryRig(seed=1)
    force = np.zeros((400, 5))
    force[:200, 2] = 5.0
    held = rig.follow(force, dt=0.02)[:, 0]
    assert held[199] > held[20] > 0
    assert 0 < held[399] < 0.02 * held[199]
