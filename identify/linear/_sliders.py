"""Stops and plays of a composition: their columns, and the model of their weights."""

import numpy as np
from jaxtyping import Float

from hysteresis import ModulatedStops
from hysteresis.numerics._hats import hats_of

from ._composition_memory import Memory
from ._unknown_vectors import Values, split

PLAYS, STOPS, PLACE_STOPS, SPAN_STOPS = "plays", "stops", "stops by position", "stops by span"

THRESHOLDS = np.geomspace(0.006, 0.45, 14)
"""Of the stops and plays, in parts of the input's range."""

BANDS = np.diff(THRESHOLDS, prepend=0.0)
"""Widths of the bands between them."""

PLACES, SPANS = np.array([0.0, 0.5, 1.0]), np.append(0.0, 2.0 ** np.arange(-3, 1))
"""Levels of the position and of the range covered, in parts of the input's range."""

LEVELS = {PLAYS: PLACES[:1], STOPS: PLACES[:1], PLACE_STOPS: PLACES, SPAN_STOPS: SPANS}
"""Of each part; one with a single level is the same everywhere."""

COLUMNS = {
    PLAYS: len(THRESHOLDS), STOPS: 2 * len(THRESHOLDS), PLACE_STOPS: 2 * len(THRESHOLDS),
    SPAN_STOPS: 2 * len(THRESHOLDS) + 1,
}  # fmt: skip
"""Of each part at one level."""

Columns = Float[np.ndarray, "samples columns"]


def columns_of(part: str, memory: Memory, rest: float) -> Float[np.ndarray, "samples unknowns"]:
    """Plays u - rest - s_j; or stops s_j / r_j, their bands (s_j - s_(j-1)) / (r_j - r_(j-1)), and by span
    a spring u - rest, all in parts of the input's range.

    A stop is the sum of all bands up to its threshold.
    """
    stops, spring = memory.strained * THRESHOLDS, memory.v[:, None] - rest
    if part == PLAYS:
        x = spring - stops
    else:
        x = np.hstack([memory.strained, np.diff(stops, prepend=0.0) / BANDS])
    if part == SPAN_STOPS:
        x = np.hstack([x, spring])
    modulator = memory.covered if part == SPAN_STOPS else memory.before
    return modulated(x, hats_of(modulator, LEVELS[part]))


def modulated(
    x: Columns, h: Float[np.ndarray, "samples levels"]
) -> Float[np.ndarray, "samples products"]:
    """Every column of x times every one of h, those of one x side by side."""
    return (x[:, :, None] * h[:, None, :]).reshape(len(x), -1)


def model_of(part: str, values: Values, low: float, high: float, rest: float) -> ModulatedStops:
    """The model that the unknowns of a part stand for, on an input's range."""
    n, levels, span = len(THRESHOLDS), LEVELS[part], high - low
    by_span = part == SPAN_STOPS
    springs, slopes, plays = np.zeros(len(levels)), np.zeros((n, len(levels))), None
    if part == PLAYS:
        plays = values[:, None] / span
    else:
        weights, beside = split(values, 2 * n, len(levels))
        stops, bands = weights[:n], weights[n:]
        slopes = (stops / THRESHOLDS[:, None])[::-1].cumsum(0)[::-1] + bands / BANDS[:, None]
        springs = beside / span if by_span else springs
    return ModulatedStops(
        low, high, span * THRESHOLDS, span * levels + (0.0 if by_span else low), slopes / span, springs,
        rest=rest, by="span" if by_span else "position", plays=plays,
    )  # fmt: skip
