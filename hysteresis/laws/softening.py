"""First-cycle conditioning: what an input has never reached is stiffer than what it has.

Source: Ogden and Roxburgh, Proc. R. Soc. A 455 (1999), for the largest deformation so far.
"""

from math import exp

from ._codes import Reals


class Parameters:
    """y = sum over i <= j of weights_ij r_i(u) S_j, `leading` of weights_ij (r_i(u) (1 - S_j) + r_j(u)).

    r_i is a ramp over cell i of an even grid from `low`, `scale` cells per unit of input; `forgetting` is
    one over the time in which conditioning is forgotten; `columns` are the sums of the weights over i.
    """

    cells: int
    low: float
    scale: float
    weights: Reals
    columns: Reals
    forgetting: float
    leading: int


class State:
    """How far every cell is conditioned, 0 to 1."""

    status: int
    reached: Reals


def ramp(p: Parameters, cell: int, u: float) -> float:
    x = (u - p.low) * p.scale - cell
    if x < 0.0:
        return 0.0
    return x if x < 1.0 else 1.0


def look(p: Parameters, s: State, dt: float, u: float) -> float:
    kept = exp(-dt * p.forgetting)
    y = 0.0
    for j in range(p.cells):
        own = ramp(p, j, u)
        reached = s.reached[j] * kept
        if reached < own:
            reached = own
        drive = 0.0
        for i in range(j + 1):
            drive = drive + ramp(p, i, u) * p.weights[i * p.cells + j]
        y = y + (drive * (1.0 - reached) + own * p.columns[j] if p.leading else drive * reached)
    return y


def move(p: Parameters, s: State, dt: float, u: float) -> float:
    y = look(p, s, dt, u)
    kept = exp(-dt * p.forgetting)
    for j in range(p.cells):
        own = ramp(p, j, u)
        s.reached[j] = s.reached[j] * kept
        if s.reached[j] < own:
            s.reached[j] = own
    return y
