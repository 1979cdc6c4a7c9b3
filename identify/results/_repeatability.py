"""Repeatability of parameters: how much they differ from cycle to cycle of one record.

A line through the loops of a sponge misses them by millimetres, cycle after cycle by the same ones. Its
standard error takes that misfit for noise, and says how far the model is from the material. How well the
best line itself is known is seen from what differs between cycles.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.special import stdtrit

from hysteresis import Record
from hysteresis._parameter import parameter_at

from .._levels import REPEATS
from ..parameters._settings import numbers_of, replaced
from ._detail import Parametric
from ._fit_result import FitResult
from ._parameters import with_ties

STEP = float(np.cbrt(np.finfo(float).eps))
"""Of a parameter's value, or of its standard error where that is 0, for central differences."""


class Repeatability(NamedTuple):
    """What cycles of one record, or its sequences, tell of the parameters of a fit.

    - `names`: of the parameters. `covariance`: of their values, in their units.
    - `cycles`: how many told it; an error has one degree of freedom fewer.
    """

    names: tuple[str, ...]
    covariance: Float[np.ndarray, "parameters parameters"]
    cycles: int

    @property
    def stderr(self) -> Float[np.ndarray, " parameters"]:
        """Standard errors of the values."""
        return np.sqrt(np.diagonal(self.covariance))

    @property
    def half_width(self) -> Float[np.ndarray, " parameters"]:
        """Half the 90 % interval of each, Student's: a few cycles know their spread to a factor only."""
        return float(stdtrit(self.cycles - 1, 0.95)) * self.stderr


def repeatability(fit: FitResult) -> Repeatability | None:
    """How well the parameters that fit best are known, from the differences between cycles.

        V = n / (n - 1)  sum over n cycles c of (s_c - s) (s_c - s)',      s_c = R^-1 Q_c' r_c

    with the Jacobian J = A R, A' A = 1, of all rows that count, Q the orthonormal matrix nearest A's rows
    in these cycles, Q_c and the residuals r_c of the rows of cycle c. Misfit that comes again in every
    cycle has no part in it; the standard errors of the fit hold that too. Nor has the first cycle of a
    sequence, where three others are left: foam softens in it, and does so again when the test is repeated.
    What the cycles tell less well than one of all cycles would has the errors of the fit. Of a record of
    several sequences with fewer than two cycles each, the sequences take the cycles' place.

    **Arguments:** `fit`: of few parameters.

    **Returns:** a `Repeatability`; None where the fit has weights, fewer than three cycles, or no parameter
    with a standard error.

    Source: Liang and Zeger, Biometrika 73 (1986), for independent clusters.
    """
    names = tuple(p.name for p in fit.parameters if p.status == "free")
    group = groups_of(fit.train, fit.used)
    count = int(group.max()) + 1 if len(group) else 0
    if not (isinstance(fit.detail, Parametric) and names and count >= REPEATS):
        return None
    used = fit.used & np.isfinite(fit.residuals)
    w = fit.train.weights[used]
    J = w[:, None] * np.column_stack([slope_of(fit, name)[used] for name in names])
    r = w * fit.residuals[used]
    scale = np.maximum(np.sqrt((J**2).sum(0)), np.finfo(float).tiny)
    first = fit.train.n_cycles >= 2 * len(fit.train.labels) and fit.train.cycle == 1
    later = np.setdiff1d(np.arange(count), group[first])
    told = later if len(later) >= REPEATS else np.arange(count)
    own = np.isin(group[used], told)
    A, D, W = np.linalg.svd(J / scale, full_matrices=False)
    # What only the first cycle tells does not come again, and would seem to be known exactly: two records
    # of one solid that creeps had "changed".
    Q, share, T = np.linalg.svd(A[own], full_matrices=False)
    repeats = count * share**2 >= 1
    scores = np.zeros((count, len(D)))
    np.add.at(scores, group[used][own], Q * r[own, None])
    away = np.where(repeats, scores[told] - scores[told].mean(0), 0.0)
    along = T @ (D[:, None] * W)
    listed = [p.name for p in fit.parameters if p.status in ("free", "at bound", "unidentified")]
    at = [listed.index(name) for name in names]
    known = fit.covariance[np.ix_(at, at)] * scale[:, None] * scale
    found = len(told) / (len(told) - 1) * away.T @ away
    found = np.where(repeats | repeats[:, None], found, along @ known @ along.T)
    back = np.linalg.pinv(along) / scale[:, None]
    return Repeatability(names, back @ found @ back.T, len(told))


def with_repeatability(fit: FitResult) -> FitResult:
    """The fit with `Parameter.repeatability`, where cycles tell it.

    Where no noise explains the residuals, the model is off by what comes again in every cycle, and the 90 %
    intervals are those of the cycles: standard errors that take a misfit for noise are many times too wide.
    """
    found = repeatability(fit)
    if found is None:
        return fit
    misfit = fit.noise_model is None or fit.noise_model.misfit is not None
    limits = {name: info.bounds for name, info, _ in numbers_of(fit.model)}
    told = {p.name: p for p in fit.parameters}
    for name, error, half in zip(found.names, found.stderr, found.half_width, strict=True):
        p = told[name] = told[name]._replace(repeatability=float(error))
        if misfit:
            low, high = np.clip([p.value - half, p.value + half], *limits[name]).tolist()
            told[name] = p._replace(low=low, high=high)
    ties = {name: one.tied for name, one in fit.settings.items() if one.tied is not None}
    return replace(fit, parameters=with_ties(tuple(told.values()), ties))


def cycles_or_sequences(record: Record) -> tuple[list[str], Int[np.ndarray, " samples"]]:
    """Names, and the name's number for each row: of its sequence where there are several, else of its
    cycle, with 0 outside cycles."""
    if len(record.labels) == 1:
        which = np.maximum(record.cycle, 0)
        return ["outside cycles", *(f"cycle {k}" for k in range(1, int(which.max()) + 1))], which
    lengths = np.diff([*record.starts, len(record)])
    return ["", *record.labels], np.repeat(np.arange(1, len(lengths) + 1), lengths)


def groups_of(record: Record, used: np.ndarray) -> Int[np.ndarray, " samples"]:
    """Number of the cycle of each row over all sequences, of those with counted rows; -1 for none."""
    sequence = np.repeat(np.arange(len(record.labels)), np.diff([*record.starts, len(record)]))
    cycle = np.where(record.cycle > 0, record.cycle, 0)
    if record.n_cycles >= 2 * len(record.labels):
        whole = np.where(cycle > 0, sequence * (cycle.max() + 1) + cycle, -1)
    else:
        whole = sequence
    known = np.unique(whole[used & (whole >= 0)])
    at = np.searchsorted(known, whole)
    found = np.isin(whole, known)
    return np.where(found, at, -1)


def slope_of(fit: FitResult, name: str) -> Float[np.ndarray, " samples"]:
    """dy / d parameter of every row, by central differences."""
    own = next(p for p in fit.parameters if p.name == name)
    value = float(parameter_at(fit.model, name))
    step = STEP * (abs(own.value) or own.stderr or 1.0)
    ends = []
    for side in (step, -step):
        moved = replace(fit, model=replaced(fit.model, name, value + side))
        ends.append(np.asarray(moved.predict(fit.train)))
    return (ends[0] - ends[1]) / (2 * step)
