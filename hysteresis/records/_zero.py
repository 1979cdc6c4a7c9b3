"""The zero of the output: where it jumps, whether it drifts, and where nothing else is read."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Int8

from ._abstract_record import AbstractRecord
from ._arrays import in_pieces, in_rows, pieces
from ._branch_rows import STILL
from ._cycles import branches, default_dead_band, noise_level, turning_points

LEAST = 0.02
"""Of the output's range: a smaller step of the zero changes no model."""

CHANCE = 0.01
"""Records of white noise in which a step passes for a jump."""

BESIDE = 3
"""Steps on either side that are looked at."""

HELD = 5
"""Steps on either side without a move of the input, by which it is held and not just read seldom."""

MOST = (8, 2, 8)
"""Jumps that are looked for where the input moves on, turns or is held: what a specimen does
by itself comes oftener, or in every cycle, and is likeliest at turns."""

MOVING, TURNING, HOLDING = range(3)
"""What the input does at a step: a specimen that snaps, rubs or is pressed at another rate steps where it
turns, and so these are compared with each other."""

STANDS_OUT = np.array([2.0, 3.0, 2.0])
"""Times the largest step that is no jump, for each of these: at turns there are few to compare with."""

AGREES = np.array([0.4, 0.4, 0.75])
"""Part of a step by which the shift of the rows behind may differ from it: a snap that goes back shifts
none. A held specimen seldom snaps, so there a quarter of the shift is enough."""

ROWS = 600
"""Rows from which a shift is told."""

LEVELS = 32
"""Parts of the input's range in which the output is compared with what it is elsewhere."""

WAY = 0.2
"""Of the input's range: so far it moves on without contact."""

FURTHER = 2.0
"""Times the way of the input over which the output stays at another level, as on a plateau of friction."""

_RADII = np.array([0.02, 0.05, 0.1, 0.2, 0.35, 0.5])
_LAGS = np.array([3.0, 10.0, 30.0, 100.0])
"""Numbers of their times in the rows."""
_FEWEST = 12

Rows = Float[np.ndarray, " rows"]
Steps = Int[np.ndarray, " steps"]
Far = Float[np.ndarray, " steps"]


class ZeroJump(NamedTuple):
    """The first row after a jump, and by how much the output jumped there."""

    row: int
    size: float


class LostContact(NamedTuple):
    """The first and the last row that read no more than the zero."""

    first: int
    last: int
    zero: float


class ZeroDrift(NamedTuple):
    """The first and the last row of a sequence, and by how much the output drifts between them."""

    first: int
    last: int
    size: float


def zero_jumps(record: AbstractRecord, lost: Sequence[LostContact] = ()) -> list[ZeroJump]:
    """Where the zero of the output has jumped, as a tare in the middle of a run does; in their order.

    A jump is a step from one row to the next

    - beyond the steps beside it by 2 % of the output's range, by `sqrt(4 ln(n / 0.01))` times the noise,
      which steps of n rows of white noise reach in one record of a hundred, and by twice what the record
      holds elsewhere where the input does the same (moves on, turns, is held), but for eight steps, or two
      at turns,
    - in which the input moves as it does elsewhere,
    - of which there is no like at the same input,
    - that stays: from two cycles before it to two behind it the output is a function of the input's
      history, plus a step as high. Snaps of a specimen are as sudden, but come again, and go back.

    Where no branch is passed before and behind a step, nothing tells a jump from a snap; then only a step
    while the input is held is one. Rows without contact, `lost`, are passed over: both their ends step.
    """
    touching = np.ones(len(record), bool)
    for one in lost:
        touching[max(one.first - BESIDE, 0) : one.last + 1 + BESIDE] = False
    parts = [*_parts(record, touching)]
    # Where the input never moves, the output follows something else.
    parts = [part for part in parts if len(part.u) > 4 * BESIDE and np.ptp(part.u)]
    if not parts:
        return []
    span = float(max(part.y.max() for part in parts) - min(part.y.min() for part in parts))
    # What is below this is neither a jump nor holds one back.
    least = LEAST * span / STANDS_OUT.max()
    far = [(part, *_beyond(part.y, least)) for part in parts]
    far = [(part, at, beyond, _kinds(part.u, at)) for part, at, beyond in far if len(at)]
    if not far:
        return []
    usual = _usual(*(np.concatenate(x) for x in [*zip(*far, strict=True)][2:]))
    moved = np.diff(record.input)
    np.abs(moved, out=moved).sort()
    moved = moved[np.searchsorted(moved, 0.0, "right") :]
    pace = float(np.median(moved, overwrite_input=True)) if len(moved) else 0.0
    del moved
    chance, found = np.sqrt(4 * np.log(len(record) / CHANCE)), []
    for part, at, beyond, kind in far:
        least = max(LEAST * span, chance * noise_level(part.y))
        size = np.abs(beyond)
        (steps,) = np.nonzero(size > np.maximum(least, usual[kind]))
        for one in steps[np.argsort(-size[steps], kind="stable")][: max(MOST)].tolist():
            if _recurs(part, at, beyond, one):
                continue
            k = int(at[one])
            if (jump := _jump(part, k, int(kind[one]), pace)) is not None:
                found.append(ZeroJump(int(part.row[k + 1]), jump))
                y = np.append(part.y[: k + 1], part.y[k + 1 :] - jump)
                part = part._replace(y=y)
    return sorted(found)


