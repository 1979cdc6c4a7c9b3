"""Relays that are up before the first sample: what they add until the input has visited them."""

from ._codes import Reals
from ._search import cell_of


class Parameters:
    """2 orientation times the mass of those with alpha > greatest and beta < least, at pairs of nodes:
    `mass` (cells + 1, cells + 1), bilinear between. `edges` (cells + 1)."""

    cells: int
    edges: Reals
    mass: Reals


class State:
    """The least and the greatest input since the start."""

    status: int
    begun: int
    least: float
    greatest: float


def look(p: Parameters, s: State, u: float) -> float:
    n = p.cells
    seen = u
    if seen < p.edges[0]:
        seen = p.edges[0]
    if seen > p.edges[n]:
        seen = p.edges[n]
    least = seen
    greatest = seen
    if s.begun and s.least < least:
        least = s.least
    if s.begun and s.greatest > greatest:
        greatest = s.greatest
    i = cell_of(p.edges, n, greatest)
    f = (greatest - p.edges[i]) / (p.edges[i + 1] - p.edges[i])
    j = cell_of(p.edges, n, least)
    g = (least - p.edges[j]) / (p.edges[j + 1] - p.edges[j])
    row = i * (n + 1) + j
    low = p.mass[row] * (1.0 - g) + p.mass[row + 1] * g
    high = p.mass[row + n + 1] * (1.0 - g) + p.mass[row + n + 2] * g
    return low * (1.0 - f) + high * f


def move(p: Parameters, s: State, u: float) -> float:
    added = look(p, s, u)
    seen = u
    if seen < p.edges[0]:
        seen = p.edges[0]
    if seen > p.edges[p.cells]:
        seen = p.edges[p.cells]
    if not s.begun or seen < s.least:
        s.least = seen
    if not s.begun or seen > s.greatest:
        s.greatest = seen
    s.begun = 1
    return added
