"""Contact positions from many channels: interpolation, honest deviations, faults."""

from functools import cache
from typing import Any

import jax
import numpy as np
import pytest

from compensate.internal import PlaceStatus
from hysid import fit_positions
from hysteresis import InputError
from tests.refusals import refuses

SENSORS = np.array([[x, y] for x in (2.0, 10.0, 18.0) for y in (2.0, 10.0, 18.0)])
NOISE = 0.01


def readings(places: np.ndarray, seed: int) -> np.ndarray:
    """Nine bumps of a soft skin, pushed by 1 to 3 N."""
    random = np.random.default_rng(seed)
    away = np.linalg.norm(places[:, None] - SENSORS, axis=2)
    force = random.uniform(1, 3, (len(places), 1))
    return force * np.exp(-(away**2) / 50) + NOISE * random.normal(size=away.shape)


def grid(step: float) -> np.ndarray:
    return np.array([[x, y] for x in np.arange(0, 20.1, step) for y in np.arange(0, 20.1, step)])


@cache
def learnt() -> Any:
    places = np.repeat(grid(2.5), 3, axis=0)
    return fit_positions(readings(places, 0), places, least=0.2)


def test_places_between_those_learnt_are_found_with_true_deviations():
    places = np.random.default_rng(1).uniform(2, 18, (400, 2))
    found = learnt().estimate(readings(places, 2))
    error = np.asarray(found.point) - places
    assert (np.asarray(found.status) == PlaceStatus.OK).all()
    # A sixth of the 2.5 mm between two places of the grid; most of it is noise.
    assert np.linalg.norm(error, axis=1).mean() < 0.4
    z = error / np.asarray(found.deviation)[:, None]
    # Of 800 z; the process is a prior, not the law of these bumps.
    assert 0.5 < z.std() < 1.5


def test_what_is_unlike_all_and_what_is_nothing_is_said():
    unlike = readings(np.array([[10.0, 10.0]]), 3)[0] * np.array([1, -1, 1, -1, 1, -1, 1, -1, 1])
    rows = np.stack([unlike, np.zeros(9), np.full(9, np.nan)])
    found = learnt().estimate(rows)
    wanted = [PlaceStatus.UNKNOWN, PlaceStatus.NO_PRESS, PlaceStatus.INVALID]
    assert found.status.tolist() == wanted
    assert np.isfinite(np.asarray(found.point)).all()


def test_faults_say_what_to_do():
    places = grid(4.0)
    with pytest.raises(InputError, match="at least ten rows of both"):
        fit_positions(readings(places[:5], 0), places[:5])
    bad = readings(places, 0)
    bad[3, 2] = np.nan
    refuses("not-finite", lambda: fit_positions(bad, places), "exclude that row")
    with pytest.raises(InputError, match="one place a reading"):
        type(learnt())(bad, places[:4], learnt().kernel)


def test_plain_readings_are_compiled_once(caplog):
    sensor = learnt()
    sensor.estimate([1.0] * 9)
    with jax.log_compiles():
        sensor.estimate([2.0] * 9)
    assert not caplog.records
