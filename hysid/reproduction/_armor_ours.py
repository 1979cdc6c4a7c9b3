"""Our method on the virtual armors: a foam model with memory, and a calibration by twenty presses."""

from functools import cache

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from compensate.armor import (
    Armor,
    Box,
    Bumps,
    ContactSolver,
    Cover,
    Presses,
    UncertainArmor,
    UncertainContact,
    WristSensor,
    planned_presses,
)
from hysteresis import AbstractModel, Record
from hysteresis.rigs import INWARD, ArmorPresses, ArmorRig, FoamBlock, SpongeRig, force_path
from identify import fit

from ..armor._calibration import CalibratedArmor, calibrate_armor, choose_presses

PRESSES, CANDIDATES = 20, 200

STAGE = 5e-5
"""m, deviation of one reading of the stage that measures d."""

TURNS = (0.0, 20.0, 4.0, 15.0)
"""N, of the presses that the choice looks at: up, down and up again."""

Block = SpongeRig | FoamBlock


def calibrated(rig: ArmorRig) -> CalibratedArmor:
    """The armor of one rig, after presses at the chosen points and a look at what they leave."""
    presses = twenty_presses(rig)
    full = np.repeat([rig.sensor.full_scale_n, rig.sensor.full_scale_nm], 3)
    return calibrate_armor(nominal(rig), presses, seed=rig.seed, full_scale=full)


def twenty_presses(rig: ArmorRig) -> Presses:
    """What a person with a gauge records at the chosen points."""
    made = rig.calibrate(*chosen_points())
    return as_presses(made, np.random.default_rng([rig.seed, 7]))


def nominal(rig: ArmorRig) -> Armor:
    """What is known before any calibration: the drawing and the foam."""
    box = Box(*rig.size)
    frame = Bumps(box.centres(), 0.0, 0.25 * rig.size.dx)
    cover = Cover(foam(rig.cover), factor=1.0, compliance=frame)
    return Armor(WristSensor(), ContactSolver(box, cover))


@cache
def foam(block: Block) -> AbstractModel:
    """A Preisach model of the foam's first touch, from eight blocks pressed up and down at random."""
    random = np.random.default_rng(2014)
    force, depth, time, label = [], [], [], []
    for k in range(8):
        turns = random.uniform(0, 7, random.integers(4, 9))
        turns[::2] += 13
        path = force_path((0.0, 0.0, *turns), 0.5)
        force.append(path)
        depth.append(block.follow(path, dt=1.0) + random.normal(0, 1e3 * STAGE, len(path)))
        time.append(np.arange(float(len(path))))
        label += [str(k)] * len(path)
    f, d, t = map(np.concatenate, (force, depth, time))
    record = Record.from_arrays(f, d, t, label, input_unit="N", output_unit="mm")
    return fit(record, "Preisach").model


@cache
def chosen_points() -> tuple[Float[np.ndarray, "presses 3"], np.ndarray]:
    """Twenty places, after which contacts anywhere on the body are known best, and their surfaces."""
    rig = ArmorRig(seed=0)  # of which the size alone is used
    points, surface = rig.random_points(CANDIDATES, seed=1)
    points = np.concatenate([points, np.asarray(Box(*rig.size).centres())])
    surface = np.append(surface, np.arange(1, 6))
    armor, path = nominal(rig), force_path(TURNS, 2.0)

    def planned(points: np.ndarray, surface: np.ndarray) -> Presses:
        force = np.tile(path, (len(points), 1))
        time = 2.0 * np.arange(1, len(path) + 1)
        return planned_presses(armor, time, force, INWARD[surface - 1], points, surface)

    goals = planned(*rig.random_points(60, seed=2))
    choice = choose_presses(armor, planned(points, surface), goals, PRESSES)
    return points[choice.chosen], surface[choice.chosen]


@eqx.filter_jit
def followed(
    armor: UncertainArmor,
    time: Float[Array, " samples"],
    readings: Float[Array, "presses samples 6"],
) -> UncertainContact:
    """The contacts of presses, every one a stream of its own: arrays (presses, ...)."""
    return jax.lax.map(lambda each: armor.simulate(time, each), readings)


@jax.jit
def covariances(found: UncertainContact) -> Float[Array, "presses samples 3 3"]:
    """Of P^e of all of them, m^2."""
    return jax.vmap(lambda one: one.covariance)(found)


def as_presses(made: ArmorPresses, random: np.random.Generator) -> Presses:
    """As a person with a gauge and a stage records them."""
    depth = made.displacement + random.normal(0, STAGE, made.displacement.shape)
    normal = INWARD[made.surface - 1]
    return Presses(made.time, made.wrench, made.force, normal, made.touched, made.surface, depth)
