"""The Prandtl-Ishlinskii model without bends: a line and a weighted sum of plays."""

from ._codes import OK, Reals


class Parameters:
    """y = offset + slope u + sum of w_k z_k, or of w_k (u - z_k) where it is `leading`.

    The half width of play k is thresholds_k + rates_k |du/dt|, the speed before the sample.
    """

    plays: int
    thresholds: Reals
    rates: Reals
    weights: Reals
    slope: float
    offset: float
    leading: int


class State:
    """The input, its speed, and the plays."""

    status: int
    u: float
    speed: float
    z: Reals


def held(p: Parameters, s: State, k: int, u: float) -> float:
    """Play k, where the input takes it."""
    r = p.thresholds[k] + p.rates[k] * s.speed
    z = s.z[k]
    if z < u - r:
        return u - r
    return u + r if z > u + r else z


def look(p: Parameters, s: State, u: float) -> float:
    y = p.offset + p.slope * u
    for k in range(p.plays):
        z = held(p, s, k, u)
        y = y + p.weights[k] * (u - z if p.leading else z)
    return y


def move(p: Parameters, s: State, dt: float, u: float) -> float:
    y = look(p, s, u)
    for k in range(p.plays):
        s.z[k] = held(p, s, k, u)
    way = u - s.u
    if dt > 0.0:
        s.speed = (way if way > 0.0 else -way) / dt
    else:
        s.speed = 0.0
    s.u = u
    return y


def find(p: Parameters, s: State, dt: float, y: float) -> float:
    # Play k is dragged up iff y lies above the output at u = z_k + r_k, down iff below that at z_k - r_k.
    # Once that is known of every play, y is linear in u.
    known = p.offset
    slope = p.slope
    for k in range(p.plays):
        w = -p.weights[k] if p.leading else p.weights[k]
        if p.leading:
            slope = slope + p.weights[k]
        r = p.thresholds[k] + p.rates[k] * s.speed
        if look(p, s, s.z[k] + r) < y:
            known = known - w * r
            slope = slope + w
        elif look(p, s, s.z[k] - r) > y:
            known = known + w * r
            slope = slope + w
        else:
            known = known + w * s.z[k]
    u = (y - known) / slope
    move(p, s, dt, u)
    s.status = OK
    return u
