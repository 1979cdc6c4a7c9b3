"""Gains from readings of use: the directions of single presses are the outermost ones."""

import numpy as np
import pytest

from compensate.internal import gains_in_use
from tests.refusals import refuses

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


def test_places_never_pressed_alone_are_refused():
    refuses("no-excitation", lambda: gains_in_use(read(signals(0, alone=False)), KNOWN))


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
    refuses(code, lambda: gains_in_use(readings, known, **options))
