"""A curve that never falls: parabolas from node to node, straight on beyond the ends."""

from math import sqrt

from ._codes import EXTRAPOLATED, FLAT, OK, SATURATED, Reals


class Parameters:
    """Nodes and outputs (cells + 1), slopes at the start and at the end of every cell.

    Outputs closer than `margin` are one output; inputs farther apart than `flat` with one output are FLAT.
    An `endless` curve is known beyond its ends.
    """

    cells: int
    nodes: Reals
    outputs: Reals
    starts: Reals
    ends: Reals
    margin: float
    flat: float
    endless: int


class State:
    """The last estimate: where a curve is flat, the input nearest to it is taken."""

    status: int
    value: float


def cell_of(rising: Reals, cells: int, x: float) -> int:
    """The last cell that begins at x or before; the first one where none does."""
    first = 0
    last = cells - 1
    while first < last:  # at most: log2(cells) + 1
        middle = (first + last + 1) // 2
        if rising[middle] <= x:
            first = middle
        else:
            last = middle - 1
    return first


def cell_before(rising: Reals, cells: int, x: float) -> int:
    """The last cell that begins before x; the first one where none does."""
    first = 0
    last = cells - 1
    while first < last:  # at most: log2(cells) + 1
        middle = (first + last + 1) // 2
        if rising[middle] < x:
            first = middle
        else:
            last = middle - 1
    return first


def look(p: Parameters, s: State, u: float) -> float:
    k = cell_of(p.nodes, p.cells, u)
    width = p.nodes[k + 1] - p.nodes[k]
    along = u - p.nodes[k]
    inside = along if along > 0.0 else 0.0
    if inside > width:
        inside = width
    gain = (p.ends[k] - p.starts[k]) / width * inside
    straight = (p.starts[k] + gain) * (along - inside)
    return p.outputs[k] + (p.starts[k] + gain / 2.0) * inside + straight


def move(p: Parameters, s: State, u: float) -> float:
    return look(p, s, u)


def place(p: Parameters, k: int, y: float) -> float:
    """Where the parabola of cell k has this output; its end where it is flat."""
    rise = y - p.outputs[k]
    start = p.starts[k]
    width = p.nodes[k + 1] - p.nodes[k]
    height = p.outputs[k + 1] - p.outputs[k]
    inside = rise if rise > 0.0 else 0.0
    if inside > height:
        inside = height
    # x = 2 rise / (start + slope at x): no difference of like numbers, whatever the slopes.
    square = start * start + 2.0 * (p.ends[k] - start) / width * inside
    both = start + (sqrt(square) if square > 0.0 else 0.0)
    if both > 0.0:
        along = 2.0 * inside / both
    else:
        along = 0.0 if y < p.outputs[k + 1] else width
    if along > width:
        along = width
    outer = start if rise < 0.0 else p.ends[k]
    beyond = (rise - inside) / outer if outer > 0.0 else 0.0
    return p.nodes[k] + along + beyond


def find(p: Parameters, s: State, y: float) -> float:
    # The first input whose output is within the margin of y, and the last one.
    low = y - p.margin
    high = y + p.margin
    first = place(p, cell_before(p.outputs, p.cells, low), low)
    last = place(p, cell_of(p.outputs, p.cells, high), high)
    u = s.value if s.value > first else first
    if u > last:
        u = last
    s.value = u
    s.status = OK
    if p.endless:
        return u
    if high < p.outputs[0]:
        s.status = EXTRAPOLATED if p.starts[0] > 0.0 else SATURATED
    elif low > p.outputs[p.cells]:
        s.status = EXTRAPOLATED if p.ends[p.cells - 1] > 0.0 else SATURATED
    elif last - first > p.flat:
        s.status = FLAT
    return u
