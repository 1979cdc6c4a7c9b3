"""Change over time: a line through many records of one specimen, with scatter between the records."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

from hysteresis import InputError

from ..posterior._posterior import Posterior
from ._change import CLEAR, chance, holm, untested
from ._gaussian_estimate import Fitted, estimate, in_common, opened


class Line(NamedTuple):
    """A line a + b t through estimates with standard errors, and the scatter beyond these.

    - `coefficients`: (a, b); `covariance`: of both; `scatter`: tau.
    """

    coefficients: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    scatter: float


class ParameterTrend(NamedTuple):
    """The trend of one parameter.

    - `first`, `last`: the line at the first and last time, in `unit`.
    - `rate`: b, per unit of time: of the logarithm if the parameter is positive (`relative`), otherwise in
      `unit`; `low`, `high`: its 90 % interval.
    - `scatter`: tau, the standard deviation between records beyond their own errors, in the same measure.
    - `p`: the probability of a trend this large if nothing changes; `p_holm`: corrected (Holm).
    """

    name: str
    unit: str
    first: float
    last: float
    rate: float
    low: float
    high: float
    relative: bool
    scatter: float
    p: float
    p_holm: float

    @property
    def clear(self) -> bool:
        """Whether the trend is statistically significant: `p_holm` is below 0.01."""
        return self.p_holm < CLEAR


@dataclass(frozen=True)
class ChangeOverTime:
    """Trends of the parameters that every fit knows; `left_out`: the excluded ones, with the reason."""

    times: Float[np.ndarray, " records"]
    parameters: tuple[ParameterTrend, ...]
    left_out: dict[str, str]

    @property
    def words(self) -> tuple[str, ...]:
        """The results in sentences."""
        return (*map(_sentence, self.parameters), *untested(self.left_out))


def change_over_time(
    fits: Sequence[Fitted],
    times: Sequence[float] | Float[np.ndarray, " records"],
    *,
    posteriors: Sequence[Posterior | None] | None = None,
) -> ChangeOverTime:
    """Fit a trend in time to every parameter of a specimen that was measured repeatedly.

        z_i ~ N(a + b t_i, variance_i + tau^2)      in the unconstrained space of the parameters

    b is the rate and tau the scatter between records beyond their standard errors; see `line_in_time`.

    **Arguments:**

    - `fits`: fits of one kind of model, or their folders, three at least.
    - `times`: when each record was taken, in any unit (hours, cycles, days).
    - `posteriors`: one for each fit, or None; by default those saved in the folders.

    Raises `InputError` `too-few-fits` for fewer than three different times, `length-mismatch` for another
    number of times than fits, and as `change`.

    Source: Patterson, Thompson, Biometrika 58 (1971); Knapp, Hartung, Statistics in Medicine 22 (2003).

    In the example: three records, ten hours apart.

    **Example:**

        >>> found = identify.change_over_time(specimens, [0.0, 10.0, 20.0])
        >>> [(p.name, f"{p.rate:.3f}", p.unit) for p in found.parameters]
        [('K', '0.026', 'mm / N'), ('b', '0.120', 'mm')]
    """
    opened_fits, found = opened(fits, posteriors)
    t = np.asarray(times, float)
    if len(t) != len(opened_fits):
        raise InputError("length-mismatch", f"{len(opened_fits)} fits but {len(t)} times.")
    if len(np.unique(t)) < 3:
        raise InputError(
            "too-few-fits",
            f"{len(np.unique(t))} different times cannot tell a trend from scatter.",
            fix="take three records or more, or compare two (change).",
        )
    shared, left_out = in_common([estimate(*pair) for pair in zip(opened_fits, found, strict=True)])
    first, last, quantile = t.min(), t.max(), float(scipy.stats.t.ppf(0.95, len(t) - 2))
    bounds, units, positive = shared[0].bounds, shared[0].units, shared[0].positive
    z = np.array([e.free for e in shared])
    variance = np.array([np.diagonal(e.covariance) for e in shared])
    lines = [line_in_time(t - first, z[:, k], variance[:, k]) for k in range(z.shape[1])]
    ends = np.array([line.coefficients @ [[1, 1], [0, last - first]] for line in lines]).T
    values = shared[0].values(ends)
    slope = np.where(positive, 1.0, bounds.slope(ends[0]))
    rate = slope * [line.coefficients[1] for line in lines]
    error = np.abs(slope) * [np.sqrt(line.covariance[1, 1]) for line in lines]
    scatter = np.abs(slope) * [line.scatter for line in lines]
    p = 2 * scipy.stats.t.sf(np.abs(rate) / error, len(t) - 2)
    corrected = holm(p)
    listed = tuple(
        ParameterTrend(
            name, units[k], float(values[0, k]), float(values[1, k]), float(rate[k]),
            float(rate[k] - quantile * error[k]), float(rate[k] + quantile * error[k]),
            positive[k], float(scatter[k]), float(p[k]), float(corrected[k]),
        )
        for k, name in enumerate(bounds.names)
    )  # fmt: skip
    return ChangeOverTime(t, listed, left_out)


def line_in_time(
    t: Float[np.ndarray, " records"],
    z: Float[np.ndarray, " records"],
    variance: Float[np.ndarray, " records"],
) -> Line:
    """Weighted regression with scatter between records:

        z_i ~ N(a + b t_i, variance_i + tau^2),   tau by restricted maximum likelihood,

        -2 log L = sum log(variance_i + tau^2) + log |X'WX| + sum w_i (z_i - a - b t_i)^2,

    with w_i = 1 / (variance_i + tau^2). The covariance (X'WX)^-1 is widened if the records scatter more
    than tau explains. Intervals use Student's t with two degrees of freedom less than records, because few
    records determine tau poorly.

    Source: Patterson, Thompson, Biometrika 58 (1971); Knapp, Hartung, Statistics in Medicine 22 (2003).
    """
    X = np.stack([np.ones_like(t), t], 1)

    def solved(tau: float) -> tuple[np.ndarray, np.ndarray, float, float]:
        w = 1 / (variance + tau**2)
        normal = X.T @ (w[:, None] * X)
        at = np.linalg.solve(normal, X.T @ (w * z))
        squares = float(np.sum(w * (z - X @ at) ** 2))
        deviance = squares - np.log(w).sum() + np.linalg.slogdet(normal)[1]
        return at, normal, squares, float(deviance)

    # Between the smallest tau that matters and the largest possible one the deviance has one minimum.
    plain = z - X @ np.linalg.lstsq(X, z, rcond=None)[0]
    low, high = 1e-3 * np.sqrt(variance.min()), 3 * np.sqrt(plain @ plain + variance.max())
    least: Any = scipy.optimize.minimize_scalar(
        lambda log_tau: solved(np.exp(log_tau))[-1],
        bounds=(np.log(low), np.log(high)),
        method="bounded",
        options={"xatol": 1e-6},
    )
    tau = float(np.exp(least.x))
    if solved(0.0)[-1] <= least.fun:
        tau = 0.0
    at, normal, squares, _ = solved(tau)
    return Line(at, np.linalg.inv(normal) * max(1.0, squares / (len(t) - 2)), tau)


def _sentence(p: ParameterTrend) -> str:
    factor, unit = (100, " %") if p.relative else (1, "" if p.unit == "1" else f" {p.unit}")
    rate, low, high = (f"{factor * x:+.3g}" for x in (p.rate, p.low, p.high))
    size = f"{rate}{unit} per unit of time ({low} to {high}, {chance(p.p_holm)})"
    said = f"{p.name}: {size}" if p.clear else f"{p.name}: no significant trend, {size}"
    return f"{said}; records scatter by {factor * p.scatter:.2g}{unit} beyond their errors."