class _Part(NamedTuple):
    """The rows that count of a sequence, and their numbers."""

    row: Int[np.ndarray, " rows"] | range
    u: Rows
    y: Rows


def _parts(
    record: AbstractRecord, kept: Bool[np.ndarray, " rows"] | None = None
) -> Iterator[_Part]:
    """Each sequence; of the rows in which `kept` holds."""
    counts = comparable(record)
    counts = counts if kept is None else counts & kept
    for _, rows in record.sequences():
        used = counts[rows]
        row = range(rows.start, rows.stop)
        row = row if used.all() else rows.start + np.flatnonzero(used)
        yield _Part(row, *in_rows(used, record.input[rows], record.output[rows]))


def comparable(record: AbstractRecord) -> Bool[np.ndarray, " rows"]:
    """Rows that count, of sequences in which no condition moves: elsewhere equal inputs tell nothing."""
    counts = record.mask & np.isfinite(record.output)
    for c in (record.columns[name] for name in record.conditions):
        for _, rows in record.sequences():
            counts[rows] &= np.ptp(c[rows]) <= STILL * np.ptp(c)
    return counts


def _recurs(part: _Part, at: Steps, beyond: Far, one: int) -> bool:
    """Whether another step half as high stands out on the same branch, at the same input to a tenth; or
    goes as far beyond the slope here at the very same input, where a specimen may snap in every row."""
    u, y, step, size = part.u, part.y, int(at[one]), float(beyond[one])
    like = at[beyond * np.sign(size) > 0.5 * abs(size)]
    like = like[np.abs(like - step) > BESIDE]
    like = like[np.abs(u[like] - u[step]) < 0.1 * np.ptp(u)]
    ends = [np.clip([k - BESIDE, k + 1 + BESIDE], 0, len(u) - 1) for k in (step, *like)]
    own, *others = np.sign(np.diff(u[np.array(ends)], axis=1)[:, 0])
    if own in others:
        return True
    moves = np.diff(u)
    same = np.flatnonzero(np.abs(u[:-1] - u[step]) <= BESIDE * abs(moves[step]))
    pace = moves[same] / moves[step] if moves[step] else np.zeros(len(same))
    kept = (pace > 0) & (pace < 2) & (np.abs(same - step) > BESIDE)
    more = (y[same + 1] - y[same] - pace * (y[step + 1] - y[step] - size))[kept]
    return bool((more * np.sign(size) > 0.5 * abs(size)).any())


