"""The slip of a sensor's joints: what it corrects, sample by sample and at once, and how it is found."""

import equinox as eqx
import jax
import numpy as np
import pytest

from compensate.armor import Armor, Box, ContactSolver, Cover, Presses, WristSensor, export_armor
from compensate.internal import Slip, with_slip
from hysteresis import InputError, LinearSponge
from hysteresis.rigs import INWARD, ArmorRig
from tests.refusals import refuses

FULL = np.repeat([200.0, 20.0], 3)


@pytest.fixture(scope="module")
def rig() -> ArmorRig:
    return ArmorRig.of_foam(11)


@pytest.fixture(scope="module")
def armor(rig: ArmorRig) -> Armor:
    cover = Cover(LinearSponge(K=1.298, b=6.186, threshold=1.5))
    return Armor(WristSensor(), ContactSolver(Box(*rig.size), cover))


@pytest.fixture(scope="module")
def presses(rig: ArmorRig) -> Presses:
    points, surface = rig.random_points(20, seed=1)
    made, normal = rig.calibrate(points, surface), INWARD[surface - 1]
    return Presses(made.time, made.wrench, made.force, normal, points, surface, made.displacement)


def test_slip_is_found_where_no_axis_has_a_play_of_its_own(rig, armor, presses):
    """Wrenches at other points, beside the best matrix without slip."""
    found = with_slip(armor, presses, FULL)
    at = rig.press(*rig.points_of_the_body(), session=3)

    def left(sensor: WristSensor) -> float:
        wrench = jax.jit(jax.vmap(sensor.simulate, in_axes=(None, 0)))(at.time, at.wrench)
        off = np.concatenate([wrench.force, wrench.moment], axis=-1) - at.load
        return float(np.sqrt(np.mean((off / FULL)[:, -1] ** 2)))

    known = np.asarray(presses.readings).reshape(-1, 6)
    true = presses.force[..., None] * presses.direction[:, None]
    depth = presses.displacement[..., None] * presses.direction[:, None]
    touched = presses.touched[:, None] + depth
    load = np.concatenate([true, np.cross(touched, true)], axis=-1).reshape(-1, 6)
    matrix = np.linalg.lstsq(known, load, rcond=None)[0].T
    assert left(found.sensor) < 0.8 * left(WristSensor(matrix))


def test_what_cannot_be(armor: Armor, presses: Presses, tmp_path):
    refuses("wrong-shape", lambda: Slip(np.full(3, 50.0)), "full_scale")
    plays = [LinearSponge(K=1.0, b=0.0, threshold=0.0)] * 6
    sensor = WristSensor(hysteresis=plays)
    played = eqx.tree_at(lambda a: a.sensor, armor, sensor, is_leaf=lambda x: x is None)
    refuses("bad-option", lambda: with_slip(played, presses, FULL), "play")
    found = with_slip(armor, presses, FULL)
    with pytest.raises(InputError, match="not exported"):
        export_armor(found.solver, tmp_path / "armor.json", found.sensor)
