"""Whether a specimen has changed: two fits compared parameter by parameter."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

from hysteresis import InputError

from .._levels import CHANCE, HELD
from ..posterior._posterior import Posterior
from ..results._detail import Composition, GridWeights
from ..results._repeatability import Repeatability, repeatability
from ._gaussian_estimate import Estimate, Fitted, estimate, in_common, opened


class ParameterChange(NamedTuple):
    """The change of one parameter between two fits.

    - `before`, `after`: in `unit`; `difference`: after - before, and `error`: its standard error.
    - `ratio`: after / before of a positive parameter, with its 90 % interval (`ratio_low`, `ratio_high`).
    - `changed`: the probability that it changed by more than the margin; `increased`: that it grew.
    - `p`: the probability of a difference this large if nothing changed; `p_holm`: the same, corrected for
      the number of parameters (Holm).
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
        """Whether the change is statistically significant: `p_holm` is below 0.01."""
        return self.p_holm < CHANCE


@dataclass(frozen=True)
class Change:
    """Two fits of one specimen, or of two, compared.

    - `parameters`: those that both fits know. `left_out`: the excluded ones, with the reason.
    - `margin`: the fraction of its value by which a parameter must change for `changed`.
    - `chi_square`, `degrees`, `p`: Wald's test of all parameters together, or Hotelling's, whose statistic
      `chi_square` is then.
    """

    parameters: tuple[ParameterChange, ...]
    left_out: dict[str, str]
    margin: float
    chi_square: float
    degrees: int
    p: float

    @property
    def words(self) -> tuple[str, ...]:
        """The results in sentences."""
        verdict = "The specimen has changed" if self.p < CHANCE else "No significant change"
        said = [f"{verdict}: {chance(self.p)} for {self.degrees} parameters together."]
        said += [_sentence(p, self.margin) for p in self.parameters]
        return (*said, *untested(self.left_out))


def change(
    before: Fitted,
    after: Fitted,
    *,
    margin: float = 0.05,
    posteriors: Sequence[Posterior | None] | None = None,
) -> Change:
    """Test whether a specimen has changed between two records, parameter by parameter.

    In the unconstrained space of the parameters (logarithms of positive ones) the fits are Gaussian, and
    their data are independent. So with d = z_after - z_before, V = V_before + V_after

        W = d' V^-1 d  ~  chi^2 (number of parameters)     if nothing has changed (Wald),
        p_k = 2 Phi(-|d_k| / sqrt(V_kk)),                  corrected by Holm's method,
        P(more than the margin m) = 1 - P(z_before(1 - m) < z_after < z_before(1 + m)).

    V is the covariance of the posterior's draws if there is a posterior; otherwise that of repeated cycles,
    see `repeatability`, if both records have three or more, with Student's and Hotelling's distributions in
    place of the Gaussian and chi-square, because few cycles know it only roughly; otherwise that of the fit
    (Laplace). So a model that misses both records alike does not hide a change. The fits must be of
    different records; `compare` ranks fits of the same record.

    **Arguments:**

    - `before`, `after`: fits of one kind of model, or their folders.
    - `margin`: the smallest change that matters, as a fraction of the value before.
    - `posteriors`: one for each fit, or None; by default those saved in the folders.

    Raises `InputError` `not-comparable` if the fits share no parameter with a standard error, or if these
    are sums over inputs of another range, and `given-twice` if both are fits of the same rows.

    Source: Wald, Trans. AMS 54 (1943); Holm, Scandinavian Journal of Statistics 6 (1979).

    In the example: the second specimen is softer by 40 %.

    **Example:**

        >>> found = identify.change(specimens[0], specimens[2])
        >>> [(p.name, f"{p.difference:.2f}", p.clear) for p in found.parameters]
        [('K', '0.53', True), ('b', '2.40', True)]
    """
    if not 0 <= margin < 1:
        raise InputError(
            "bad-option",
            f"margin={margin:g} is not a fraction of the value.",
            fix="give at least 0, below 1.",
        )
    fits, found = opened((before, after), posteriors)
    records = [fit.train for fit in fits]
    if records[0].digest() == records[1].digest():
        raise InputError(
            "given-twice",
            "both fits are of the same rows, so nothing can have changed between them.",
            fix="compare their models (hysid compare DIR DIR), or name a fit of another record.",
        )
    ranges = [fit.trained for fit in fits if isinstance(fit.detail, GridWeights | Composition)]
    if len(ranges) == 2 and np.abs(np.diff(ranges, axis=0)).max() > HELD * np.ptp(ranges):
        (a, b), (c, d) = ranges
        raise InputError(
            "not-comparable",
            f"sums of weights are over the inputs, {a:g} to {b:g} before and {c:g} to {d:g} after.",
            fix="compare records of the same range of the input.",
        )
    estimates = [estimate(fit, posterior) for fit, posterior in zip(fits, found, strict=True)]
    repeated = (
        [repeatability(fit) for fit in fits] if posteriors is None and found == [None] * 2 else []
    )
    cycles = [one.cycles for one in repeated if one is not None]
    if len(cycles) == 2:
        pairs = zip(estimates, repeated, strict=True)
        estimates = [_repeated(of, one) for of, one in pairs if one is not None]
    (one, other), left_out = in_common(estimates)
    degrees = sum(cycles) - 2 if len(cycles) == 2 else None
    if degrees is not None and degrees < len(one.free):
        raise InputError(
            "too-few-cycles",
            f"{sum(cycles)} cycles do not tell whether {len(one.free)} parameters have changed.",
            fix="measure more cycles of each specimen, or fix parameters.",
        )
    return between(one, other, margin, left_out, degrees)


