"""Histories of force from turn to turn."""

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
