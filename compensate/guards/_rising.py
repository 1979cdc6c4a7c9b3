"""Whether a model's output rises with its input in the states that the training leaves it in.

A search for the input behind a reading needs an output that never falls while the input rises, or never
rises. Most parts do so by construction. One whose strength at a level grows faster than the rest of the
output does not: then a reading has several inputs, and a search finds any of them.

    spread = max { u2 - u1 : u1 < u2, y(s, u1) > y(s, u2) }    over states s of the training, u in its range

Cost: a step of the model for each sample, and STATES x LEVELS looks.
"""

import jax
import numpy as np

from hysteresis import AbstractModel, InputError

from .._contract import AbstractCompensator
from ..inverses._law import looks_of
from ._run_in import Past, driven, first_draw, thinned

STATES, LEVELS = 256, 257
"""States at most, and inputs: a hundredth of the range is two of their steps."""

UNTOLD = 0.01
"""Part of the range by which inputs with one output may be apart."""

ROUNDING = 1e-9
"""Part of the outputs' range by which they may fall: sums are not exact."""


def require_rising(
    compensator: AbstractCompensator, model: AbstractModel, low: float, high: float, past: Past
) -> None:
    """Raise `InputError` `not-invertible` where a search is to find inputs, and in a state of the past one
    output belongs to inputs more than a hundredth of the range apart."""
    inverses = jax.tree.leaves(compensator, is_leaf=lambda x: hasattr(x, "searches"))
    if not any(getattr(inverse, "searches", False) for inverse in inverses):
        return
    spread = spread_of(model, low, high, past)
    if spread > UNTOLD * (high - low):
        raise InputError(
            "not-invertible",
            "the model's output falls while its input rises: one output belongs to inputs up to"
            f" {spread:.3g} apart.",
            fix='fit to compensate (purpose="compensate", --purpose compensate), or another model.',
        )


def spread_of(model: AbstractModel, low: float, high: float, past: Past) -> float:
    """The greatest distance of two inputs of which the higher one has the lower output, in the input's
    unit."""
    one = first_draw(model)
    t, u = thinned(past, low)
    levels = np.linspace(low, high, LEVELS)
    looks = np.arange(len(u)) % -(-len(u) // STATES) == 0
    across = np.where(looks[:, None], levels, np.nan)
    y = looks_of(one, t, driven(one, u))(across)[looks]
    y = y * np.sign((y[:, -1] - y[:, 0]).sum())
    # The first input whose output, or that of a lower one, lies above.
    above, margin = np.maximum.accumulate(y, axis=1), ROUNDING * np.ptp(y)
    first = [
        np.searchsorted(most, now + margin, "right") for most, now in zip(above, y, strict=True)
    ]
    return float((np.arange(LEVELS) - np.array(first)).max(initial=0) * (levels[1] - levels[0]))