def _jump(part: _Part, step: int, kind: int, pace: float) -> float | None:
    """The size of a step that stands out; None where the input jumps, too, or the step does not stay."""
    first = max(step - BESIDE, 0)
    moves, steps = (np.diff(x[first : step + 2 + BESIDE]) for x in (part.u, part.y))
    near, moves = np.arange(len(moves)) != step - first, np.abs(moves)
    if moves[step - first] > 2 * max(moves[near].max(), pace):
        return None
    slope = np.median(steps[near])
    size = float(steps[step - first] - slope)
    behind, before = part.y[step + 1 : step + 2 + BESIDE], part.y[first : step + 1]
    rise = np.median(behind) - np.median(before) - slope * (len(behind) + len(before)) / 2
    if abs(rise - size) > 0.5 * abs(size):  # a reading or two that are off
        return None
    shift = _shift(part.u, part.y, step + 1)
    if shift is None:
        return size if kind == HOLDING else None
    return size if abs(shift - size) <= AGREES[kind] * abs(size) else None


def _beyond(y: Rows, least: float) -> tuple[Steps, Far]:
    """The steps that are farther than `least` outside the range of those beside them, and how far."""
    found, last = [], len(y) - 2
    for rows in pieces(len(y) - 1):
        near = np.abs(np.arange(rows.start - BESIDE, rows.stop + BESIDE))
        near = np.minimum(near, 2 * last - near)  # behind an end the steps come once more
        steps = y[near + 1] - y[near]
        own = steps[BESIDE:-BESIDE]
        beside = [steps[k:][: len(own)] for k in range(2 * BESIDE + 1) if k != BESIDE]
        beyond = own - np.clip(own, np.minimum.reduce(beside), np.maximum.reduce(beside))
        far = np.flatnonzero(np.abs(beyond) > least)
        found.append((rows.start + far, beyond[far]))
    at, beyond = (np.concatenate(x) for x in zip(*found, strict=True))
    return at, beyond


def _kinds(u: Rows, at: Steps) -> Int[np.ndarray, " steps"]:
    """What the input does at these of its steps."""
    band = min(8 * noise_level(u), 0.25 * float(np.ptp(u)))
    turns, kind = turning_points(u, band)[1:-1] - 1, np.zeros(len(at), np.int8)
    for some in pieces(len(at)):
        here = at[some, None]
        if len(turns):
            near = np.searchsorted(turns, here) + np.array([-1, 0])
            apart = turns[np.clip(near, 0, len(turns) - 1)] - here
            kind[some][(np.abs(apart) <= BESIDE).any(1)] = TURNING
        beside = np.clip(here + np.arange(-HELD, HELD + 2), 0, len(u) - 1)
        held = (np.diff(u[beside]) == 0).all(1)
        kind[some][held & (here[:, 0] >= HELD) & (here[:, 0] < len(u) - 1 - HELD)] = HOLDING
    return kind


def _usual(beyond: Rows, kind: Int[np.ndarray, " rows"]) -> Float[np.ndarray, " kinds"]:
    """What a jump has to exceed where the input does this or that."""
    each = [np.abs(beyond[kind == one]) for one in (MOVING, TURNING, HOLDING)]
    largest = [
        np.partition(x, -most - 1)[-most - 1] if len(x) > most else 0.0
        for x, most in zip(each, MOST, strict=True)
    ]
    largest[TURNING] = max(largest[TURNING], largest[MOVING])
    return STANDS_OUT * largest


