"""The generalised Prandtl-Ishlinskii operator: a curve of every play.

Source: Al Janaideh, Rakheja and Su 2011; Krasnosel'skii and Pokrovskii 1989.
"""

from ._codes import Reals
from ._search import even_cell


class Parameters:
    """y = sum of g_j(play of radii_j). g_j is straight between even knots from `low` on, `scale` of them a
    unit, and on beyond them: `cells` of the `heights` from `first` on."""

    plays: int
    radii: Reals
    low: Reals
    scale: Reals
    first: Reals
    cells: Reals
    heights: Reals


class State:
    """The input, and every play."""

    status: int
    u: float
    play: Reals


def held(p: Parameters, s: State, j: int, u: float) -> float:
    """Play j, where the input takes it."""
    if s.play[j] > u + p.radii[j]:
        return u + p.radii[j]
    return u - p.radii[j] if s.play[j] < u - p.radii[j] else s.play[j]


def look(p: Parameters, s: State, u: float) -> float:
    y = 0.0
    for j in range(p.plays):
        place = (held(p, s, j, u) - p.low[j]) * p.scale[j]
        k = even_cell(int(p.cells[j] + 0.5), place)  # counts are whole
        i = int(p.first[j] + 0.5) + k
        y = y + p.heights[i] + (p.heights[i + 1] - p.heights[i]) * (place - k)
    return y


def move(p: Parameters, s: State, u: float) -> float:
    y = look(p, s, u)
    for j in range(p.plays):
        s.play[j] = held(p, s, j, u)
    s.u = u
    return y
