"""From a sensor's readings to the load's wrench, and the armor without JAX."""

from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compensate import invert
from compensate.armor import (
    Armor,
    Box,
    Bumps,
    ContactSolver,
    Cover,
    Motion,
    WristSensor,
    export_armor,
    forearm,
)
from compensate.runtime import load
from hysteresis import Burgers, InputError, LinearSponge, PrandtlIshlinskii
from hysteresis.internal import Units, with_units
from tests.refusals import refuses
from tests.test_compensate.test_armor.test_solver import PLAYS
from tests.thorough import rest_thorough

BOX = Box(0.3, 0.25, 0.55)
GEAR = with_units(PrandtlIshlinskii([0.1, 0.2], [0.1, 0.1], 0.8), Units("mm", "N"))
QUARTER = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def sensor(seed: int = 0, **others: Any) -> WristSensor:
    """Crosstalk, a bias, turned and off from P_o, with a tool of 2 kg."""
    random = np.random.default_rng(seed)
    matrix = np.eye(6) + 0.02 * random.normal(size=(6, 6))
    return WristSensor(
        matrix, random.normal(size=6), QUARTER, [0.01, 0.02, -0.1], turn=[0.01, 0.02, -0.01],
        mass=2.0, centre=[0, 0.01, 0.2], **others,
    )  # fmt: skip


@given(st.integers(0, 1000), st.sampled_from(["load", "reaction"]))
def test_what_the_load_exerts_is_read(seed: int, reports: str):
    force, moment = np.random.default_rng(seed).normal(size=(2, 4, 3)) * [[[9]], [[2]]]
    wrist = sensor(seed, reports=reports)
    wrench = wrist.read(wrist.reading_of(force, moment))
    np.testing.assert_allclose(wrench.force, force, atol=1e-12)
    np.testing.assert_allclose(wrench.moment, moment, atol=1e-12)
    assert not np.asarray(wrench.doubt).any()


def test_a_swinging_tool_pushes_nothing():
    """What a free rigid body does to its sensor, by Newton and Euler from its points of mass."""
    random = np.random.default_rng(1)
    place, share = random.normal(size=(40, 3)) * 0.1, random.uniform(0.01, 0.1, 40)
    mass, centre = share.sum(), share @ place / share.sum()
    arm = place - centre
    inertia = np.einsum("n,nij->ij", share, (arm**2).sum(1)[:, None, None] * np.eye(3))
    inertia -= np.einsum("n,ni,nj->ij", share, arm, arm)
    a, g, spin, twist = random.normal(size=(4, 3))
    moved = a + np.cross(twist, place) + np.cross(spin, np.cross(spin, place))
    weight = share[:, None] * (g - moved)
    reading = np.concatenate([weight.sum(0), np.cross(place, weight).sum(0)])
    wrist = WristSensor(mass=mass, centre=centre, inertia=inertia)
    wrench = wrist.read(reading, Motion(a, g, spin, twist))
    np.testing.assert_allclose(np.concatenate([wrench.force, wrench.moment]), 0, atol=1e-14)


def test_the_sensors_own_hysteresis_is_undone():
    t = 0.1 * np.arange(150)
    true = np.sin(t[:, None] * np.arange(1, 7) / 3) * 5
    reading = np.stack([GEAR.simulate(None, column) for column in true.T], axis=1)
    found = WristSensor(hysteresis=[GEAR] * 6).simulate(t, reading)
    np.testing.assert_allclose(np.hstack([found.force, found.moment]), true, atol=1e-9 * 10)


@pytest.mark.parametrize(("given_", "code"), [
    ({"rotation": 2 * np.eye(3)}, "not-a-rotation"),
    ({"rotation": np.diag([1.0, 1, -1])}, "not-a-rotation"),
    ({"matrix": np.ones((6, 6))}, "not-invertible"),
    ({"offset": [0.1, 0.2]}, "wrong-shape"),
    ({"hysteresis": [GEAR]}, "wrong-shape"),
    ({"reports": "torque"}, "bad-option"),
])  # fmt: skip
def test_a_sensor_that_cannot_be_is_refused(given_: dict[str, Any], code: str):
    refuses(code, lambda: WristSensor(**given_))


# Without JAX

