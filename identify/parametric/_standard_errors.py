"""Standard errors of fitted parameters: covariances, statuses and 90 % intervals."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from hysteresis import AbstractModel, Record
from hysteresis.numerics._functions import NORMAL_95

from .._levels import LITTLE, UNCERTAIN
from ..parameters._settings import numbers_of
from ..parameters._transform import Transform, transform_for
from ..results._parameters import Parameter, Status, with_ties

# How far a posterior is from normal: where its mean lies off the top, and how skewed it is.


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


def covariance_of(
    jacobian: Float[np.ndarray, "rows parameters"],
    variance: float | Float[np.ndarray, " rows"],
) -> Float[np.ndarray, "parameters parameters"]:
    """(J'J)^-1 J' diag(variance) J (J'J)^-1 of the free vector; directions the data do not see get infinite
    variance."""
    U, size, V = np.linalg.svd(jacobian, full_matrices=False)
    seen = size > 1e-10 * size.max(initial=1e-300)
    with np.errstate(invalid="ignore"):
        blind = (V[~seen] ** 2).sum(0) > 1e-12
        root = V[seen].T / size[seen]
        along = U[:, seen]
        each = (
            variance * np.eye(len(size[seen]))
            if np.ndim(variance) == 0
            else (along.T * variance) @ along
        )
        covariance = root @ each @ root.T
    covariance[blind, blind] = np.inf
    return covariance


def rescaled(
    covariance: Float[np.ndarray, "parameters parameters"],
    factor: Float[np.ndarray, " parameters"],
) -> Float[np.ndarray, "parameters parameters"]:
    """The covariance of every parameter times its factor."""
    with np.errstate(invalid="ignore"):
        return covariance * factor[:, None] * factor


def statuses(
    bounds: Transform,
    free: Float[np.ndarray, " parameters"],
    error: Float[np.ndarray, " parameters"],
) -> np.ndarray:
    """Of every parameter "free", "at bound" or "unidentified", from the free vector and its errors.

    A bounded parameter whose logarithm is uncertain by more than 2 (a factor of 7) is unidentified; it acts
    as a limit (0 or infinity) there.
    """
    low, high = np.isfinite(bounds.low), np.isfinite(bounds.high)
    # The distance from a bound other than 0, on the bound's own scale.
    end = np.where(low, bounds.low, np.where(high, bounds.high, 0.0))
    with np.errstate(over="ignore"):
        near = (low | high) & (end != 0) & (np.exp(free) < LITTLE * np.abs(end))
    at_bound = np.where(low & high, np.abs(free) > -np.log(LITTLE), near)
    lost = ~np.isfinite(error) | ((low | high) & (error > UNCERTAIN))
    return np.where(at_bound, "at bound", np.where(lost, "unidentified", "free"))


def reported(
    model: AbstractModel,
    bounds: Transform,
    free: Float[np.ndarray, " parameters"],
    covariance: Float[np.ndarray, "parameters parameters"],
    record: Record,
    skewness: Skewness,
) -> tuple[Parameter, ...]:
    """The parameters of a fitted model with their errors: none at a bound, none where unidentified."""
    error, slope = np.sqrt(np.diagonal(covariance)), bounds.slope(free)
    status = statuses(bounds, free, error)
    # Below a default prior's lower end, a sixth of it, a value that the data do not see is at its bound 0.
    default = transform_for(model, record)
    least = {
        name: one.first / one.second
        for name, one in zip(default.names, default.priors, strict=True)
        if one.kind == "log-normal"
    }
    lean = skewness.displaced(NORMAL_95)
    found = []
    words = model.unit_words(record.input_unit, record.output_unit, record.time_unit)
    for name, info, value in numbers_of(model):
        unit = info.in_units(words)
        if name not in bounds.names:
            found.append(Parameter(name, value, unit, None, "fixed"))
            continue
        k = bounds.names.index(name)
        known: Status = str(status[k])  # type: ignore[assignment]
        if known == "unidentified" and value < least.get(name, 0.0):
            known = "at bound"
        if known != "free":
            found.append(Parameter(name, value, unit, None, known))
            continue
        ends = [
            free + np.eye(len(free))[k] * float(error[k]) * (lean[k] + side)
            for side in (-NORMAL_95, NORMAL_95)
        ]
        low, high = (float(bounds.to_values(end)[k]) for end in ends)
        stderr = float(error[k]) * abs(float(slope[k]))
        found.append(Parameter(name, value, unit, stderr, known, low, high))
    return with_ties(tuple(found), {name: (source, factor) for name, source, factor in bounds.ties})
