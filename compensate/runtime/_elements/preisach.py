"""A Preisach model on a grid: along a branch and back, with the staircase of its open loops."""

from math import sqrt

from ._codes import EXTRAPOLATED, FLAT, OK, SATURATED, Reals


class Parameters:
    """On a branch from the reversal r, where the output was z_r, it is z = z_r + s q(u) with

        q(u) = s (R(u) - R(r)) + 2 orientation E(u, r),    s = +1 rising, -1 falling,

    y = offset + z. `everett` holds E between nodes (cells + 1, cells + 1), `diagonal` the masses of the
    half cells on the diagonal, `reversible` is R at the nodes. `scale` is cells per unit of input, 0 where
    the `edges` are uneven. z lies between `floor` and `ceiling`; a slope up to `flat`, per cell, is none,
    and a rise up to `margin` is rounding.
    """

    cells: int
    scale: float
    edges: Reals
    everett: Reals
    diagonal: Reals
    reversible: Reals
    orientation: float
    offset: float
    floor: float
    ceiling: float
    flat: float
    margin: float
    capacity: int


class State:
    """Input and output z at every reversal whose loop is open, the oldest first, and now.

    `rising`: which way they moved last. `forgotten`: loops that were, the smallest, as the stack was full.
    """

    status: int
    extremum: Reals
    level: Reals
    depth: int
    forgotten: int
    rising: int
    u: float
    z: float


def cell_of(p: Parameters, u: float) -> int:
    if p.scale > 0.0:
        first = int((u - p.edges[0]) * p.scale)
        return first if first < p.cells else p.cells - 1
    first = 0
    last = p.cells - 1
    while first < last:  # at most: log2(p.cells) + 1
        middle = (first + last + 1) // 2
        if p.edges[middle] <= u:
            first = middle
        else:
            last = middle - 1
    return first


def turn(p: Parameters, s: State, rising: int) -> None:
    """Open a loop where the way turns; a full stack forgets its smallest."""
    if rising != s.rising:
        if s.depth >= p.capacity:
            s.depth = s.depth - 2
            s.forgotten = s.forgotten + 1
        s.extremum[s.depth] = s.u
        s.level[s.depth] = s.z
        s.depth = s.depth + 1
        s.rising = rising


def branch(p: Parameters, r: float, z_r: float, rising: int, u: float) -> float:
    """z at u, on the branch from r."""
    j = cell_of(p, r)
    g = (r - p.edges[j]) / (p.edges[j + 1] - p.edges[j])
    i = cell_of(p, u)
    f = (u - p.edges[i]) / (p.edges[i + 1] - p.edges[i])
    row = j * (p.cells + 1) + i
    at = p.everett[row] * (1.0 - g) + p.everett[row + p.cells + 1] * g
    beyond = p.everett[row + 1] * (1.0 - g) + p.everett[row + p.cells + 2] * g
    E = at * (1.0 - f) + beyond * f + p.diagonal[i] * f * (f - 1.0) + p.diagonal[j] * g * (g - 1.0)
    R = p.reversible[i] + f * (p.reversible[i + 1] - p.reversible[i])
    R_r = p.reversible[j] + g * (p.reversible[j + 1] - p.reversible[j])
    return z_r + (R - R_r) + (2.0 if rising else -2.0) * p.orientation * E


def beyond_range(p: Parameters, u: float) -> float:
    """What the reversible part adds outside the edges, where it goes straight on."""
    n = p.cells
    if u > p.edges[n]:
        rise = p.reversible[n] - p.reversible[n - 1]
        return (u - p.edges[n]) * rise / (p.edges[n] - p.edges[n - 1])
    if u < p.edges[0]:
        return (u - p.edges[0]) * (p.reversible[1] - p.reversible[0]) / (p.edges[1] - p.edges[0])
    return 0.0


def within(p: Parameters, u: float) -> float:
    if u < p.edges[0]:
        return p.edges[0]
    return u if u < p.edges[p.cells] else p.edges[p.cells]


def look(p: Parameters, s: State, u: float) -> float:
    seen = within(p, u)
    depth = s.depth
    rising = s.rising
    if seen != s.u:
        rising = 1 if seen > s.u else 0
    r = s.extremum[depth - 1]
    z_r = s.level[depth - 1]
    if rising != s.rising:
        r = s.u
        z_r = s.z
        depth = depth + 1 if depth < p.capacity else depth - 1
    way = 1.0 if rising else -1.0
    while depth >= 3 and way * (seen - s.extremum[depth - 2]) >= 0.0:  # at most: p.capacity / 2
        depth = depth - 2
        r = s.extremum[depth - 1]
        z_r = s.level[depth - 1]
    return p.offset + branch(p, r, z_r, rising, seen) + beyond_range(p, u)


