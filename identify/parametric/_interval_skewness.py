"""How far a posterior is from normal: where its mean lies off the top, and how skewed it is."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

STEP = 0.7
"""Of the differences, in standard deviations: as wide as what they stand for."""

WIDEST = 2.0
"""Deviation of a free number beyond which nothing is said of it, or by it of others."""


class Skewness(NamedTuple):
    """Of the marginals, in standard deviations: mean - top, and the third central moment."""

    shift: Float[np.ndarray, " parameters"]
    skew: Float[np.ndarray, " parameters"]

    def displaced(self, deviations: float) -> Float[np.ndarray, " parameters"]:
        """By how much both ends of an interval of +- so many deviations lie higher."""
        return self.shift + self.skew * (deviations**2 - 1) / 6

    def deviate(self, x: Float[np.ndarray, " parameters"]) -> np.ndarray:
        """The normal deviate that stands for x deviations from the top."""
        a = self.skew / 6
        away = x - self.shift + a
        return 2 * away / (1 + np.sqrt(np.maximum(1 + 4 * a * away, 0.0)))


def points_about(
    z: Float[np.ndarray, " parameters"],
    covariance: Float[np.ndarray, "parameters parameters"],
) -> Float[np.ndarray, "points parameters"]:
    """Where `skewness` wants the score."""
    ways = STEP * _ways(covariance)
    return z + np.concatenate([np.zeros_like(ways[:1]), ways, -ways])


def skewness(
    scores: Float[np.ndarray, "points parameters"],
    covariance: Float[np.ndarray, "parameters parameters"],
) -> Skewness:
    """From the score, d log p / dz, at `points_about` a posterior's top.

    With C the covariance there, L L' = C, v_i = C e_i / sd_i and T the third derivatives of log p,

        shift_i = sum over m of T(v_i, L_m, L_m) / 2,        skew_i = T(v_i, v_i, v_i).

    T(., a, a) is the score's second difference along a. To second order a normal deviate u stands for
    u + shift + skew (u^2 - 1) / 6 deviations from the top.

    Source: Lindley, Approximate Bayesian methods, Trabajos de Estadistica 31 (1980); Cornish, Fisher,
    Moments and cumulants in the specification of distributions, Rev. Int. Stat. Inst. 5 (1938).
    """
    ways = _ways(covariance)
    count, n = ways.shape
    above, below = scores[1 : 1 + count], scores[1 + count :]
    with np.errstate(invalid="ignore", over="ignore"):
        bent = (above + below - 2 * scores[:1]) / STEP**2
        shift = ways[n:] @ bent[:n].sum(0) / 2
        skew = (ways[n:] * bent[n:]).sum(1)
    # Of more than a deviation the expansion knows nothing.
    return Skewness(*(np.clip(np.where(np.isfinite(x), x, 0.0), -1.0, 1.0) for x in (shift, skew)))


def _ways(covariance: np.ndarray) -> np.ndarray:
    """Columns of L, then v_i; nothing along what the data leave open."""
    variance = np.diagonal(covariance)
    with np.errstate(invalid="ignore"):
        known = (variance > 0) & (variance < WIDEST**2)
    C = np.where(np.outer(known, known), covariance, 0.0)
    sizes, vectors = np.linalg.eigh(C)
    roots = (vectors * np.sqrt(np.maximum(sizes, 0.0))).T
    sd = np.sqrt(np.where(known, variance, 1.0))
    return np.concatenate([roots, C / sd[:, None]])
