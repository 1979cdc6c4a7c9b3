"""Gains from readings of use: the directions of single presses are the outermost ones."""

import numpy as np
import pytest

from compensate.microchannel import gains_in_use
from hysteresis import InputError

KNOWN = np.array([[1.0, 0.6], [0.5, 1.0]])
TRUE = np.array([[1.1, 0.5], [0.4, 1.1]])
NOISE = 0.02


def signals(seed: int, *, alone: bool = True) -> np.ndarray:
    """Half sines of 0 to 3 on two places, each at times of its own or, not `alone`, both at once."""
    random = np.random.default_rng(seed)
    s = np.zeros((4000, 2))
    for k in range(2):
        for begin in np.sort(random.integers(0, 3900, 14)):
            s[begin : begin + 80, k] = random.uniform(1, 3) * np.sin(np.pi * np.arange(80) / 80)
    if not alone:
        s[:, 1] = 0.8 * s[:, 0]
    return s


def read(s: np.ndarray, gains: np.ndarray = TRUE) -> np.ndarray:
    return s @ gains.T + NOISE * np.random.default_rng(9).normal(size=s.shape)


def angles(gains: np.ndarray) -> np.ndarray:
    return np.degrees(np.arctan2(gains[1], gains[0]))


@pytest.mark.parametrize("seed", range(5))
def test_the_directions_are_found(seed):
    """To the blur's half (0.86 degrees): mixtures lie on the inner side and pull."""
    found = gains_in_use(read(signals(seed)), KNOWN)
    np.testing.assert_allclose(angles(found), angles(TRUE), atol=0.86)
    np.testing.assert_allclose(np.hypot(*found), np.hypot(*KNOWN), rtol=1e-12)


def test_signals_need_not_be_independent():
    """Pressed together ten times, by one hand, and alone once each: the correlation is above 0.3."""
    random = np.random.default_rng(0)
    press = np.sin(np.pi * np.arange(100) / 100)
    together = [press[:, None] * random.uniform(1, 3, (1, 2)) for _ in range(10)]
    once = 3.0 * press[:, None]
    s = np.concatenate([*together, once * [1, 0], once * [0, 1], np.zeros((100, 2))])
    assert np.corrcoef(s.T)[0, 1] > 0.3
    np.testing.assert_allclose(angles(gains_in_use(read(s), KNOWN)), angles(TRUE), atol=0.86)


def test_places_keep_their_order():
    swapped = [1, 0]
    z = read(signals(1))
    there = gains_in_use(z, KNOWN)
    np.testing.assert_array_equal(gains_in_use(z, KNOWN[:, swapped]), there[:, swapped])
    np.testing.assert_allclose(gains_in_use(z[:, ::-1], KNOWN[::-1])[::-1], there, rtol=0.01)


def test_the_unit_of_the_readings_only_scales_what_counts():
    z = read(signals(2))
    np.testing.assert_allclose(gains_in_use(1e3 * z, KNOWN, pressed=500.0), gains_in_use(z, KNOWN))


def test_lost_readings_are_left_out():
    z = read(signals(3))
    with_gaps = np.insert(z, [5, 900, 2000], np.nan, axis=0)
    np.testing.assert_array_equal(gains_in_use(with_gaps, KNOWN), gains_in_use(z, KNOWN))


def test_places_never_pressed_alone_are_refused():
    with pytest.raises(InputError, match="no-excitation"):
        gains_in_use(read(signals(0, alone=False)), KNOWN)


def test_one_place_alone_is_refused():
    s = signals(0)
    s[:, 1] = 0.0
    with pytest.raises(InputError, match="no-excitation"):
        gains_in_use(read(s), KNOWN)


@pytest.mark.parametrize(
    ("readings", "known", "options", "code"),
    [
        (np.ones((300, 3)), KNOWN, {}, "wrong-channels"),
        (np.ones((300, 2)), np.ones((2, 3)), {}, "wrong-channels"),
        (np.ones((300, 2)), -KNOWN, {}, "parameter-out-of-bounds"),
        (np.ones((300, 2)), KNOWN, {"blur": 1.0}, "bad-option"),
        (np.ones((300, 2)), KNOWN, {"pressed": 0.0}, "bad-option"),
        (np.zeros((300, 2)), KNOWN, {}, "too-few-rows"),
    ],
)
def test_bad_arguments_are_refused(readings, known, options, code):
    with pytest.raises(InputError, match=code):
        gains_in_use(readings, known, **options)
