"""Which way the output goes with the input, and which way its loops turn."""

import numpy as np
import pytest

from hysteresis import Record, StandardLinearSolid
from hysteresis._registry import registered
from identify import fit
from identify.records._orientation import output_falls
from tests.thorough import rest_thorough


def ratcheting(sign: float, creep: float) -> Record:
    """Cycles of a lagging loop whose mean moves on by several times its height."""
    t = np.linspace(0, 10, 1001)
    u = 1 + np.sin(2 * np.pi * t)
    y = u - 0.2 * np.cos(2 * np.pi * t) + creep * t
    return Record.from_arrays(u * (1 - 0.03 * t), sign * y, t)


@pytest.mark.parametrize("creep", [-2.0, 0.0, 2.0])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_creep_from_cycle_to_cycle_turns_no_sign(sign: float, creep: float):
    record = ratcheting(sign, creep)
    assert output_falls(record) == (sign < 0)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("seed", range(8))
def test_the_steps_tell_the_sign_of_friction_on_a_random_path(seed: int, sign: float):
    rng = np.random.default_rng(seed)
    turns = np.append(0.0, rng.uniform(-1, 1, 30))
    u = np.interp(np.arange(900), 30 * np.arange(31), turns)
    held, y = 0.0, np.empty(900)
    for k, move in enumerate(np.diff(u, prepend=0.0)):
        held = np.clip(held + 20 * move, -1, 1)
        y[k] = held
    record = Record.from_arrays(u, sign * y + 0.01 * rng.normal(size=900))
    assert output_falls(record) == (sign < 0)


@pytest.mark.parametrize("units", [("1", "1"), ("mm/mm", "MPa"), ("N", "mm"), ("deg", "1")])
@pytest.mark.parametrize("relaxes", rest_thorough([True, False], 1))
def test_an_input_that_goes_one_way_tells_deformation_from_load(units, relaxes):
    """By the units where both are known, else by what the output does in the hold."""
    t = np.linspace(0.0, 30.0, 200)
    u = np.minimum(t / 3.0, 1.0)
    solid = StandardLinearSolid(4.0, 6.0, 20.0, leading=relaxes)
    y = np.asarray(solid.simulate(t, u)) + np.random.default_rng(0).normal(0, 1e-3, len(t))
    given = Record.from_arrays(u, y, t, input_unit=units[0], output_unit=units[1])
    asked = {("mm/mm", "MPa"): True, ("N", "mm"): False}.get(units, relaxes)
    start = registered(StandardLinearSolid).start(given)
    assert start.leading is asked
    if asked is relaxes:
        found = fit(given, "StandardLinearSolid", starts=2, noise="gaussian")
        assert found.metrics["train"].rmse < 1.2e-3  # that of the noise
