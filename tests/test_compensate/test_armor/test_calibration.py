"""Calibration of an armor: recovery away from the truth, choice of presses, contacts' uncertainty."""

from functools import cache
from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from compensate.armor import (
    Armor,
    Box,
    Bumps,
    ContactSolver,
    Cover,
    Presses,
    WristSensor,
    planned_presses,
)
from compensate.internal import PressResiduals, UncertainArmor
from hysid import calibrate_armor, choose_presses
from hysteresis import InputError, LinearSponge, PrandtlIshlinskii

INWARD = np.array([[0, 0, -1], [0, -1, 0], [0, 1, 0], [-1, 0, 0], [1, 0, 0]], float)
NOISE = np.repeat([0.03, 0.006], 3)
SCATTER = 3e-4
BOX = Box(0.3, 0.3, 0.55, 0.0)
SPONGE = LinearSponge(K=1.3, b=2.0, threshold=0.5)


def plays(share: float, travel: float) -> list[PrandtlIshlinskii]:
    full = [50.0] * 3 + [12.0] * 3
    return [PrandtlIshlinskii(np.array([travel * f]), np.array([share]), 1.0) for f in full]


def armor(matrix, share: float, travel: float, factor: float, sag: float, width: float) -> Armor:
    cover = Cover(SPONGE, factor, Bumps(BOX.centres(), sag, width))
    sensor = WristSensor(matrix, hysteresis=plays(share, travel))
    return Armor(sensor, ContactSolver(BOX, cover))


@cache
def truth() -> Armor:
    G = 0.015 * np.random.default_rng(5).normal(size=(6, 6))
    G[:3, 3:] /= 0.25
    G[3:, :3] *= 0.25
    return armor(np.eye(6) + G, 0.1, 0.05, 0.94, 1e-4, 0.06)


def start() -> Armor:
    return armor(None, 0.05, 0.08, 1.0, 0.0, 0.09)


