"""Slopes of loops: of the line through the middle, of tangents, and at the beginning of a branch."""

import numpy as np

from ._loop_cut import Pair
from ._loop_figures import Loops

MARGIN = 0.05
"""Of the input's range, left out at either end of the line through the middle of a loop."""

TANGENT, INITIAL = 0.1, 0.1
"""Of a branch: its tangent is taken so far on either side of its middle, its initial slope up to here."""


def middle_slope(loops: Loops) -> Pair:
    """Of the line through the middle between the branches, output over input."""
    low, high = loops.common
    middle, half = (low + high) / 2, (0.5 - MARGIN) * (high - low)
    at, branch, begins = loops.legs
    loop = branch // 2
    off = loops.u[at] - middle[loop]
    y = loops.y[at] - loops.y[loops.leg_first][branch]
    inside = np.append(np.diff(branch) == 0, False) & (np.abs(off) < half[loop])
    way = np.clip(off, -half[loop], half[loop])
    su, sy = (
        one.sigma * np.sqrt(one.grown(loops.lengths.reshape(-1, 2).min(1))) for one in loops.noise
    )
    parts = (np.diff(way**2 / 2, append=0.0) * sy[loop]) ** 2
    parts += (way * np.diff(y, append=0.0) * su[loop]) ** 2
    variance = np.add.reduceat(np.where(inside, parts, 0.0), begins)

    def moment(some: np.ndarray) -> np.ndarray:
        """`int y (u - middle) du` over the inputs within, with straight lines between some rows."""
        v, w, z, own = off[some], way[some], y[some], loop[some]
        gone = np.diff(v)
        per = np.diff(z) / np.where(gone == 0, np.inf, gone)
        mean = (z[1:] + z[:-1] + per * ((w - v)[1:] + (w - v)[:-1])) / 2
        square = np.maximum(np.diff(w) ** 2 - 2 * loops.su[own[1:]] ** 2, 0.0)
        each = mean * np.diff(w**2 / 2) + per * np.diff(w) * square / 12
        same = np.append(np.diff(branch[some]) == 0, False)
        total = np.bincount(branch[some], np.where(same, np.append(each, 0.0), 0.0), len(begins))
        sign = np.where(np.repeat(loops.rising, 2) == (np.arange(len(total)) % 2 == 0), 1.0, -1.0)
        return (sign * total).reshape(-1, 2).sum(1)

    number, last = np.arange(len(at)), np.append(begins[1:], len(at)) - 1
    whole = moment(number)
    # The same with every second row tells what the sampling leaves out: a third of the difference.
    second = ((number - begins[branch]) % 2 == 0) | (number == last[branch])
    error = np.hypot(np.sqrt(variance.reshape(-1, 2).sum(1)), (whole - moment(second)) / 3)
    size = 4 * half**3 / 3
    return whole / size, error / size


def slopes(loops: Loops, initial: bool) -> tuple[Pair, Pair]:
    """Of the rising and of the falling branch: the initial slope, or the tangent at its middle."""
    at, branch, _ = loops.legs
    u, y = loops.u[at], loops.y[at]
    ends = [one[0][0] for one in loops.tips]
    begin, end = np.column_stack(ends[:2]).ravel(), np.column_stack(ends[1:]).ravel()
    way = (u - begin[branch]) / (end - begin)[branch]
    inside = way <= INITIAL if initial else np.abs(way - 0.5) <= TANGENT
    if initial:  # a branch with inner loops comes back to its beginning
        inside &= at - loops.leg_first[branch] <= 0.5 * loops.lengths[branch]
    slope, error, _ = lines(loops, inside, u, y)
    if initial:  # a steep beginning depends on where it begins
        where = np.column_stack([one[0][1] for one in loops.tips[:2]]).ravel()
        straight, _, _ = lines(loops, np.abs(way - 0.5) <= TANGENT, u, y)
        error = np.hypot(error, (slope - straight) * where / (INITIAL * np.abs(end - begin)))
    pairs = [loops.by_way(x.reshape(-1, 2)) for x in (slope, error)]
    rising, falling = ((pairs[0][:, k], pairs[1][:, k]) for k in (0, 1))
    return rising, falling


def lines(
    loops: Loops, inside: np.ndarray, u: np.ndarray, y: np.ndarray, groups: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, ...]]:
    """Least-squares lines of the rows `inside` of each branch: slope, its error, and centre.

    `groups`: (m,) of each row, in place of its branch. The centre is the mean input, the mean output
    and its standard error.
    """
    group = loops.legs.branch if groups is None else groups
    count = 2 * loops.size
    own, u, y = group[inside], u[inside], y[inside]
    n = np.bincount(own, minlength=count)
    mean_u, mean_y = (np.bincount(own, x, count) / n for x in (u, y))
    du, dy = u - mean_u[own], y - mean_y[own]
    suu, suy = (np.bincount(own, du * x, count) for x in (du, dy))
    slope = np.where(n >= 3, suy / suu, np.nan)
    each = [one.at(np.arange(count) // 2) for one in loops.noise]
    su, sy = (one.sigma * np.sqrt(one.grown(np.maximum(n, 1))) for one in each)
    sigma = np.hypot(sy, slope * su)
    error = sigma / np.sqrt(suu)
    centre = mean_u, mean_y, sigma / np.sqrt(n)
    return np.where(np.isfinite(slope), slope, np.nan), error, centre
