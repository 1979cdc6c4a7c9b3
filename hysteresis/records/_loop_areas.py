"""Areas of loops: the work done around them, and what of it is given back."""

import numpy as np

from ._loop_cut import ranges
from ._loop_figures import Loops, Pair, largest_row

ROUNDING = 1e-12
"""Of the work done on the way: so much of it is rounding."""


def area(loops: Loops, x: np.ndarray, y: np.ndarray, sx: np.ndarray, sy: np.ndarray) -> Pair:
    """`int y dx` around each loop, closed by a straight line: polygon, noise, and sampling step."""
    a, c = loops.cut.first, loops.cut.last
    steps = ranges(a, c)
    begins = np.cumsum(c - a) - (c - a)
    # From the loop's own middle, so that a large offset costs no digits.
    loop = np.repeat(np.arange(loops.size), c - a)
    off = y[a][loop]
    y0, y1 = y[steps] - off, y[steps + 1] - off
    dx = x[steps + 1] - x[steps]
    whole = np.add.reduceat((y0 + y1) / 2 * dx, begins) + (y[c] - y[a]) / 2 * (x[a] - x[c])
    # Rounding is no loop.
    path = np.add.reduceat(np.abs((y0 + y1) / 2 * dx), begins)
    whole[np.abs(whole) <= ROUNDING * path] = 0.0
    # The same with every second row tells what the sampling leaves out: a third of the difference.
    even = (steps - a[loop]) % 2 == 0
    second = np.minimum(steps + 2, c[loop])
    coarse = np.where(even, (y0 + y[second] - off) / 2 * (x[second] - x[steps]), 0.0)
    half = np.add.reduceat(coarse, begins) + (y[c] - y[a]) / 2 * (x[a] - x[c])
    two = np.where(even, 1.0, 0.0)
    moved = [
        np.maximum(
            np.add.reduceat(two * (z[second] - z[steps]) ** 2, begins) / 2 - s**2 * (c - a) / 2, 0
        )
        for z, s in ((x, sx), (y, sy))
    ]
    noise = sy**2 * moved[0] + sx**2 * moved[1] + sx**2 * sy**2 * (c - a) / 2
    return whole, np.sqrt(noise + ((whole - half) / 3) ** 2)


def given_back(loops: Loops, x: np.ndarray, y: np.ndarray) -> Pair:
    """The part of `int y dx` that is negative: where the load acts against the way of `x`."""
    a, b, c = loops.cut.first, loops.cut.turn, loops.cut.last
    way = np.sign(x[b] - x[a])
    loop = np.repeat(np.arange(loops.size), c - a)
    # Where the input is the load, x turns later than it does.
    along = np.zeros(len(x))
    along[loops.legs.at] = way[loops.legs.branch // 2] * x[loops.legs.at]
    turns = largest_row(-along, a, b), largest_row(along, b, c)
    rows = ranges(a, c)
    back = (rows < turns[0][loop]) | (rows >= turns[1][loop])
    side = np.where(back, -way[loop], way[loop])
    before, after = (np.maximum(-side * y[rows + k], 0.0) for k in (0, 1))
    parts = (before + after) / 2 * side * (x[rows + 1] - x[rows])
    total = np.add.reduceat(parts, np.cumsum(c - a) - (c - a))
    variance = np.zeros(loops.size)
    for at, sign in zip(turns, (-way, way), strict=True):
        # The noise of the row that an extreme has chosen is no work: the level there is.
        level, error = loops.value(x, loops.tip(x, at)[0], both=True)
        total += sign * (level - x[at]) * np.abs(y[at])
        variance += (y[at] * error) ** 2
    return total, np.sqrt(variance)
