"""Modes of a linear system with hysteretic channels between them: input in, output out.

Modes step exactly, as input and reactions go straight from step to step. What reactions come to at the end
of a step is a fixed point: laws over drives, drives over reactions, in turn. A turn leaves k h^2 / 6m of an
error, k the stiffness of a reaction.

Source: Van Loan 1978 (the steps).
"""

from collections.abc import Callable
from math import exp, fabs, log
from typing import Any

from ._codes import INVALID, OK, Reals

CLOSE = 1e-12
"""Part of the largest reaction so far that the last turn may change."""

SAME = 1e-9
"""Relative difference of steps that times of a clock have by rounding."""


class Parameters:
    """x_m' = p_m x_m + sum over k of b_mk v_k,   v = [u; w],   [y; z]_i = sum 2 Re(c_im x_m) + d_ik v_k

    w_i = N_i[z_i] + level_i z_i log s_i,   memory (s_i^2)' = z_i^2 - s_i^2

    p is `decay` and `turn`, b `enter` and `enters`, c `show` and `shows`: real and imaginary parts. There
    are `substeps` steps to a sample.
    """

    substeps: int
    modes: int
    channels: int
    memory: float
    decay: Reals
    turn: Reals
    enter: Reals
    enters: Reals
    show: Reals
    shows: Reals
    direct: Reals
    level: Reals


class State:
    """Modes `x` and `xs`, real and imaginary parts, input `u`, reactions `w` and squares of s. `begun` is 0
    before the first sample. The others are of the calculation, of steps `pace` long: what a mode keeps,
    and takes of signals that hold and rise, what a drive takes of a reaction at once."""

    status: int
    begun: int
    u: float
    x: Reals
    xs: Reals
    w: Reals
    square: Reals
    pace: float
    keep: Reals
    keeps: Reals
    hold: Reals
    holds: Reals
    rise: Reals
    rises: Reals
    gain: Reals
    stays: float
    free: Reals
    new: Reals
    change: float
    largest: float


def seen(p: Parameters, i: int, m: int, x: float, xs: float) -> float:
    """What signal i takes of a mode."""
    return 2.0 * (p.show[i * p.modes + m] * x - p.shows[i * p.modes + m] * xs)


def paced(p: Parameters, s: State, h: float) -> None:
    """The numbers of a step: with q = p h they are e^q, h (e^q - 1) / q and h (e^q - 1 - q) / q^2."""
    s.pace = h
    s.stays = exp(-h / p.memory)
    for m in range(p.modes):
        a = p.decay[m] * h
        b = p.turn[m] * h
        x = 1.0
        xs = 0.0
        for k in range(40):
            n = 42.0 - k
            keep = 1.0 + (a * x - b * xs) / n
            xs = (a * xs + b * x) / n
            x = keep
        s.rise[m] = 0.5 * h * x
        s.rises[m] = 0.5 * h * xs
        hold = 1.0 + 0.5 * (a * x - b * xs)
        holds = 0.5 * (a * xs + b * x)
        s.hold[m] = h * hold
        s.holds[m] = h * holds
        s.keep[m] = 1.0 + a * hold - b * holds
        s.keeps[m] = a * holds + b * hold
    for i in range(p.channels):
        for k in range(p.channels):
            total = 0.0
            for m in range(p.modes):
                j = m * (p.channels + 1) + k + 1
                x = s.rise[m] * p.enter[j] - s.rises[m] * p.enters[j]
                xs = s.rise[m] * p.enters[j] + s.rises[m] * p.enter[j]
                total = total + seen(p, i + 1, m, x, xs)
            s.gain[i * p.channels + k] = total


def drive(p: Parameters, s: State, i: int) -> float:
    """z_i, with the reactions that were found last."""
    z = s.free[i]
    for k in range(p.channels):
        z = z + s.gain[i * p.channels + k] * (s.new[k] - s.w[k])
    return z


def squared(s: State, i: int, z: float) -> float:
    """s_i^2 at the end of the step; not nothing."""
    square = s.stays * s.square[i] + (1.0 - s.stays) * z * z
    return square if square > 1e-300 else 1e-300


