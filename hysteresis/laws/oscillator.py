"""A mass on a spring, a damper and a hysteretic force, by Newmark's method: force in, displacement out.

Source: Newmark 1959.
"""

from ._codes import OK, Reals


class Parameters:
    """mass a + damping v + stiffness y + z + sum of the plays' curves = force,     dz/dt = f(z, sign v) v.

    A sample takes `substeps` steps; the force is straight since the one before. f is `rate` at `knots` even
    knots from -`limit` on, `per` of them a unit, first while the mass rises, then while it falls. Plays of
    `radii`: their curves at even knots from `low` on, `scale` of them a unit, are `cells` of the `heights`
    from `first` on.
    """

    substeps: int
    mass: float
    damping: float
    stiffness: float
    knots: int
    limit: float
    per: float
    rate: Reals
    plays: int
    radii: Reals
    low: Reals
    scale: Reals
    first: Reals
    cells: Reals
    heights: Reals


class State:
    """Displacement, velocity, acceleration, hysteretic force in rate form, force and plays; `begun` is 0
    before the first sample, which is at rest. The others are of the calculation."""

    status: int
    begun: int
    y: float
    v: float
    a: float
    z: float
    force: float
    play: Reals
    next: Reals
    f: float
    steep: float
    total: float
    stretch: float


def rated(p: Parameters, s: State, z: float, v: float) -> None:
    """f and its slope along z."""
    first = p.knots if v < 0.0 else 0
    place = (z + p.limit) * p.per
    k = 0
    if place > 0.0:
        k = p.knots - 2
        if place < k:
            k = int(place)
    rise = p.rate[first + k + 1] - p.rate[first + k]
    s.steep = rise * p.per
    s.f = p.rate[first + k] + rise * (place - k)


def pulled(p: Parameters, s: State, y: float) -> None:
    """The plays at y, the sum of their curves and its slope."""
    s.total = 0.0
    s.stretch = 0.0
    for j in range(p.plays):
        at = s.play[j]
        moves = p.radii[j] == 0.0
        if at > y + p.radii[j]:
            at = y + p.radii[j]
            moves = 1
        if at < y - p.radii[j]:
            at = y - p.radii[j]
            moves = 1
        s.next[j] = at
        place = (at - p.low[j]) * p.scale[j]
        k = 0
        if place > 0.0:
            k = int(p.cells[j]) - 1
            if place < k:
                k = int(place)
        begin = int(p.first[j]) + k
        rise = p.heights[begin + 1] - p.heights[begin]
        s.total = s.total + p.heights[begin] + rise * (place - k)
        if moves:
            s.stretch = s.stretch + rise * p.scale[j]


def moved(p: Parameters, s: State, h: float, push: float) -> None:
    """One step of Newmark's method: Newton's iterations for the acceleration."""
    half = 0.5 * h
    quarter = 0.25 * h * h
    z0 = s.z
    if p.knots > 0:
        rated(p, s, s.z, s.v)
        z0 = s.z + half * s.v * s.f
    z1 = s.z
    a1 = s.a
    turn = 0
    while turn < 4:  # at most: 4
        y1 = s.y + h * s.v + quarter * (s.a + a1)
        v1 = s.v + half * (s.a + a1)
        follow = 0.0
        if p.knots > 0:
            for _inner in range(2):
                rated(p, s, z1, v1)
                damp = 1.0 / (1.0 - half * v1 * s.steep)
                off = (z1 - z0 - half * v1 * s.f) * damp
                z1 = z1 - off
                follow = damp * half * (s.f - off * s.steep)
        pulled(p, s, y1)
        missing = p.mass * a1 + p.damping * v1 + p.stiffness * y1 + z1 + s.total - push
        firm = p.mass + half * (p.damping + follow) + quarter * (p.stiffness + s.stretch)
        change = missing / firm
        a1 = a1 - change
        turn = turn + 1
        if change * change < 1e-24 * a1 * a1:
            turn = 4
    s.y = s.y + h * s.v + quarter * (s.a + a1)
    s.v = s.v + half * (s.a + a1)
    s.a = a1
    s.z = z1
    for j in range(p.plays):
        s.play[j] = s.next[j]


def find(p: Parameters, s: State, dt: float, force: float) -> float:
    """The displacement at the sample whose force this is."""
    s.status = OK
    if not s.begun:
        pulled(p, s, 0.0)
        s.a = (force - s.total) / p.mass
        s.force = force
        s.begun = 1
        return s.y
    rise = (force - s.force) / p.substeps
    for k in range(p.substeps):
        moved(p, s, dt / p.substeps, force if k + 1 == p.substeps else s.force + rise * (k + 1))
    s.force = force
    return s.y
