"""Between the samples of a record and the fine steps of an integration: interpolation and decimation."""

import numpy as np
import scipy
from jaxtyping import Float

from .._errors import InputError

TAPS = 31
"""Of the low-pass filter of each stage, as of MATLAB's decimate(x, r, 'fir')."""

REACH, KAISER = 32, 14.0
"""Half width, in samples, and shape of the window of the interpolating sinc: -136 dB beyond its band."""

LAGS, LEARNT = 48, 2000
"""A record is continued by so many lags of linear prediction, learnt from so many rows at its end."""


Samples = Float[np.ndarray, " samples"]
Fine = Float[np.ndarray, " fine"]


def clock(count: int, h: float) -> Float[np.ndarray, " rows"]:
    """Times since the row before, of an even clock that begins."""
    return np.append(np.nan, np.full(count - 1, h))


def stages_of(factor: int) -> tuple[int, ...]:
    """A decimation factor in stages of prime factors, the smallest first: 20 is (2, 2, 5)."""
    found = []
    for prime in range(2, factor + 1):
        while factor % prime == 0:
            found.append(prime)
            factor //= prime
    return tuple(found)


def decimated(fine: Fine, stages: tuple[int, ...], periodic: bool = False) -> Samples:
    """The samples that a recorder keeps of a fine signal: low-passed and thinned, stage by stage.

    The delay of the filter is taken out. A signal that is not `periodic` is continued beyond its ends by
    mirroring it through them. Without stages it comes back as it is.

    Source: MATLAB's decimate(x, r, 'fir'), a Hamming window of order 30; Crochiere and Rabiner 1983.

    **Example:**

        >>> hysteresis.decimated(1 + np.arange(41.0), (20,)).round(6).tolist()
        [1.0, 21.0, 41.0]
    """
    x, ends = np.asarray(fine, float), "wrap" if periodic else "antireflect"
    for factor in stages:
        if len(x) <= TAPS // 2:
            said = f"{len(x)} steps cannot be low-passed by a filter of {TAPS} taps."
            raise InputError("too-few-rows", said, fix="give a longer record.")
        taps = scipy.signal.firwin(TAPS, 1 / factor)
        x = scipy.signal.resample_poly(x, 1, factor, window=taps, padtype=ends)
    return x


def interpolated(
    samples: Samples, factor: int, between: str = "band-limited", periodic: bool = False
) -> Fine:
    """The force at `factor` fine steps a sample; a periodic one ends a step before its first sample comes
    again, another one with its last sample.

    Band-limited: exact for a periodic force (a longer spectrum); otherwise a sinc in a Kaiser window of 32
    samples to both sides, after the record was continued by linear prediction. Below 0.8 of the Nyquist
    frequency and away from the ends it errs by 1e-7.

    **Example:**

        >>> hysteresis.interpolated(np.array([0.0, 2.0, 4.0]), 2, "linear").tolist()
        [0.0, 1.0, 2.0, 3.0, 4.0]
    """
    u = np.asarray(samples, float)
    n = len(u)
    count = n * factor if periodic else (n - 1) * factor + 1
    if factor == 1:
        return u.copy()
    if between == "held":
        return np.repeat(u, factor)[:count]
    if between == "linear":
        return np.interp(np.arange(count) / factor, np.arange(n + 1), np.append(u, u[0]))
    if periodic:
        return scipy.signal.resample(u, count)  # exact
    wide = np.concatenate([_predicted(u[::-1])[::-1], u, _predicted(u)])
    half = REACH * factor
    taps = np.sinc(np.arange(-half, half + 1) / factor) * np.kaiser(2 * half + 1, KAISER)
    return scipy.signal.upfirdn(taps, wide, factor)[2 * half :][:count]


def _predicted(u: np.ndarray) -> np.ndarray:
    """The next `REACH` samples: each the linear combination of the last `LAGS` that fits the last rows."""
    u = u[-LEARNT:]
    lags = min(LAGS, len(u) // 4)
    scale = float(np.abs(u).max())
    if lags < 2 or scale == 0:
        return np.full(REACH, u[-1])
    rows = np.lib.stride_tricks.sliding_window_view(u / scale, lags + 1)
    gram = rows[:, :-1].T @ rows[:, :-1]
    gram += 1e-12 * np.trace(gram) * np.eye(lags)
    weights = np.linalg.solve(gram, rows[:, :-1].T @ rows[:, -1])
    last = list(u[-lags:] / scale)
    for _ in range(REACH):
        last.append(float(np.clip(weights @ last[-lags:], -2, 2)))
    return scale * np.array(last[lags:])
