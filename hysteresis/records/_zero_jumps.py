"""A zero that jumps: the output steps once while its input moves on, and keeps the step."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ._abstract_record import AbstractRecord
from ._cycles import default_dead_band, noise_level, turning_points

LEAST = 0.02
"""Of the output's range: a smaller step of the zero changes no model."""

SUDDEN = 5.0
"""Times the largest of the steps beside it that a jump is: material and sensor take several rows."""

BESIDE = 5
"""Rows on either side that are looked at."""

EXPLAINS = 4.0
"""Times by which the scatter between equal branches falls once a jump is taken out: half of the difference
between them, squared, would be left by a jump of twice the size."""

MOST = 8
"""Candidates that are tried, the largest first."""

_LEVELS = 32


class ZeroJump(NamedTuple):
    """The first row after a jump, and by how much the output jumped there."""

    row: int
    size: float


def zero_jumps(record: AbstractRecord) -> list[ZeroJump]:
    """Where the zero of the output has jumped, as a tare in the middle of a run does; in their order.

    A jump is a step from one row to the next, sudden beside its neighbours, in which the input moves as
    before. Snaps of a specimen are as sudden, but come back in every cycle: only with a jump of the *zero*
    taken out do equal branches before and behind it lie on each other. A record without a branch that is
    passed twice tells nothing.
    """
    found = []
    for _, rows in record.sequences():
        u, y = record.input[rows], np.where(record.mask[rows], record.output[rows], np.nan)
        jumps: list[ZeroJump] = []
        candidates = _sudden(u, y) if len(u) > 4 * BESIDE else []
        if candidates:
            legs = _legs(u)
            before = _scatter(u, y, legs)
            for jump in candidates:
                without = np.append(y[: jump.row], y[jump.row :] - jump.size)
                after = _scatter(u, without, legs)
                if EXPLAINS * after < before:
                    jumps.append(jump)
                    y, before = without, after
        found += [jump._replace(row=rows.start + jump.row) for jump in jumps]
    return sorted(found)


def _sudden(u: Float[np.ndarray, " rows"], y: Float[np.ndarray, " rows"]) -> list[ZeroJump]:
    """Steps of the output that stand out, where those of the input do not; the largest first."""
    good = np.isfinite(y)
    if good.sum() < len(y):
        y = np.interp(np.arange(len(y)), np.flatnonzero(good), y[good]) if good.any() else 0 * u
    steps, moves = np.diff(y), np.abs(np.diff(u))
    least = max(LEAST * np.ptp(y), 8 * noise_level(y))
    found = []
    for k in np.flatnonzero(np.abs(steps) > least):
        near = np.r_[max(k - BESIDE, 0) : k, k + 1 : min(k + 1 + BESIDE, len(steps))]
        if abs(steps[k]) < SUDDEN * np.abs(steps[near]).max():
            continue
        if moves[k] > 2 * moves[near].max():  # the input jumped, too
            continue
        found.append(ZeroJump(int(k) + 1, float(steps[k] - np.median(steps[near]))))
    return sorted(found, key=lambda jump: -abs(jump.size))[:MOST]


def _legs(u: Float[np.ndarray, " rows"]) -> list[tuple[bool, np.ndarray]]:
    """Whether each leg of the input rises, and its rows in the order of the input."""
    points = turning_points(u, default_dead_band(u))
    return [
        (bool(u[b] > u[a]), rows[np.argsort(u[rows], kind="stable")])
        for a, b in pairwise(points.tolist())
        for rows in [np.arange(a, b + 1)]
    ]


def _scatter(
    u: Float[np.ndarray, " rows"],
    y: Float[np.ndarray, " rows"],
    legs: list[tuple[bool, np.ndarray]],
) -> float:
    """Mean variance of the output between legs of one direction, at inputs that several of them pass."""
    levels = np.linspace(u.min(), u.max(), _LEVELS + 2)[1:-1]
    squares = []
    for way in (True, False):
        curves = np.array(
            [
                np.interp(levels, u[rows], y[rows], left=np.nan, right=np.nan)
                for rises, rows in legs
                if rises == way
            ]
        )
        if len(curves) < 2:
            continue
        seen = np.isfinite(curves).sum(0) >= 2
        squares.append(np.nanvar(curves[:, seen], axis=0, ddof=1))
    return float(np.concatenate(squares).mean()) if squares and sum(map(len, squares)) else 0.0
