"""How a specimen changes over many records: a line in time with scatter between the records."""

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
    """a + b t through estimates with errors, and what scatters beyond them.

    - `at`: (a, b); `covariance` of both; `scatter`: tau.
    """

    at: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    scatter: float


class ParameterTrend(NamedTuple):
    """How one parameter goes with time.

    - `first`, `last`: the line at the first and last time, in `unit`.
    - `rate`: b, per unit of time, of the logarithm where the parameter is positive (`relative`), else in
      `unit`; `low`, `high`: its 90 % interval.
    - `scatter`: tau, between records beyond their own errors, likewise.
    - `p`: how often a specimen that stays the same shows such a trend; `p_holm`: corrected.
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
        """Whether there is a trend beyond chance."""
        return self.p_holm < CLEAR


@dataclass(frozen=True)
class ChangeOverTime:
    """Trends of the parameters known in every fit; `left_out`: the others, and why."""

    times: Float[np.ndarray, " records"]
    parameters: tuple[ParameterTrend, ...]
    left_out: dict[str, str]

    @property
    def words(self) -> tuple[str, ...]:
        """What was found, in sentences."""
        return (*map(_sentence, self.parameters), *untested(self.left_out))


def change_over_time(
    fits: Sequence[Fitted],
    times: Sequence[float] | Float[np.ndarray, " records"],
    *,
    posteriors: Sequence[Posterior | None] | None = None,
) -> ChangeOverTime:
    """The trend of every parameter over records taken at `times`, see `line_in_time`.

    Raises `InputError` for fewer than three records or times that do not differ (`too-few-fits`),
    another number of times (`length-mismatch`), and as `change`.
    """
    opened_fits, found = opened(fits, posteriors)
    t = np.asarray(times, float)
    if len(t) != len(opened_fits):
        raise InputError("length-mismatch", f"{len(opened_fits)} fits, and {len(t)} times.")
    if len(np.unique(t)) < 3:
        raise InputError(
            "too-few-fits",
            f"{len(np.unique(t))} different times show no trend beyond scatter.",
            fix="take three records or more, or compare two (change).",
        )
    shared, left_out = in_common([estimate(*pair) for pair in zip(opened_fits, found, strict=True)])
    first, last, quantile = t.min(), t.max(), float(scipy.stats.t.ppf(0.95, len(t) - 2))
    bounds, units, positive = shared[0].bounds, shared[0].units, shared[0].positive
    z = np.array([e.free for e in shared])
    variance = np.array([np.diagonal(e.covariance) for e in shared])
    lines = [line_in_time(t - first, z[:, k], variance[:, k]) for k in range(z.shape[1])]
    ends = np.array([line.at @ [[1, 1], [0, last - first]] for line in lines]).T
    values = shared[0].values(ends)
    slope = np.where(positive, 1.0, bounds.slope(ends[0]))
    rate = slope * [line.at[1] for line in lines]
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

        -2 log L = sum log(variance_i + tau^2) + log |X'WX| + sum w_i (z_i - a - b t_i)^2,   w the inverse.

    The covariance (X'WX)^-1 is widened where the records scatter more than they should at that tau, and
    intervals take Student's t with two degrees less than records: tau is known as badly as they are few.

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

    # The least tau that shows and the largest there can be; between them the deviance has one minimum.
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
    said = f"{p.name}: {size}" if p.clear else f"{p.name}: no trend beyond chance, {size}"
    return f"{said}; records scatter by {factor * p.scatter:.2g}{unit} beyond their errors."