def _repeated(of: Estimate, found: Repeatability) -> Estimate:
    """The estimate with the covariance of repeated cycles in place of the fit's."""
    at = [found.names.index(name) for name in of.bounds.names]
    slope = of.bounds.slope(of.free)
    covariance = found.covariance[np.ix_(at, at)] / (slope[:, None] * slope)
    return of._replace(covariance=covariance)


def between(
    one: Estimate,
    other: Estimate,
    margin: float,
    left_out: dict[str, str],
    degrees: int | None = None,
) -> Change:
    """The change from one estimate to another of the same parameters.

    `degrees`: of freedom of the covariances, None where they are known.
    """
    d, V = other.free - one.free, one.covariance + other.covariance
    error = np.sqrt(np.diagonal(V))
    law = scipy.stats.norm if degrees is None else scipy.stats.t(degrees)
    p = 2 * law.sf(np.abs(d) / error)
    corrected = holm(p)
    before, after = (each.bounds.to_values(each.free) for each in (one, other))
    slopes = one.bounds.slope(one.free), other.bounds.slope(other.free)
    spread = np.sqrt(
        sum(np.diagonal(e.covariance) * s**2 for e, s in zip((one, other), slopes, strict=True))
    )
    # A value beyond its bound has no z: that side of the margin cannot be reached.
    step = margin * np.abs(before)
    low, high = (one.bounds.from_values(before + side) - one.free for side in (-step, step))
    below = np.nan_to_num(law.cdf((low - d) / error))
    above = np.nan_to_num(law.sf((high - d) / error))
    listed = []
    for k, name in enumerate(one.bounds.names):
        ends = d[k] + law.ppf(0.95) * error[k] * np.array([0, -1, 1])
        ratios = np.exp(ends) if one.positive[k] else [None] * 3
        numbers = (
            before[k], after[k], after[k] - before[k], spread[k], *ratios, below[k] + above[k],
            law.cdf(d[k] / error[k]), p[k], corrected[k],
        )  # fmt: skip
        told: Any = [None if x is None else float(x) for x in numbers]
        listed.append(ParameterChange(name, one.units[k], *told))
    chi_square = float(d @ np.linalg.solve(V, d))
    together = float(scipy.stats.chi2.sf(chi_square, len(d)))
    if degrees is not None:  # Hotelling
        rest = degrees - len(d) + 1
        together = float(scipy.stats.f.sf(chi_square * rest / (degrees * len(d)), len(d), rest))
    return Change(tuple(listed), left_out, margin, chi_square, len(d), together)


def holm(p: Float[np.ndarray, " tests"]) -> Float[np.ndarray, " tests"]:
    """p values corrected by Holm's method: if nothing has changed, one family of tests in twenty finds
    something."""
    order = np.argsort(p)
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(steps, 1.0)
    return corrected


def chance(p: float) -> str:
    """A p value in words."""
    return "p < 0.0001" if p < 1e-4 else f"p = {p:.2g}"


def likely(probability: float) -> str:
    """A probability in words, never 0 or 1."""
    if 0.01 <= probability <= 0.99:
        return f"{probability:.2f}"
    return "above 0.99" if probability > 0.5 else "below 0.01"


def untested(left_out: dict[str, str], what: str = "tested") -> list[str]:
    """A sentence on the excluded parameters, with the reasons."""
    if not left_out:
        return []
    return [f"Not {what}: {', '.join(f'{name} ({why})' for name, why in left_out.items())}."]


def _sentence(p: ParameterChange, margin: float) -> str:
    """ "K rose from 1.2 to 1.3 N / mm (+8.2 %, 90 %: +6.4 to +10 %)": the interval is the ratio's own."""
    unit = "" if p.unit == "1" else f" {p.unit}"
    size = f"{p.difference:+.3g} ± {p.error:.2g}{unit}"
    if p.ratio is not None and p.ratio_low is not None and p.ratio_high is not None:
        part, low, high = (100 * (x - 1) for x in (p.ratio, p.ratio_low, p.ratio_high))
        size = f"{part:+.3g} %, 90 %: {low:+.3g} to {high:+.3g} %"
    said = f"{p.name}: no significant change"
    if p.clear:
        way = "rose" if p.difference > 0 else "fell"
        said = f"{p.name} {way} from {p.before:.4g} to {p.after:.4g}{unit}"
    chance_of = f"by more than {100 * margin:.3g} % with probability {likely(p.changed)}"
    return f"{said} ({size}); {chance_of}."
