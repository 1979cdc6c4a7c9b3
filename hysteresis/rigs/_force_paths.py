"""Histories of force: from turn to turn, and mixed ones."""

from collections.abc import Sequence
from functools import partial
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from ._arguments import require

_require = partial(require, "ArmorRig")


def force_path(turns: Sequence[float], step: float = 1.0) -> Float[np.ndarray, " samples"]:
    """From the first force (left out) through the others, in equal steps of at most `step` N.

    **Raises:** `InputError` if there is no turn, or the step is not positive.

    **Example:**

        >>> hysteresis.rigs.force_path([0.0, 3.0, 1.0])
        array([1., 2., 3., 2., 1.])
    """
    _require(len(turns) > 0 and step > 0, "no turn, or no step.", "Give forces, and a step > 0.")
    pieces = [
        np.linspace(a, b, max(int(np.ceil(abs(b - a) / step - 1e-9)), 1) + 1)[1:]
        for a, b in pairwise(turns)
    ]
    return np.concatenate([np.empty(0), *pieces])


def mixed_forces(
    presses: int, samples: int = 40, *, low: float = 2.0, high: float = 20.0, seed: int = 0
) -> Float[np.ndarray, "presses samples"]:
    """Histories that load and unload between `low` and `high` N, each at another stage of another path.

    Each starts from 0 N, reverses three to six times, in the upper and the lower third of the range by
    turns, and ends anywhere.

    **Example:**

        >>> forces = hysteresis.rigs.mixed_forces(2, 40, low=2.0, high=20.0)
        >>> forces.shape, bool(forces.max() <= 20.0)
        ((2, 40), True)
    """
    rng = np.random.default_rng(seed)
    third = (high - low) / 3
    paths = []
    for _ in range(presses):
        turns = rng.uniform(low, low + third, rng.integers(3, 7))
        turns[::2] += 2 * third
        turns = np.concatenate([[0.0], turns, [rng.uniform(low, high)]])
        way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(turns)))])
        paths.append(np.interp(np.linspace(0, way[-1], samples + 1)[1:], way, turns))
    return np.array(paths)
