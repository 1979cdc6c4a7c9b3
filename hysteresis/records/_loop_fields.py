"""Areas of loops; coercive field, remanence, saturation and loss of magnetic and ferroelectric ones."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from .._format import SAID
from .._quantities import conversion
from ._abstract_record import AbstractRecord, over
from ._loop_cut import Pair, RowNoise, largest_row, ranges, widest
from ._loop_figures import Loops

# Slopes of loops: of the line through the middle, of tangents, and at the beginning of a branch.

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


HIGH, HIGHER = 0.7, 0.85
"""Of the largest field: from here on the slope counts as that of what does not saturate."""

SETTLED = 0.05
"""Of the saturation: by so much the two ranges of high fields may disagree."""

SINGULAR = 1e12
"""Condition of a cubic from which on its rows do not tell it."""

NOT_CROSSED = "a branch does not cross zero"
NO_ZERO = "a branch does not pass zero input"
NOT_SATURATED = (
    "the loop does not saturate: the slope still changes above 70 % of the largest field"
)
NO_VOLUME = "the units tell no volume, or no energy"

MU0 = 4e-7 * np.pi


_ELECTRIC = (
    {"V/m": "E", "V": "voltage"},
    {"C/m^2": "P", "C": "charge"},
)


def field_unit(unit: str, kind: str, role: int) -> tuple[str, float] | None:
    """What a unit measures as a field (`role` 0) or its answer (1), and one of it in SI units; None of any
    other."""
    if kind == "magnetic":
        known = SAID["magnetic"][role].get(unit)
        return known and tuple(known)
    for one, quantity in _ELECTRIC[role].items():
        if (size := conversion(unit, one)) is not None:
            return quantity, size
    return None


_LOSSES = {
    ("H", "B"): ("J/m^3", 1.0), ("H", "M"): ("J/m^3", MU0), ("H", "moment a mass"): ("J/kg", MU0),
    ("H", "moment"): ("J", MU0), ("E", "P"): ("J/m^3", 1.0), ("voltage", "charge"): ("J", 1.0),
}  # fmt: skip


def field_figures(
    record: AbstractRecord, kind: str, loops: Loops, around: Pair, opened: np.ndarray
) -> Iterator[tuple[str, Pair, str, Any]]:
    """Name, value with error, unit and reason of each figure of loops over a field."""
    unit_u, unit_y = record.input_unit, record.output_unit
    slope_unit = over(unit_y, unit_u)
    rows = _single(loops)
    crossings, _ = map(_by_branch, _at_zero(loops, rows, over_input=False))
    at_zero, tangents = map(_by_branch, _at_zero(loops, rows, over_input=True))
    why = np.where(np.isfinite(crossings[0][0] + crossings[1][0]), "", NOT_CROSSED)
    for way, pair in zip(("rising", "falling"), crossings, strict=True):
        own = np.where(np.isfinite(pair[0]), "", NOT_CROSSED)
        yield f"coercive field, {way}", pair, unit_u, own
    yield "coercive field", _halves(crossings, -1), unit_u, why
    yield "bias field", _halves(crossings, 1), unit_u, why
    remanence, tangent = _halves(at_zero[::-1], -1), _halves(tangents, 1)
    why = np.where(np.isfinite(remanence[0]), "", NO_ZERO)
    for way, pair in zip(("rising", "falling"), at_zero, strict=True):
        yield f"remanence, {way}", pair, unit_y, why
    yield "remanence", remanence, unit_y, why
    yield "susceptibility", tangent, slope_unit, why
    high, saturation = _saturation(loops, HIGH)
    _, further = _saturation(loops, HIGHER)
    off = np.abs(further[0] - saturation[0]) - 3 * np.hypot(further[1], saturation[1])
    # What saturates keeps no more than it had; of minor loops the line may pass anywhere.
    more = np.abs(remanence[0]) - np.abs(saturation[0]) - 3 * np.hypot(remanence[1], saturation[1])
    open_ends = (off > SETTLED * np.abs(saturation[0])) | (more > 0)
    unsettled = np.where(open_ends, NOT_SATURATED, "")
    square = remanence[0] / saturation[0]
    parts = remanence[1] / remanence[0], saturation[1] / saturation[0]
    squareness = square, np.abs(square) * np.hypot(*parts)
    yield "high-field slope", high, slope_unit, ""
    yield "saturation", saturation, unit_y, unsettled
    yield "squareness", squareness, "1", unsettled
    field, answer = field_unit(unit_u, kind, 0), field_unit(unit_y, kind, 1)
    unit, size = "J/m^3", np.nan
    if field and answer:
        unit, size = _LOSSES.get((field[0], answer[0]), (unit, np.nan))
        size *= field[1] * answer[1]
    # Where the output lags, a loop runs counter-clockwise and its polygon is negative: energy is lost.
    loss = -size * around[0], size * around[1]
    each = {"J": "", "J/kg": " and mass"}.get(unit, " and volume")
    yield f"loss a cycle{each}", loss, unit, opened if np.isfinite(size) else NO_VOLUME
    if unit == "J":
        empty = np.full(loops.size, np.nan)
        yield "loss a cycle and volume", (empty, empty), "J/m^3", NO_VOLUME


def _by_branch(both: Pair) -> list[Pair]:
    """The figures of the rising and of the falling branch."""
    return [(both[0][:, k], both[1][:, k]) for k in (0, 1)]


def _halves(pairs: Sequence[Pair], sign: int) -> Pair:
    """Half the sum, or half the difference of the first and the second."""
    (a, ea), (b, eb) = pairs
    return (a + sign * b) / 2, np.hypot(ea, eb) / 2


class _Single(NamedTuple):
    """Rows of all branches one after the other: input, output, the noise of each branch, (2 k,), the branch
    of each row, and where each begins."""

    u: np.ndarray
    y: np.ndarray
    nu: RowNoise
    ny: RowNoise
    branch: np.ndarray
    begins: np.ndarray


def _single(loops: Loops) -> _Single:
    """The branches row by row, before means were taken."""
    rows, sequence = loops.many, np.repeat(loops.cut.sequence, 2)
    first, last = (
        loops.begins[sequence] + (at - loops.cut.bounds[sequence]) * rows + rows // 2
        for at in (loops.leg_first, loops.leg_last)
    )
    lengths = last + 1 - first
    nu, ny = (one.at(sequence) for one in loops.cut.noise)
    at = ranges(first, last + 1)
    u, y = (x[at] for x in loops.rows)
    branch = np.repeat(np.arange(len(lengths)), lengths)
    return _Single(u, y, nu, ny, branch, np.cumsum(lengths) - lengths)


def _at_zero(loops: Loops, rows: _Single, over_input: bool) -> tuple[Pair, Pair]:
    """The output where the input crosses zero, or the input where the output does, and its slope over that:
    (k, 2) each, with errors.

    On the rising and the falling branch, NaN where a branch does not cross zero.
    """
    own, level, noise_x, noise_y = rows[:4] if over_input else (rows.y, rows.u, rows.ny, rows.nu)
    begins, stop = rows.begins, np.append(rows.begins[1:], len(own))
    number = np.arange(len(own))
    crosses = (np.diff(rows.branch) == 0) & ((own[1:] >= 0) != (own[:-1] >= 0))
    crosses = np.append(crosses, False)
    # Noise crosses several times: between the first and the last of them.
    first = np.minimum.reduceat(np.where(crosses, number, len(own)), begins)
    last = np.maximum.reduceat(np.where(crosses, number, -1), begins)
    there = last >= 0
    first, last = np.where(there, first, 0), np.where(there, last, 0)
    last = np.minimum(last + 1, max(len(own) - 1, 0))
    slope = (level[last] - level[first]) / (own[last] - own[first])
    middle = (level[first] - own[first] * slope + level[last] - own[last] * slope) / 2
    # A chord lies off a curve by an eighth of its bend.
    before, after = (np.clip(k, begins, stop - 1) for k in (first - 1, last + 1))
    bend = np.abs(level[before] - level[first] - level[last] + level[after]) / 2
    error = np.hypot(np.hypot(noise_y.sigma, slope * noise_x.sigma), bend / 8)
    size = np.abs(own[last] - own[first])
    found = [(middle, error), (slope, np.sqrt(2) * error / np.where(size > 0, size, np.nan))]
    centre, most = (first + last + 1) // 2, loops.many * loops.tip_rows
    widths = [w for w in (3, *(2 ** np.arange(2, most.bit_length()))) if w <= most]
    fits = [found]
    for w in widths if loops.noisy else ():
        near = centre[:, None] + np.arange(-w, w)
        inside = (near >= begins[:, None]) & (near < stop[:, None])
        near = np.where(inside, near, 0)
        scale = np.abs(np.where(inside, own[near], 0.0)).max(1)
        scale[scale == 0] = 1.0
        powers = inside[..., None] * (own[near] / scale[:, None])[..., None] ** np.arange(4)
        square = np.swapaxes(powers, 1, 2) @ powers
        good = there & inside.all(1) & (np.linalg.cond(square) < SINGULAR)
        square[~good] = np.eye(4)
        inverse = np.linalg.inv(square)
        line = (inverse @ np.swapaxes(powers, 1, 2) @ (level[near] * inside)[..., None])[..., 0]
        sigma_x, sigma_y = (n.sigma * np.sqrt(n.grown(2.0 * w)) for n in (noise_x, noise_y))
        sigma = np.hypot(sigma_y, line[:, 1] / scale * sigma_x)
        sizes = np.ones_like(scale), scale
        fits.append(
            [
                (np.where(good, line[:, k] / by, np.nan), sigma * np.sqrt(inverse[:, k, k]) / by)
                for k, by in enumerate(sizes)
            ]
        )
    pairs = []
    for each in zip(*fits, strict=True):
        both = (np.where(there, z, np.nan) for z in widest(each))
        pairs.append(tuple(loops.by_way(z.reshape(-1, 2)) for z in both))
    return pairs[0], pairs[1]


def _saturation(loops: Loops, share: float) -> tuple[Pair, Pair]:
    """The slope at high fields, and half the distance of the lines through either end at no field."""
    at, branch, _ = loops.legs
    u, y = loops.u[at], loops.y[at]
    loop = branch // 2
    largest = np.maximum(np.abs(loops.low), np.abs(loops.high))
    inside = np.abs(u) >= share * largest[loop]
    slope, slope_error, (mean_u, mean_y, mean_error) = lines(
        loops, inside, u, y, groups=2 * loop + (u > 0)
    )
    level = mean_y - slope * mean_u
    wrong = np.hypot(mean_error, slope_error * mean_u)
    pairs = [x.reshape(-1, 2) for x in (slope, slope_error, level, wrong)]
    (s, es, m, em) = ((x[:, 1], x[:, 0]) for x in pairs)
    high = (s[0] + s[1]) / 2, np.hypot(*es) / 2
    return high, ((m[0] - m[1]) / 2, np.hypot(*em) / 2)


ROUNDING = 1e-12
"""Of the work done on the way: so much of it is rounding."""


def area(loops: Loops, x: np.ndarray, y: np.ndarray, nx: RowNoise, ny: RowNoise) -> Pair:
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
            np.add.reduceat(two * (z[second] - z[steps]) ** 2, begins) / 2
            - n.sigma**2 * (1 - n.share * n.keeps**2) * (c - a) / 2,
            0,
        )
        for z, n in ((x, nx), (y, ny))
    ]
    sx, sy = (n.sigma**2 * n.grown((c - a) / 2) for n in (nx, ny))
    noise = sy * moved[0] + sx * moved[1] + nx.sigma**2 * ny.sigma**2 * (c - a) / 2
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
