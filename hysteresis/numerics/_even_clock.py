"""Even clocks: recognised by the resolution that their times were printed with."""

import numpy as np
from jaxtyping import Float

MOST_DECIMALS = 12
"""Decimals of a printed time, at most; times with more are taken for exact."""

COARSEST = 0.1
"""Resolution of the times, as a part of a step, up to which a clock may be taken for even."""


def even_step(t: Float[np.ndarray, " samples"], starts: tuple[int, ...] = (0,)) -> float | None:
    """The step of a clock that is even to its resolution, in every sequence; None for an uneven one.

    The resolution is the last decimal that is needed to write the times down. A logger at 300 Hz that
    prints `0.0033, 0.0067, 0.01` has an even clock, with times that are wrong by up to half of 1e-4. The
    clock is even where every time is within one resolution of start + k step, and the resolution is a tenth
    of a step at most, or where all steps are equal to the rounding of a float. So a model's output under
    the even clock differs from that at the printed times by no more than the resolution times the rate at
    which the output changes.

    **Arguments:** `t`, times, (samples,); `starts`, first samples of the independent sequences.

    **Example:**

        >>> from hysteresis.numerics._even_clock import even_step
        >>> round(even_step(np.array([0.0, 0.0033, 0.0067, 0.01])), 6)
        0.003333
        >>> even_step(np.array([0.0, 0.1, 0.3, 0.4])) is None
        True
    """
    first = np.asarray(starts)
    lengths = np.diff(np.append(first, len(t)))
    steps = len(t) - len(first)
    if not steps:
        return None
    step = float(np.sum(t[first + lengths - 1] - t[first])) / steps
    rounding = 4 * float(np.finfo(t.dtype).eps) * float(np.abs(t).max())
    spread = float(np.ptp(np.delete(np.diff(t), first[1:] - 1)))
    if spread <= rounding:
        return step
    # A resolution that is no small part of a step may hide an uneven clock.
    unit = _resolution(t, rounding) if spread < step else step
    if unit > COARSEST * step:
        return None
    away = t - np.repeat(t[first], lengths) - step * (np.arange(len(t)) - np.repeat(first, lengths))
    return step if np.all(np.abs(away) <= unit + rounding) else None


def _resolution(t: Float[np.ndarray, " samples"], rounding: float) -> float:
    """The last decimal of the latest times; 0 where it cannot be told from the rounding of a float.

    Of the power of ten in which most times lie it is the last one that they need. Above, a given number of
    digits is a decimal less for every power of ten.
    """
    power = np.floor(np.log10(np.maximum(np.abs(t), 1e-300))).astype(int)
    powers, counts = np.unique(power, return_counts=True)
    usual = int(powers[np.argmax(counts)])
    unit = most = _last_decimal(t[power == usual], rounding)
    for k in powers[powers > usual].tolist():
        unit = max(unit, min(_last_decimal(t[power == k], rounding), most * 10.0 ** (k - usual)))
    return unit


def _last_decimal(t: Float[np.ndarray, " samples"], rounding: float) -> float:
    for decimals in range(MOST_DECIMALS + 1):
        unit = 10.0**-decimals
        if np.max(np.abs(t - unit * np.round(t / unit))) <= rounding:
            return unit
    return 0.0
