"""Errors of an armor in presses that it has not seen are those of a calibration without each of them."""

import jax
import jax.numpy as jnp
import numpy as np

from compensate.armor import Armor, Box, ContactSolver, Presses, WristSensor
from compensate.internal import PressResiduals, missed_of, with_slip, without_each
from hysid.armor._calibration import spread_of_unseen
from hysteresis import LinearSponge
from hysteresis.rigs import INWARD
from identify.internal import calibrate

BOX = Box(0.3, 0.3, 0.55)
ARMOR = Armor(WristSensor(), ContactSolver(BOX, LinearSponge(K=1.3, b=2.0, threshold=0.5)))
FREE = {"sensor.matrix": 0.03}
STUDENT_4 = 2.131847 / 1.644854


def pressed() -> Presses:
    """Four middles of sides, read by a sensor with crosstalk and noise."""
    random, surface = np.random.default_rng(3), np.arange(1, 5)
    force = np.tile([4.0, 12.0, 8.0], (4, 1))
    touched, normal = np.asarray(BOX.centres())[:4], INWARD[:4]
    depth = 1e-3 * (1.3 * force + 2.0)
    at = touched[:, None] + depth[..., None] * normal[:, None]
    pushed = force[..., None] * normal[:, None]
    load = np.concatenate([pushed, np.cross(at, pushed)], axis=-1)
    read = load @ (np.eye(6) + 0.02 * random.normal(size=(6, 6))).T
    read += random.normal(size=read.shape) * np.repeat([0.03, 0.006], 3)
    return Presses(np.arange(1.0, 4.0), read, force, normal, touched, surface)


def without(presses: Presses, k: int) -> Presses:
    return jax.tree.map(lambda x: np.delete(x, k, axis=0), presses)


def test_they_are_those_of_calibrations_without_a_press():
    presses = pressed()
    residuals = PressResiduals(presses, jnp.repeat(jnp.array([0.03, 0.006]), 3))
    found = spread_of_unseen(calibrate(ARMOR, residuals, FREE), residuals, [])
    squares = []
    for k in range(4):
        others = PressResiduals(without(presses, k), residuals.noise)
        one = calibrate(ARMOR, others, FREE).system
        missed = missed_of(one, jax.tree.map(lambda x, k=k: x[k], presses))
        squares.append(np.mean(np.asarray(missed.wrench) ** 2, axis=0))
    wanted = STUDENT_4 * np.sqrt(np.mean(squares, axis=0))
    # The residuals are linear in the matrix; the search ends within 1e-8.
    np.testing.assert_allclose(found.noise, wanted, rtol=1e-5)
    assert found.depth is None
    assert (found.noise > np.repeat([0.03, 0.006], 3)).any()


def test_slip_without_a_press_is_found_from_the_others():
    presses, full = pressed(), np.repeat([50.0, 12.0], 3)
    found = without_each(ARMOR, presses, full)[2].sensor
    wanted = with_slip(ARMOR, without(presses, 2), full).sensor
    np.testing.assert_allclose(found.matrix, wanted.matrix, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found.slip.weights, wanted.slip.weights, atol=1e-10)
