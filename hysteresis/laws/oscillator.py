"""A mass on a spring, a damper and a hysteretic force, by Newmark's method: force in, displacement out.

Source: Newmark 1959.
"""

from ._codes import OK, Reals
from ._search import even_cell


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
    """Displacement, velocity, acceleration, hysteretic force in rate form, force and plays. `begun` is 0
    before the first sample, whose force gives the acceleration. The others are of the calculation."""

    status: int
    begun: int
    y: float
    v: float
    a: float
    z: float
    force: float
    play: Reals
    f: float
    steep: float
    total: float
    stretch: float


def rated(p: Parameters, s: State, falling: int) -> None:
    """f and its slope along z."""
    k = even_cell(p.knots - 1, (s.z + p.limit) * p.per)
    first = p.knots + k if falling else k
    s.steep = (p.rate[first + 1] - p.rate[first]) * p.per
    s.f = p.rate[first] + (p.rate[first + 1] - p.rate[first]) * ((s.z + p.limit) * p.per - k)


def pulled(p: Parameters, s: State, y: float) -> None:
    """The sum of the plays' curves at y, and its slope."""
    s.total = 0.0
    s.stretch = 0.0
    for j in range(p.plays):
        # A play that moves is as far from y as its radius.
        far = 0.0
        moves = 0
        if s.play[j] >= y + p.radii[j]:
            far = p.radii[j]
            moves = 1
        if s.play[j] <= y - p.radii[j]:
            far = -p.radii[j]
            moves = 1
        at = y + far if moves else s.play[j]
        k = even_cell(int(p.cells[j]), (at - p.low[j]) * p.scale[j])
        i = int(p.first[j]) + k
        s.total = s.total + p.heights[i]
        if moves:
            s.total = s.total + (p.heights[i + 1] - p.heights[i]) * (
                (far - p.low[j]) * p.scale[j] - k
            )
            s.stretch = s.stretch + (p.heights[i + 1] - p.heights[i]) * p.scale[j]
        else:
            s.total = s.total + (p.heights[i + 1] - p.heights[i]) * (
                (at - p.low[j]) * p.scale[j] - k
            )
    s.total = s.total + s.stretch * y


def taken(p: Parameters, s: State, y: float) -> None:
    """The plays go to y."""
    for j in range(p.plays):
        if s.play[j] > y + p.radii[j]:
            s.play[j] = y + p.radii[j]
        if s.play[j] < y - p.radii[j]:
            s.play[j] = y - p.radii[j]


def settled(p: Parameters, s: State, h: float, z0: float, push: float) -> float:
    """The acceleration at the end of a step, by Newton's method, and with it z by the trapezoidal rule,
    z = z0 + half v f(z), which is straight in each cell."""
    half = 0.5 * h
    quarter = 0.25 * h * h
    a1 = s.a
    for _turn in range(4):  # settles
        y1 = s.y + h * s.v + quarter * (s.a + a1)
        v1 = s.v + half * (s.a + a1)
        follow = 0.0
        if p.knots > 0:
            rated(p, s, v1 < 0.0)
            damp = 1.0 - half * v1 * s.steep
            s.z = s.z - (s.z - z0 - half * v1 * s.f) / damp  # vanishes
            follow = half * s.f / damp
        if p.plays > 0:
            pulled(p, s, y1)
        firm = p.mass + half * (p.damping + follow) + quarter * (p.stiffness + s.stretch)
        pull = p.mass * a1 + p.damping * v1 + p.stiffness * y1 + s.z + s.total
        change = (pull - push) / firm  # vanishes
        a1 = a1 - change
        if change * change < 1e-24 * a1 * a1:
            return a1
    return a1


def moved(p: Parameters, s: State, h: float, push: float) -> None:
    """One step of Newmark's method."""
    z0 = s.z
    if p.knots > 0:
        rated(p, s, s.v < 0.0)
        z0 = s.z + 0.5 * h * s.v * s.f
    a1 = settled(p, s, h, z0, push)
    s.y = s.y + h * s.v + 0.25 * h * h * (s.a + a1)
    s.v = s.v + 0.5 * h * (s.a + a1)
    s.a = a1
    if p.knots > 0:
        rated(p, s, s.v < 0.0)
        s.z = s.z - (s.z - z0 - 0.5 * h * s.v * s.f) / (1.0 - 0.5 * h * s.v * s.steep)  # vanishes
    taken(p, s, s.y)


def find(p: Parameters, s: State, dt: float, force: float) -> float:
    """The displacement at the sample whose force this is."""
    s.status = OK
    if not s.begun:
        pulled(p, s, s.y)
        taken(p, s, s.y)
        s.a = (force - p.damping * s.v - p.stiffness * s.y - s.z - s.total) / p.mass
        s.force = force
        s.begun = 1
        return s.y
    rise = (force - s.force) / p.substeps
    for k in range(p.substeps):
        moved(p, s, dt / p.substeps, force if k + 1 == p.substeps else s.force + rise * (k + 1))
    s.force = force
    return s.y
