"""Noise of readings whose neighbours may be alike, as behind a filter: its size, and how long it lasts.

    R(k) = sigma^2 ((1 - share) [k = 0] + share keeps^|k|)

is the covariance of the noise of rows k apart: a part that is new in every row, and one that fades.
"""

from math import comb
from typing import NamedTuple

import numpy as np
import scipy

from ._cycles import noise_level

ORDER = 6
"""Of the highest differences: they leave nothing of a smooth signal."""

BLOCKS = 16
"""Means of rows that a leg has at least: fewer do not follow its bend."""

ALIKE = 0.8
"""Of the largest level by differences of the last three orders: noise has one level, what is left of a bend
fades from order to order, and what is left of a corner grows."""

SPREAD = 10.0
"""Times 1 / n: variance of the logarithm of a squared level that n means tell, measured on white noise."""

SURE = 9.21
"""Chi square of two degrees of freedom that chance exceeds once in a hundred."""

LASTS = 1 - 1 / np.geomspace(1.5, 400, 40)
SHARES = 1 - np.geomspace(1, 1e-5, 26)[1:]
"""Tried for `keeps` and `share`."""


class RowNoise(NamedTuple):
    """Noise of several series, (k,) each: standard deviation, share of it that fades, and by how much."""

    sigma: np.ndarray
    share: np.ndarray
    keeps: np.ndarray

    def grown(self, rows: np.ndarray | float) -> np.ndarray:
        """The variance of a mean of so many rows, of what it is where neighbours have nothing alike."""
        return 1 + self.share * _alike(self.keeps, rows)

    def at(self, which: np.ndarray) -> "RowNoise":
        """The noise of these series."""
        return RowNoise(*(x[which] for x in self))

    def of(self, weights: np.ndarray) -> np.ndarray:
        """The standard deviation of a sum of successive rows with these weights, (n,) or (k, n)."""
        total = np.sum(weights**2, axis=-1)
        for lag in range(1, weights.shape[-1]) if self.share.any() else ():
            alike = np.sum(weights[..., lag:] * weights[..., :-lag], axis=-1)
            total = total + 2 * self.share * self.keeps**lag * alike
        return self.sigma * np.sqrt(np.maximum(total, 0.0))

    def means(self, rows: int) -> "RowNoise":
        """The noise of means of so many rows each."""
        grown, slow = self.grown(rows), self.share * (1 + _alike(self.keeps, rows))
        ratio = (1 + self.keeps) / (1 - self.keeps) / (1 + _alike(self.keeps, rows))
        return RowNoise(self.sigma * np.sqrt(grown / rows), slow / grown, (ratio - 1) / (ratio + 1))


def _alike(keeps: np.ndarray, rows: np.ndarray | float) -> np.ndarray:
    """What the alikeness of neighbours adds to the variance of a mean of so many rows."""
    return 2 * keeps / (1 - keeps) * (1 - (1 - keeps**rows) / (rows * (1 - keeps)))


def student(freedom: int) -> float:
    """How many times wider a 90 % interval is whose standard error so many degrees of freedom tell."""
    return float(scipy.special.stdtrit(freedom, 0.95) / scipy.special.ndtri(0.95))


def row_noise(x: np.ndarray, first: np.ndarray, stop: np.ndarray) -> tuple[float, float, float]:
    """`sigma`, `share` and `keeps` of a smooth series with legs from each first row to before its stop.

    White noise has one level at all scales: the means of m rows have 1 / sqrt(m) of it. Where their level
    grows, that tells how long the noise lasts.
    """
    sigma, legs = noise_level(x), stop - first
    sizes, squares, counts = [1], [sigma**2], [float(len(x))]
    most = int(np.median(legs)) // BLOCKS if len(legs) and sigma > 0 else 0
    while 2 * sizes[-1] <= most:
        size = 2 * sizes[-1]
        level, count = _level_of_means(x, first, legs // size, size)
        if not level > 0:
            break
        sizes.append(size)
        squares.append(size * level**2)
        counts.append(count)
    if len(sizes) < 3:
        return sigma, 0.0, 0.0
    weights, told = np.array(counts) / SPREAD, np.log(squares)
    # What lasts longer than the largest means is not seen in them.
    lasts = LASTS[1 - 1 / sizes[-1] >= LASTS][:, None]
    shares = SHARES[:, None, None]
    shapes = np.log(1 - shares + shares * _levels(lasts, np.array(sizes)))
    off = told - np.concatenate([np.zeros((1, *shapes.shape[1:])), shapes])
    mean = off @ weights / weights.sum()
    missed = (off - mean[..., None]) ** 2 @ weights
    share, keeps = np.unravel_index(int(missed.argmin()), missed.shape)
    if missed[0, 0] - missed[share, keeps] < SURE:
        return sigma, 0.0, 0.0
    return float(np.exp(mean[share, keeps] / 2)), float(SHARES[share - 1]), float(LASTS[keeps])


def _level_of_means(
    x: np.ndarray, first: np.ndarray, blocks: np.ndarray, size: int
) -> tuple[float, float]:
    """Standard deviation of the noise of means of `size` rows within legs, and how many means tell it; 0
    where a signal remains."""
    leg = np.repeat(np.arange(len(first)), blocks)
    number = np.arange(len(leg)) - np.repeat(np.cumsum(blocks) - blocks, blocks)
    d = x[(first[leg] + number * size)[:, None] + np.arange(size)].mean(1)
    levels = []
    for k in range(1, ORDER + 1):
        d = np.diff(d)
        own = np.abs(d[leg[k:] == leg[:-k]])
        if not len(own):
            return 0.0, 0.0
        levels.append(np.median(own) / (0.6745 * np.sqrt(comb(2 * k, k))))
    noise = min(levels[-3:]) > ALIKE * max(levels[-3:])
    return (levels[-1] if noise else 0.0), float(len(leg))


def _levels(keeps: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """What differences of means make of noise that fades, (fades, sizes): squared, of unit variance."""
    total = comb(2 * ORDER, ORDER) * (1 + _alike(keeps, sizes))
    for lag in range(1, ORDER + 1):
        alike = keeps ** (sizes * (lag - 1) + 1) * ((1 - keeps**sizes) / (1 - keeps)) ** 2 / sizes
        total = total + 2 * (-1) ** lag * comb(2 * ORDER, ORDER - lag) * alike
    return total / comb(2 * ORDER, ORDER)