LOCAL = Cover(
    PLAYS,
    factor=Bumps(BOX.centres(), 0.1, 0.06, 0.94),
    compliance=Bumps(BOX.centres(), amplitude=np.linspace(0, 1e-4, 5), width=0.1),
)
IN_KGF = LinearSponge(0.4, 0.3, 0.1, units=("kgf", "cm", "min"), trained=(0.1, 1.5))
WRIST = sensor(range=60.0, time_constant=0.05, hysteresis=[GEAR] * 6)
EXPORTED = {
    "rigid": (None, None, None),
    "sponge": (LinearSponge(1.298, 6.186), None, WRIST),
    "local": (LOCAL, None, WRIST),
    "rates": (Burgers(1.0, 2.0, 20.0, 5.0, units=("N", "mm", "s")), None, None),
    "inverse": (invert(GEAR), GEAR, None),
    "other units": (Cover(IN_KGF, thickness=0.012), None, None),
}


@pytest.mark.parametrize(
    ("cover", "model", "wrist"), rest_thorough(EXPORTED.values(), 2), ids=EXPORTED
)
def test_without_jax_it_is_the_same(cover: Any, model: Any, wrist: Any, tmp_path: Path):
    """A stream of anything: contacts, slips over edges, releases, bad readings."""
    solver = ContactSolver(BOX, cover, spin_limit=0.05)
    armor = load(export_armor(solver, tmp_path / "armor.json", wrist, model=model))
    random = np.random.default_rng(4)
    t = np.cumsum(random.uniform(0.01, 0.2, 300))
    force = np.cumsum(random.normal(size=(300, 3)), axis=0) - [0, 0, 6]
    moment = np.cross(random.normal(size=(300, 3)) * 0.2 + [0, 0, 0.3], force)
    force[50], force[90, 1] = 0, np.nan
    reading, doubt = np.hstack([force, moment]), None
    if wrist is not None:
        reading = np.asarray(wrist.reading_of(force, moment))
        force, moment, doubt = wrist.simulate(t, reading)
    wanted = solver.simulate(t, force, moment, doubt)
    dt = np.diff(t, prepend=t[0])
    found = [armor.step(*now) for now in zip(dt.tolist(), reading.tolist(), strict=True)]
    assert len({contact.status for contact in found}) > 3
    for k, values in enumerate(wanted):
        # Rounding through the sensor's matrices, the sponge's mm/N and a 0.6 m lever.
        np.testing.assert_allclose([contact[k] for contact in found], values, atol=1e-10)


def test_weight_and_inertia_of_a_moving_shell_without_jax(tmp_path: Path):
    """The same contacts as in JAX; without the motion they are others."""
    random = np.random.default_rng(5)
    sensor = WristSensor(
        mass=1.3, centre=[0.01, -0.02, 0.2], inertia=np.diag([0.05, 0.04, 0.02]), offset=[0, 0, 0.1],
        time_constant=0.02,
    )  # fmt: skip
    armor = Armor(sensor, ContactSolver(BOX, LinearSponge(1.298, 6.186, 1.5)))
    n = 60
    motion = Motion(*(random.normal(size=(n, 3)) * size for size in (2.0, 1.0, 1.5, 3.0)))
    motion = motion._replace(gravity=motion.gravity - [[0, 0, 9.80665]])
    force = np.cumsum(random.normal(size=(n, 3)), axis=0) - [0, 0, 6]
    readings = np.hstack([force, np.cross([0.0, 0.0, 0.4], force)])
    t = 0.01 * np.arange(n)
    wanted = armor.simulate(t, readings, motion)
    runtime = load(export_armor(armor.solver, tmp_path / "armor.json", sensor))
    moves = zip(*(np.asarray(v).tolist() for v in motion), strict=True)
    found = [
        runtime.step(0.01, reading, tuple(map(tuple, now)))
        for reading, now in zip(readings.tolist(), moves, strict=True)
    ]
    # Rounding through the weight and a lever of half a metre.
    np.testing.assert_allclose([c.point for c in found], wanted.point, atol=1e-10)
    np.testing.assert_array_equal([int(c.status) for c in found], wanted.status)
    at_rest = armor.simulate(t, readings)
    assert np.abs(np.asarray(at_rest.point) - np.asarray(wanted.point)).max() > 1e-3


def test_what_cannot_be_exported_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="bad-option"):
        export_armor(ContactSolver(forearm(around=24, along=8)), tmp_path / "it.json")
    with pytest.raises(InputError, match="not-exportable"):
        export_armor(ContactSolver(BOX, invert(GEAR)), tmp_path / "it.json")


def test_nothing_is_exported_in_single_precision(tmp_path: Path):
    """The file would be refused when it is loaded."""
    solver = ContactSolver(BOX)
    with jax.enable_x64(False), pytest.raises(InputError, match=r"enable_x64.*single-precision"):
        export_armor(solver, tmp_path / "it.json")
    assert not (tmp_path / "it.json").exists()