def _shift(u: Rows, y: Rows, row: int) -> float | None:
    """By how much the output is shifted from a row on; None where no branch is passed on both sides."""
    turns = turning_points(u, default_dead_band(u))
    before, behind = turns[turns < row - 1], turns[turns > row]
    first = int(before[-5]) if len(before) >= 5 else 0
    last = int(behind[4]) if len(behind) >= 5 else len(u) - 1
    ends = [(a, b) for a, b in pairwise(turns.tolist()) if a >= first and b <= last]
    ways = [u[[a, min(b, row - 1)]] for a, b in ends if a < row - 1]
    ways_behind = [u[[max(a, row), b]] for a, b in ends if b > row]
    common = [
        min(one.max(), other.max()) - max(one.min(), other.min())
        for one in ways
        for other in ways_behind
        if (one[1] > one[0]) == (other[1] > other[0])
    ]
    span = float(np.ptp(u[first : last + 1]))
    if not span or max(common, default=0.0) < 0.25 * span:
        return None
    stride = max(1, (last + 1 - first) // ROWS)
    rows = np.r_[np.arange(row - 1, first - 1, -stride)[::-1], np.arange(row, last + 1, stride)]
    t = np.linspace(-1, 1, len(rows))
    # A snap comes again at the same input.
    beyond = np.sign(u[rows] - (u[row - 1] + u[row]) / 2)
    way = np.sign(np.gradient(u[rows]))
    terms = [beyond, beyond * way, *_history(u[rows], _LAGS, [t, t * (u[rows] - u[row]) / span])]
    found = _beside((rows >= row).astype(float), terms, y[rows])
    return None if found is None else found[0]


def _history(u: Rows, lags: Float[np.ndarray, " lags"], more: Sequence[Rows] = ()) -> list[Rows]:
    """Terms that a function of the input's history is made of, those needed most first, and `more`.

    Powers of the input on either branch; its plays, of which any rate-independent memory is made, and their
    squares; its first-order lags, with times of parts of the rows.
    """
    x = (u - u.min()) / np.ptp(u)
    plays, slow = np.empty((len(x), len(_RADII))), np.empty((len(x), len(lags)))
    play, lag = np.full(len(_RADII), x[0]), np.full(len(lags), x[0])
    share = -np.expm1(-lags / len(x))
    for k, now in enumerate(x.tolist()):
        play = np.minimum(np.maximum(play, now - _RADII), now + _RADII)
        lag = lag + share * (now - lag)
        plays[k], slow[k] = play, lag
    sign = np.sign(x - plays[:, 0])
    powers = [x**k for k in range(5)] + [sign * x**k for k in range(4)]
    return [*more[:1], *powers, *more[1:], *plays.T, *(plays**2).T, *slow.T]


def _beside(of: Rows, terms: list[Rows], y: Rows) -> tuple[float, float] | None:
    """How much of `of` is in the output beside some terms, by ridge regression; the rms of what is left.

    With few rows the first ten terms have to do; None where even those are too many.
    """
    kept = [of, *(terms if len(y) > 2 * len(terms) else terms[:_FEWEST])]
    if len(y) < 2 * len(kept):
        return None
    matrix = np.column_stack(kept)
    scale = np.sqrt((matrix**2).mean(0))
    scale[scale == 0] = 1.0
    matrix /= scale
    ridge = np.diag([0.0, *[1e-2 * np.sqrt(len(y))] * (len(kept) - 1)])
    wanted = y - y.mean()
    right = np.r_[wanted, np.zeros(len(kept))]
    weights = np.linalg.lstsq(np.vstack([matrix, ridge]), right, rcond=None)[0]
    return float(weights[0] / scale[0]), float(np.std(wanted - matrix @ weights))


REST, STAYS = 0.02, 0.1
"""Of an output's readings, the least ones, at rest; of a drift, by how much they move where it is none."""


def zero_drift(record: AbstractRecord) -> ZeroDrift | None:
    """How the zero of the output drifts in the sequence with most cycles; None where it does not surely.

    A line in time beside a function of the input's history, over three cycles at least. Its slopes over all
    rows, over the first and over the last three fifths have one sign, and the flattest, which is told, is
    a drift by more than what the function leaves unexplained, +- 2 standard deviations. Where the least
    readings stay what they were, to a tenth of that, the input drifts, not the output.
    """
    most = int(np.argmax(record.cycle_counts))
    part = [*_parts(record)][most]
    stride = max(1, len(part.y) // (2 * ROWS))
    u, y = part.u[::stride], part.y[::stride]
    if record.cycle_counts[most] < 3 or not len(y) or not np.ptp(u):
        return None
    t = np.linspace(0, 1, len(y))
    terms, each = _history(u, _LAGS[1:]), []  # the slowest lag is as good as a drift
    for rows in (t >= 0, t <= 0.6, t >= 0.4):
        if (found := _beside(t[rows], [one[rows] for one in terms], y[rows])) is None:
            return None
        each.append(found)
    slopes = [slope for slope, _ in each]
    flattest = min(slopes, key=abs)
    if min(slopes) * max(slopes) <= 0 or abs(flattest) <= 4 * each[0][1]:
        return None
    first, last = (np.quantile(y[rows], REST) for rows in (t <= 0.4, t >= 0.6))
    if abs(last - first) < STAYS * abs(flattest):
        return None
    return ZeroDrift(int(part.row[0]), int(part.row[-1]), flattest)


def lost_contact(record: AbstractRecord) -> list[LostContact]:
    """Where the output rests at its zero while the input moves on, as without contact; in their order.

    The zero is 0, or the first reading of a sequence. Contact is lost where the input goes over a fifth of
    its range, in which the branch mostly reads a tenth of the output's range beside the zero elsewhere, and
    twice as far as the output stays at any other level. A gap that opens in every cycle, a backlash and a
    plateau of friction are none of these.
    """
    (counted,) = in_rows(record.mask & np.isfinite(record.output), record.output)
    span = float(np.ptp(counted)) if len(counted) else 0.0
    chance, found = np.sqrt(2 * np.log(len(record) / CHANCE)), []
    for part in _parts(record) if span else ():
        u, y = part.u, part.y
        if len(u) < 2 * LEVELS or not np.ptp(u):
            continue
        least, turns = WAY * float(np.ptp(u)), turning_points(u, default_dead_band(u))
        band = max(chance * noise_level(y), 0.5 * LEAST * span)
        for near in {float(y[0]), 0.0}:
            close = in_pieces(_near, y, near, 2 * band)
            zero = float(np.median(close, overwrite_input=True)) if len(close) else near
            del close
            level = in_pieces(_level, y, zero, 2 * band)
            begin = np.flatnonzero(np.append(True, level[1:] != level[:-1]))
            end, rests = np.append(begin[1:], len(y)) - 1, level[begin] == 0
            if not rests.any():
                continue
            passed = _way(u, turns, end) - _way(u, turns, begin)
            long = rests & (passed > max(least, FURTHER * passed[~rests].max(initial=0.0)))
            for a, b in zip(begin[long].tolist(), end[long].tolist(), strict=True):
                if _touches_elsewhere(part, a, b, zero, 0.1 * span):
                    found.append(LostContact(int(part.row[a]), int(part.row[b]), zero))
    return sorted({(one.first, one.last): one for one in found}.values())


def _near(y: Rows, value: float, width: float) -> Float[np.ndarray, " some"]:
    """Those that are so near to a value."""
    return y[np.abs(y - value) <= width]


def _level(y: Rows, zero: float, width: float) -> Int8[np.ndarray, " rows"]:
    """How many widths each row is from zero: 51 at most of a record that has rows there."""
    return np.clip(np.round((y - zero) / width), -99, 99).astype(np.int8)


def _cell(u: Rows, low: float, span: float) -> Int8[np.ndarray, " rows"]:
    """In which part of the input's range each row is."""
    return np.minimum(LEVELS * (u - low) / span, LEVELS - 1).astype(np.int8)


def _way(u: Rows, turns: Int[np.ndarray, " turns"], at: Steps) -> Far:
    """How far the input has gone up to these of its rows, without what noise adds to it."""
    gone = np.r_[0.0, np.cumsum(np.abs(np.diff(u[turns])))]
    leg = np.searchsorted(turns, at, "right") - 1
    return gone[leg] + np.abs(u[at] - u[turns[leg]])


def _touches_elsewhere(part: _Part, first: int, last: int, zero: float, off: float) -> bool:
    """Whether in a fifth of the input's range three of four others on the branch read `off` beside it."""
    cell = in_pieces(_cell, part.u, float(part.u.min()), float(np.ptp(part.u)))
    cell += np.int8(LEVELS) * (branches(part.u) > 0)
    inside = np.zeros(len(cell), bool)
    inside[first : last + 1] = True
    far = set()
    for one in np.unique(cell[inside]).tolist():
        apart = np.abs(part.y[~inside & (cell == one)] - zero)
        if len(apart) and np.quantile(apart, 0.25) > off:
            far.add(one % LEVELS)
    return len(far) >= WAY * LEVELS
