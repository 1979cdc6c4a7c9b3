"""Whether a specimen has changed: two fits compared parameter by parameter."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

from hysteresis import InputError
from hysteresis.numerics._normal import NORMAL_95

from ..posterior._posterior import Posterior
from ._gaussian_estimate import Estimate, Fitted, estimate, in_common, opened

CLEAR = 0.05
"""p value below which a change is called one."""


class ParameterChange(NamedTuple):
    """What became of one parameter.

    - `before`, `after`: in `unit`; `difference`: after - before, and `error`: its standard error.
    - `ratio`: after / before of a positive parameter, with its 90 % interval (`ratio_low`, `ratio_high`).
    - `changed`: the probability that it moved by more than the margin, `increased`: that it grew.
    - `p`: how often equal specimens differ so much; `p_holm`: corrected for the number of parameters.
    """

    name: str
    unit: str
    before: float
    after: float
    difference: float
    error: float
    ratio: float | None
    ratio_low: float | None
    ratio_high: float | None
    changed: float
    increased: float
    p: float
    p_holm: float

    @property
    def clear(self) -> bool:
        """Whether it has changed beyond chance."""
        return self.p_holm < CLEAR


@dataclass(frozen=True)
class Change:
    """Two fits of one specimen, or of two, compared.

    - `parameters`: those known in both. `left_out`: the others, and why.
    - `margin`: the part of its value by which a parameter has to move for `changed`.
    - `chi_square`, `degrees`, `p`: Wald's test of all parameters together.
    """

    parameters: tuple[ParameterChange, ...]
    left_out: dict[str, str]
    margin: float
    chi_square: float
    degrees: int
    p: float

    @property
    def words(self) -> tuple[str, ...]:
        """What was found, in sentences."""
        said = [_together(self.p, self.chi_square, self.degrees)]
        said += [_sentence(p, self.margin) for p in self.parameters]
        return (*said, *untested(self.left_out))


def change(
    before: Fitted,
    after: Fitted,
    *,
    margin: float = 0.05,
    posteriors: Sequence[Posterior | None] | None = None,
) -> Change:
    """Has the specimen changed between two records?

    In the free space of the parameters (logarithms of positive ones) the fits are Gaussian and their data
    independent, so that with d = z_after - z_before, V = V_before + V_after

        W = d' V^-1 d  ~  chi^2 (number of parameters)     where nothing has changed (Wald),
        p_k = 2 Phi(-|d_k| / sqrt(V_kk)),                  corrected by Holm's steps,
        P(more than the margin m) = 1 - P(z_before(1 - m) < z_after < z_before(1 + m)).

    V is the covariance of the fit (Laplace), or that of a posterior's draws, where there is one. The data
    have to be the record's own: two fits of one record are compared by `compare`.

    **Arguments:**

    - `before`, `after`: fits of one kind of model, or their folders.
    - `margin`: what counts as a change, as a part of the value before.
    - `posteriors`: of each fit, or None; by default those in the folders.

    Raises `InputError` where the fits share no parameter with an error (`not-comparable`), or are of the
    same rows (`given-twice`).

    Source: Wald, Trans. AMS 54 (1943); Holm, Scandinavian Journal of Statistics 6 (1979).
    """
    if not 0 <= margin < 1:
        raise InputError(
            "bad-option", f"margin={margin:g}: a part of the value, at least 0, below 1."
        )
    fits, found = opened((before, after), posteriors)
    records = [fit.train for fit in fits]
    if records[0].digest() == records[1].digest():
        raise InputError(
            "given-twice",
            "both fits are of the same rows, so nothing can have changed between them.",
            fix="compare their models (hysid compare DIR DIR), or name a fit of another record.",
        )
    estimates = [estimate(fit, posterior) for fit, posterior in zip(fits, found, strict=True)]
    (one, other), left_out = in_common(estimates)
    return between(one, other, margin, left_out)


def between(one: Estimate, other: Estimate, margin: float, left_out: dict[str, str]) -> Change:
    """The change from one estimate to another of the same parameters."""
    d, V = other.free - one.free, one.covariance + other.covariance
    error = np.sqrt(np.diagonal(V))
    p = 2 * scipy.stats.norm.sf(np.abs(d) / error)
    corrected = holm(p)
    before, after = one.values(one.free), other.values(other.free)
    slopes = one.bounds.slope(one.free), other.bounds.slope(other.free)
    spread = np.sqrt(
        sum(np.diagonal(e.covariance) * s**2 for e, s in zip((one, other), slopes, strict=True))
    )
    # A value beyond its bound has no z: that side of the margin cannot be reached.
    away = margin * np.abs(before)
    low, high = (one.bounds.from_values(before + side) - one.free for side in (-away, away))
    below = np.nan_to_num(scipy.stats.norm.cdf((low - d) / error))
    above = np.nan_to_num(scipy.stats.norm.sf((high - d) / error))
    listed = []
    for k, name in enumerate(one.bounds.names):
        ends = d[k] + NORMAL_95 * error[k] * np.array([0, -1, 1])
        ratios = np.exp(ends) if one.positive[k] else [None] * 3
        numbers = (
            before[k], after[k], after[k] - before[k], spread[k], *ratios, below[k] + above[k],
            scipy.stats.norm.cdf(d[k] / error[k]), p[k], corrected[k],
        )  # fmt: skip
        listed.append(ParameterChange(name, one.units[k], *map(_number, numbers)))
    chi_square = float(d @ np.linalg.solve(V, d))
    together = float(scipy.stats.chi2.sf(chi_square, len(d)))
    return Change(tuple(listed), left_out, margin, chi_square, len(d), together)


def _number(x: Any) -> Any:
    return None if x is None else float(x)


def holm(p: Float[np.ndarray, " tests"]) -> Float[np.ndarray, " tests"]:
    """p values corrected so that one test in twenty of nothing finds anything at all."""
    order = np.argsort(p)
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(steps, 1.0)
    return corrected


def chance(p: float) -> str:
    """A p value as a reader wants it."""
    return "p < 0.0001" if p < 1e-4 else f"p = {p:.2g}"


def likely(probability: float) -> str:
    """A probability as a reader wants it: nothing is certain."""
    if 0.01 <= probability <= 0.99:
        return f"{probability:.2f}"
    return "above 0.99" if probability > 0.5 else "below 0.01"


def untested(left_out: dict[str, str], what: str = "tested") -> list[str]:
    """What was left out, and why."""
    if not left_out:
        return []
    return [f"Not {what}: {', '.join(f'{name} ({why})' for name, why in left_out.items())}."]


def _together(p: float, chi_square: float, degrees: int) -> str:
    said = "It has changed" if p < CLEAR else "No change is seen"
    return f"{said}: chi-square {chi_square:.4g} with {degrees} parameters, {chance(p)}."


def _sentence(p: ParameterChange, margin: float) -> str:
    """ "K rose from 1.2 to 1.3 N / mm, by 8.2 ± 1.1 %": the error is the ratio's own."""
    unit = "" if p.unit == "1" else f" {p.unit}"
    size = f"{abs(p.difference):.3g} ± {p.error:.2g}{unit}"
    if p.ratio is not None and p.ratio_low is not None and p.ratio_high is not None:
        error = 100 * (p.ratio_high - p.ratio_low) / (2 * NORMAL_95)
        size = f"{abs(100 * (p.ratio - 1)):.3g} ± {error:.2g} %"
    if not p.clear:
        said = f"{p.name}: no change beyond chance ({size})"
    else:
        way = "rose" if p.difference > 0 else "fell"
        said = f"{p.name} {way} from {p.before:.4g} to {p.after:.4g}{unit}, by {size}"
    return f"{said}; by more than {100 * margin:.3g} % with probability {likely(p.changed)}."
