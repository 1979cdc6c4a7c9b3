"""Newmark's average acceleration with the sensitivities of its implicit step: one compiled loop.

Import it where it is called: numba takes half a second to load. The law of this loop is the step of
`Oscillator`, which JAX runs; tests compare the two. A checker of types at run time would wrap the
functions, and numba cannot compile what wraps them.
"""

from typing import Any, no_type_check

import numpy as np
from numba import njit

FIXED = 7
"""Sensitivities before those of the hysteresis: m, c, k, constant force, and y, v, z at first."""

ITERATIONS = 12
CLOSE = 1e-13


@njit(cache=True)
@no_type_check
def _cell(x: float, low: float, per: float, count: int) -> Any:
    """The cell of even knots that x is in, the outer ones without end, and the place in it."""
    place = (x - low) * per
    cell = int(np.floor(place))
    cell = min(max(cell, 0), count - 2)
    return cell, place - cell


@njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def newmark(
    plant: Any, rate: Any, z_low: float, z_per: float,
    radii: Any, first: Any, low: Any, per: Any, heights: Any,
    force: Any, h: float, steps: int, skip: int, every: int, limit: float,
    state: Any, outputs: Any, sensitivities: Any,
) -> int:  # fmt: skip
    """Run `steps` samples of the fine force, which repeats; 1 where the motion left `limit`, else 0.

    - `plant`: mass, damping, stiffness, constant force.
    - `rate`: (2, n) values of f+ and f- at even knots from `z_low`, `z_per` of them a unit; n = 0 for none.
    - `radii`: of the plays. The heights of play j at even knots from low[j] on, per[j] of them a unit,
      are heights[first[j]:first[j + 1]].
    - `state`: y, v, a, z and the plays, before and after; an acceleration that is not a number is found.
    - `outputs`: y of the samples from `skip` on. `sensitivities`: (samples, parameters) of every `every`th
      of them, in the order `FIXED`, f+, f-, heights; of no column for none.
    """
    m, c, k, constant = plant[0], plant[1], plant[2], plant[3]
    knots, plays, count = rate.shape[1], len(radii), sensitivities.shape[1]
    half, quarter = 0.5 * h, 0.25 * h * h
    y, v, a, z = state[0], state[1], state[2], state[3]
    at, new = state[4:].copy(), state[4:].copy()
    slope, cell, place = np.zeros(plays), np.zeros(plays, np.int64), np.zeros(plays)
    moves, moved = np.zeros(plays, np.bool_), np.zeros(plays, np.bool_)
    total = 0.0
    for j in range(plays):
        at[j] = min(max(at[j], y - radii[j]), y + radii[j])
        cell[j], place[j] = _cell(at[j], low[j], per[j], first[j + 1] - first[j])
        w = first[j] + cell[j]
        slope[j] = (heights[w + 1] - heights[w]) * per[j]
        total += heights[w] + (heights[w + 1] - heights[w]) * place[j]
        moved[j] = radii[j] == 0.0
    if np.isnan(a):
        a = (force[0] - constant - c * v - k * y - z - total) / m
    sy, sv, sa, sz = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    stuck = np.zeros(count)
    of_play = np.zeros((plays if count else 0, count))
    if count:
        sy[4], sv[5], sz[6] = 1.0, 1.0, 1.0
        sa[0], sa[1], sa[2], sa[3] = -a / m, -v / m, -y / m, -1 / m
        sa[4], sa[5], sa[6] = -k / m, -c / m, -1 / m
        for j in range(plays):
            w = FIXED + 2 * knots + first[j] + cell[j]
            sa[w] -= (1 - place[j]) / m
            sa[w + 1] -= place[j] / m
            if moved[j]:
                sa[4] -= slope[j] / m
    row = 0
    for i in range(steps):
        if i >= skip:
            outputs[i - skip] = y
            if count and (i - skip) % every == 0:
                sensitivities[row, :] = sy
                row += 1
        if i + 1 == steps:
            break
        u = force[(i + 1) % len(force)]
        f0 = f0_z = f1 = f1_z = 0.0
        side0 = side1 = cell0 = cell1 = 0
        place0 = place1 = 0.0
        if knots:
            side0 = 1 if v < 0 else 0
            cell0, place0 = _cell(z, z_low, z_per, knots)
            f0_z = (rate[side0, cell0 + 1] - rate[side0, cell0]) * z_per
            f0 = rate[side0, cell0] + (rate[side0, cell0 + 1] - rate[side0, cell0]) * place0
        a1, z1 = a, z + h * v * f0
        y1, v1 = y + h * v + 2 * quarter * a, v + h * a
        stretch, damp = 0.0, 1.0
        for _ in range(ITERATIONS):
            y1 = y + h * v + quarter * (a + a1)
            v1 = v + half * (a + a1)
            if knots:
                side1 = 1 if v1 < 0 else 0
                for _ in range(
                    3
                ):  # f is straight in each cell: as a rule the first of these is exact
                    cell1, place1 = _cell(z1, z_low, z_per, knots)
                    f1_z = (rate[side1, cell1 + 1] - rate[side1, cell1]) * z_per
                    f1 = rate[side1, cell1] + (rate[side1, cell1 + 1] - rate[side1, cell1]) * place1
                    damp = 1 / (1 - half * v1 * f1_z)
                    off = z1 - z - half * (v * f0 + v1 * f1)
                    z1 -= off * damp
                    place1 -= off * damp * z_per
                    f1 -= off * damp * f1_z
                    if 0.0 <= place1 <= 1.0:
                        break
            total, stretch = z1, 0.0
            for j in range(plays):
                p = min(max(at[j], y1 - radii[j]), y1 + radii[j])
                moves[j] = p != at[j] or radii[j] == 0.0
                new[j] = p
                cell[j], place[j] = _cell(p, low[j], per[j], first[j + 1] - first[j])
                w = first[j] + cell[j]
                rise = heights[w + 1] - heights[w]
                slope[j] = rise * per[j]
                total += heights[w] + rise * place[j]
                if moves[j]:
                    stretch += slope[j]
            off = m * a1 + c * v1 + k * y1 + total + constant - u
            by = m + half * (c + damp * half * f1) + quarter * (k + stretch)
            a1 -= off / by
            if not abs(off) > CLOSE * (abs(m * a1) + abs(u) + abs(k * y1)):
                break
        y1 = y + h * v + quarter * (a + a1)
        v1 = v + half * (a + a1)
        if knots:
            f1z1 = damp * (z + half * v * f0 + half * v1 * (f1 - f1_z * z1))
            z1 = f1z1
        if count:
            for j in range(plays):
                if moved[j] and not moves[j]:  # it stops where y was: what it stands at is frozen
                    g = slope[j]
                    for x in range(count):
                        of_play[j, x] = sy[x]
                        stuck[x] += g * sy[x]
                elif moves[j] and not moved[j]:
                    w = first[j] + _cell(at[j], low[j], per[j], first[j + 1] - first[j])[0]
                    g = (heights[w + 1] - heights[w]) * per[j]
                    for x in range(count):
                        stuck[x] -= g * of_play[j, x]
            follow = damp * half * f1
            per_force = 1 / (m + half * (c + follow) + quarter * (k + stretch))
            keep, by_v = damp * (1 + half * v * f0_z), damp * half * f0
            stiff, drag = k + stretch, c + follow
            for x in range(count):
                ey = sy[x] + h * sv[x] + quarter * sa[x]
                ev = sv[x] + half * sa[x]
                ez = keep * sz[x] + by_v * sv[x]
                an = -(drag * ev + stiff * ey + stuck[x] + ez) * per_force
                sv[x] = ev + half * an
                sy[x] = ey + quarter * an
                sz[x] = ez + follow * (ev + half * an)
                sa[x] = an
            for e in range(4):
                push = a1 if e == 0 else v1 if e == 1 else y1 if e == 2 else 1.0
                an = -push * per_force
                sa[e] += an
                sv[e] += half * an
                sy[e] += quarter * an
                sz[e] += follow * half * an
            if knots:
                for e in range(4):
                    if e < 2:
                        x = FIXED + side0 * knots + cell0 + e
                        push = half * v * (place0 if e else 1 - place0) * damp
                    else:
                        x = FIXED + side1 * knots + cell1 + e - 2
                        push = half * v1 * (place1 if e == 3 else 1 - place1) * damp
                    an = -push * per_force
                    sa[x] += an
                    sv[x] += half * an
                    sy[x] += quarter * an
                    sz[x] += push + follow * half * an
            for j in range(plays):
                for e in range(2):
                    x = FIXED + 2 * knots + first[j] + cell[j] + e
                    an = -(place[j] if e else 1 - place[j]) * per_force
                    sa[x] += an
                    sv[x] += half * an
                    sy[x] += quarter * an
                    sz[x] += follow * half * an
        for j in range(plays):
            at[j], moved[j] = new[j], moves[j]
        y, v, a, z = y1, v1, a1, z1
        if not abs(y) < limit:
            return 1
    state[0], state[1], state[2], state[3] = y, v, a, z
    state[4:] = at
    return 0


@njit(cache=True, nogil=True)
@no_type_check
def plays_along(path: Any, radii: Any, plays: Any, out: Any, every: int) -> None:
    """The plays of some radii along a path, from `plays` on, which it changes: (samples, plays) of every
    `every`th point in `out`."""
    for j in range(len(radii)):
        p, r = plays[j], radii[j]
        for i in range(len(path)):
            p = min(max(p, path[i] - r), path[i] + r)
            if i % every == 0:
                out[i // every, j] = p
        plays[j] = p