def places(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Anywhere on the box, and the middle of every surface."""
    random = np.random.default_rng(seed)
    surface = np.concatenate([np.arange(1, 6), random.integers(1, 6, count - 5)])
    at = random.uniform([-0.27, -0.27, 0.03], [0.27, 0.27, 0.52], (count, 3))
    at[:5] = np.asarray(BOX.centres())
    wall = np.array([0.55, 0.3, -0.3, 0.3, -0.3])[surface - 1]
    axis = np.array([2, 1, 1, 0, 0])[surface - 1]
    at[np.arange(count), axis] = wall
    return at, surface


def pressed(count: int, seed: int, turns=(0, 18, 4, 12, 2)) -> tuple[Presses, np.ndarray]:
    """Presses of the true armor with noise and scatter, and their P^e (presses, samples, 3)."""
    random = np.random.default_rng([seed, 1])
    at, surface = places(count, seed)
    force = np.concatenate([np.arange(a, b, 2 * np.sign(b - a)) for a, b in pairwise(turns)])
    force = np.tile(force[1:].astype(float), (count, 1))
    time, normal = np.arange(1.0, force.shape[1] + 1), INWARD[surface - 1]
    clean = planned_presses(truth(), time, force, normal, at, surface)
    off = SCATTER * random.normal(size=(count, 1))
    noise = NOISE * random.normal(size=clean.readings.shape)
    depth = np.asarray(clean.displacement) + off
    # A load along the normal at another depth has the same moment: the readings stay.
    made = Presses(time, clean.readings + noise, force, normal, at, surface, depth)
    return made, at[:, None] + depth[..., None] * normal[:, None]


@cache
def calibrated():
    return calibrate_armor(start(), pressed(20, 0)[0], seed=1)


def test_planned_presses_are_missed_by_nothing():
    at, surface = places(6, 3)
    force = np.tile([3.0, 8.0, 15.0, 7.0], (6, 1))
    planned = planned_presses(truth(), np.arange(4.0), force, INWARD[surface - 1], at, surface)
    residuals = PressResiduals(planned, jnp.asarray(NOISE))
    # In deviations of the noise: rounding.
    assert np.abs(residuals(truth())).max() < 1e-8
    assert np.abs(residuals(start())).max() > 10


@pytest.mark.thorough
def test_the_armor_is_found_away_from_the_truth():
    found = calibrated()
    assert found.calibration.converged
    assert found.noise == pytest.approx(NOISE, rel=0.25)  # plays undone let more of it through
    assert found.scatter == pytest.approx(SCATTER, rel=0.6)  # of twenty presses
    true = found.calibration.prior._values(truth())
    flat = np.concatenate([np.ravel(x) for x in true])
    pairs = zip(found.calibration.parameters, flat, strict=True)
    z = [(p.value - x) / p.deviation for p, x in pairs]
    # 51 z: their mean square is 1 to 0.2, and some more for what is not normal.
    assert 0.4 < np.mean(np.square(z)) < 2.0


@pytest.mark.thorough
def test_draws_agree_with_the_covariance_of_a_linear_solve():
    known = Armor(WristSensor(), ContactSolver(BOX, LinearSponge(K=0.0, b=5.0, threshold=0.5)))
    shifts = jnp.asarray(0.1 * np.random.default_rng(0).normal(size=4000))
    draws = eqx.tree_at(lambda a: a.solver.cover.compensator.b, known, 5.0 + shifts)
    uncertain = UncertainArmor(known, draws, NOISE, 2e-4)
    reading = np.concatenate([[0, 0, -15.0], np.cross([0.1, -0.05, 0.545], [0, 0, -15.0])])
    found = uncertain.solve(reading)
    J = np.asarray(jax.jacfwd(lambda w: known.solve(w).point)(jnp.asarray(reading)))
    expected = (J * NOISE**2) @ J.T
    expected[2, 2] += (0.1e-3) ** 2 + 2e-4**2  # the material's and the cover's
    # Covariances of 4,000 draws: 2 % of the diagonal.
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs(np.asarray(found.covariance) - expected).max() < 0.1 * scale.max()
    assert np.abs((np.asarray(found.covariance) - expected) / scale).max() < 0.1
    assert float(found.probability) == 1.0


def test_an_edge_has_alternatives_with_probabilities_and_air_has_none():
    known = Armor(WristSensor(), ContactSolver(BOX))
    many = eqx.tree_at(lambda a: a.sensor.bias, known, jnp.zeros((400, 6)))
    uncertain = UncertainArmor(known, many, NOISE)
    force = np.array([-10.0, 0.0, -10.0])
    at = np.array([0.3, 0.0, 0.55])  # the edge between 1 and 4, pushed alike on both
    listed = uncertain.alternatives(np.concatenate([force, np.cross(at, force)]))
    assert {one.surface for one in listed} == {1, 4}
    assert sum(one.probability for one in listed) == pytest.approx(1.0)
    assert all(0.3 < one.probability < 0.7 for one in listed)
    assert all(np.linalg.norm(one.point - at) < 0.01 for one in listed)
    assert uncertain.alternatives(np.zeros(6)) == []


@pytest.mark.thorough
def test_presses_are_chosen_where_they_tell_the_most():
    at, surface = places(30, 4)
    force = np.tile([6.0, 15.0, 8.0], (30, 1))
    plan = planned_presses(start(), np.arange(3.0), force, INWARD[surface - 1], at, surface)
    choice = choose_presses(start(), plan, plan, 6)
    assert len(set(choice.chosen.tolist())) >= 5
    assert (np.diff(choice.expected) < 0).all()


@pytest.mark.parametrize(("name", "value", "words"), [
    ("surface", np.ones(2, int), "surface has the shape"),
    ("touched", np.full((3, 3), np.nan), "leave such presses out"),
    ("direction", np.tile([0, 0, -2.0], (3, 1)), "divide it by its length"),
    ("force", np.ones(3), "give \\(presses, samples\\)"),
])  # fmt: skip
def test_faults_say_what_to_do(name, value, words):
    given = {
        "time": np.arange(2.0), "readings": np.zeros((3, 2, 6)), "force": np.ones((3, 2)),
        "direction": np.tile([0, 0, -1.0], (3, 1)), "touched": np.zeros((3, 3)), "surface": np.ones(3, int),
    } | {name: value}  # fmt: skip
    with pytest.raises(InputError, match=words):
        Presses(**given)