def taken(p: Parameters, s: State, i: int, output: float) -> None:
    """Keep what channel i gives."""
    z = drive(p, s, i)
    w = output + 0.5 * p.level[i] * z * log(squared(s, i, z))
    change = fabs(w - s.new[i])
    if change > s.change:
        s.change = change
    if fabs(w) > s.largest:
        s.largest = fabs(w)
    s.new[i] = w


def settled(
    look: Callable[[Any, float, float], float], p: Parameters, s: State, whole: Any, h: float,
) -> None:  # fmt: skip
    """The reactions at the end of the step."""
    done = 0
    for _turn in range(24):
        if not done:
            s.change = 0.0
            look(whole, h, 0.0)
            done = s.change <= CLOSE * s.largest
    if not done:
        s.status = INVALID
    look(whole, h, 1.0)
    for i in range(p.channels):
        s.square[i] = squared(s, i, drive(p, s, i))


def stepped(p: Parameters, s: State, u: float) -> None:
    """Modes and drives at the end of a step, as if the reactions held."""
    for i in range(p.channels):
        s.free[i] = p.direct[(i + 1) * (p.channels + 1)] * u
    for m in range(p.modes):
        first = m * (p.channels + 1)
        v = p.enter[first] * s.u
        vs = p.enters[first] * s.u
        for k in range(p.channels):
            v = v + p.enter[first + k + 1] * s.w[k]
            vs = vs + p.enters[first + k + 1] * s.w[k]
        r = p.enter[first] * (u - s.u)
        rs = p.enters[first] * (u - s.u)
        x = s.keep[m] * s.x[m] - s.keeps[m] * s.xs[m] + s.hold[m] * v - s.holds[m] * vs
        xs = s.keep[m] * s.xs[m] + s.keeps[m] * s.x[m] + s.hold[m] * vs + s.holds[m] * v
        s.x[m] = x + s.rise[m] * r - s.rises[m] * rs
        s.xs[m] = xs + s.rise[m] * rs + s.rises[m] * r
        for i in range(p.channels):
            s.free[i] = s.free[i] + seen(p, i + 1, m, s.x[m], s.xs[m])
    s.u = u


def landed(p: Parameters, s: State) -> None:
    """Modes, as the reactions have risen."""
    for m in range(p.modes):
        r = 0.0
        rs = 0.0
        for k in range(p.channels):
            j = m * (p.channels + 1) + k + 1
            r = r + p.enter[j] * (s.new[k] - s.w[k])
            rs = rs + p.enters[j] * (s.new[k] - s.w[k])
        s.x[m] = s.x[m] + s.rise[m] * r - s.rises[m] * rs
        s.xs[m] = s.xs[m] + s.rise[m] * rs + s.rises[m] * r
    for k in range(p.channels):
        s.w[k] = s.new[k]


def shown(p: Parameters, s: State) -> float:
    """The output."""
    y = p.direct[0] * s.u
    for k in range(p.channels):
        y = y + p.direct[k + 1] * s.w[k]
    for m in range(p.modes):
        y = y + seen(p, 0, m, s.x[m], s.xs[m])
    return y


def find(
    look: Callable[[Any, float, float], float],
    p: Parameters, s: State, whole: Any, dt: float, u: float,
) -> float:  # fmt: skip
    """The output at the sample whose input this is. It begins at rest, and s with the first drive."""
    s.status = OK
    if not s.begun:  # a step of no length
        s.begun = 1
        stepped(p, s, u)
        settled(look, p, s, whole, 0.0)
        landed(p, s)
        return shown(p, s)
    h = dt / p.substeps
    if fabs(h - s.pace) > SAME * h:
        paced(p, s, h)
    rise = (u - s.u) / p.substeps
    first = s.u
    for k in range(p.substeps):
        stepped(p, s, u if k + 1 == p.substeps else first + rise * (k + 1))
        settled(look, p, s, whole, h)
        landed(p, s)
    return shown(p, s)