def move(p: Parameters, s: State, u: float) -> float:
    seen = within(p, u)
    if seen != s.u:
        turn(p, s, 1 if seen > s.u else 0)
    if s.rising:
        while s.depth >= 3 and seen >= s.extremum[s.depth - 2]:  # at most: p.capacity / 2
            s.depth = s.depth - 2
    else:
        while s.depth >= 3 and seen <= s.extremum[s.depth - 2]:  # at most: p.capacity / 2
            s.depth = s.depth - 2
    s.z = branch(p, s.extremum[s.depth - 1], s.level[s.depth - 1], s.rising, seen)
    s.u = seen
    return p.offset + s.z + beyond_range(p, u)


def find(p: Parameters, s: State, y: float) -> float:
    wanted = y - p.offset
    z = wanted if wanted > p.floor else p.floor
    if z > p.ceiling:
        z = p.ceiling
    if z != s.z:
        turn(p, s, 1 if z > s.z else 0)
    # Strictly beyond: on a flat branch z may equal a level whose input is not reached yet.
    if s.rising:
        while s.depth >= 3 and z > s.level[s.depth - 2]:  # at most: p.capacity / 2
            s.depth = s.depth - 2
    else:
        while s.depth >= 3 and z < s.level[s.depth - 2]:  # at most: p.capacity / 2
            s.depth = s.depth - 2
    u = solve(p, s, z)
    if z != s.z:
        s.u = u
    s.z = z
    if wanted == z:
        return s.u
    # Beyond saturation only the reversible part goes on, along its last increment.
    n = p.cells
    rise = p.reversible[n] - p.reversible[n - 1]
    width = p.edges[n] - p.edges[n - 1]
    if wanted < z:
        rise = p.reversible[1] - p.reversible[0]
        width = p.edges[1] - p.edges[0]
    if rise > p.flat:
        s.status = EXTRAPOLATED
        return s.u + (wanted - z) * width / rise
    s.status = SATURATED
    return s.u


def solve(p: Parameters, s: State, z: float) -> float:
    """The input nearest to s.u with s q = z - z_r; FLAT where q does not grow there."""
    up = s.rising
    sign = 1.0 if up else -1.0
    r = s.extremum[s.depth - 1]
    target = sign * (z - s.level[s.depth - 1])
    j = cell_of(p, r)
    g = (r - p.edges[j]) / (p.edges[j + 1] - p.edges[j])
    two = 2.0 * p.orientation
    # At a node q = sign reversible + two E + base, E between the two rows beside r.
    half = p.diagonal[j] * g * (g - 1.0)
    base = two * half - sign * (p.reversible[j] + g * (p.reversible[j + 1] - p.reversible[j]))
    everett = p.everett
    row = j * (p.cells + 1)
    next_row = row + p.cells + 1
    reversible = p.reversible

    # The branch ends where the loop it lies in closes, or at the bound.
    end = p.edges[p.cells] if up else p.edges[0]
    if s.depth >= 2:
        end = s.extremum[s.depth - 2]
    # The last cell, on the way, that is entered below the target. Flat ones are not gone through.
    goal = target - p.margin
    first = cell_of(p, s.u)
    last = cell_of(p, end)
    edge = last
    if up:
        while first < last:  # at most: log2(p.cells) + 1
            middle = (first + last + 1) // 2
            E = everett[row + middle] * (1.0 - g) + everett[next_row + middle] * g
            if reversible[middle] + two * E + base < goal:
                first = middle
            else:
                last = middle - 1
    else:
        while last < first:  # at most: log2(p.cells) + 1
            middle = (first + last) // 2 + 1
            E = everett[row + middle] * (1.0 - g) + everett[next_row + middle] * g
            if two * E - reversible[middle] + base < goal:
                first = middle - 1
            else:
                last = middle
    i = first

    # q - target = A f^2 + B f + C within the cell; dq/df has the sign of `sign`.
    E = everett[row + i] * (1.0 - g) + everett[next_row + i] * g
    C = sign * reversible[i] + two * E + base - target
    E = everett[row + i + 1] * (1.0 - g) + everett[next_row + i + 1] * g
    A = two * p.diagonal[i]
    B = sign * reversible[i + 1] + two * E + base - target - C - A
    square = B * B - 4.0 * A * C
    root = sqrt(square) if square > 0.0 else 0.0
    f = 0.0 if up else 1.0
    # Two forms of one root: the sign of B says which one does not cancel.
    if sign * B >= 0.0:
        bottom = B + sign * root
        if bottom != 0.0:
            f = -2.0 * C / bottom
    elif A != 0.0:
        f = (sign * root - B) / (2.0 * A)
    if f < 0.0:
        f = 0.0
    if f > 1.0:
        f = 1.0
    s.status = OK if sign * (2.0 * A * f + B) > p.flat else FLAT
    # At the edge of a flat cell the input may be anywhere in it.
    if i != edge:
        past = i + 2 if up else i - 1
        E = everett[row + past] * (1.0 - g) + everett[next_row + past] * g
        if sign * reversible[past] + two * E + base <= target + p.margin:
            s.status = FLAT
    u = p.edges[i] + f * (p.edges[i + 1] - p.edges[i])
    if up:
        if u < s.u:
            u = s.u
        return u if u < end else end
    if u > s.u:
        u = s.u
    return u if u > end else end
