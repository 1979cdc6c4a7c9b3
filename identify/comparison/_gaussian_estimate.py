"""The Gaussian estimate of a fit's parameters in the unconstrained space, by which fits are compared."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from hysteresis import InputError

from ..files._fit_folder import load
from ..files._posterior import load_posterior
from ..parameters._transform import Transform, transform
from ..posterior._posterior import Posterior
from ..results._detail import DiscreteSpectrum
from ..results._fit_result import FitResult

Fitted = FitResult | str | Path
"""A fit, or the folder of one."""


class Estimate(NamedTuple):
    """The free parameters of a fit: z ~ N(free, covariance).

    - `bounds`: the transform between z and values; unbounded parameters have the scale 1, so that the z of
      different records can be compared.
    - `units`: of the values.
    - `left_out`: parameters without a standard error, and why: "fixed", "at bound", "unidentified".
    """

    bounds: Transform
    units: tuple[str, ...]
    free: Float[np.ndarray, " parameters"]
    covariance: Float[np.ndarray, "parameters parameters"]
    left_out: dict[str, str]

    @property
    def positive(self) -> tuple[bool, ...]:
        """Of each, whether z is its logarithm."""
        limits = zip(self.bounds.low, self.bounds.high, strict=True)
        return tuple(low == 0 and not np.isfinite(high) for low, high in limits)

    def of(self, names: Sequence[str]) -> "Estimate":
        """The marginal estimate of these parameters."""
        at = [self.bounds.names.index(name) for name in names]
        low, high = (tuple(limits[k] for k in at) for limits in (self.bounds.low, self.bounds.high))
        bounds = Transform(tuple(names), low, high, 1.0)
        units = tuple(self.units[k] for k in at)
        return Estimate(bounds, units, self.free[at], self.covariance[np.ix_(at, at)], {})


def estimate(fit: FitResult, posterior: Posterior | None = None) -> Estimate:
    """The Gaussian of a fit's covariance (Laplace), or of its posterior's draws."""
    listed = [p for p in fit.parameters if p.status in ("free", "at bound", "unidentified")]
    if len(listed) != len(fit.covariance):  # a spectrum's has the known ones alone
        listed = [p for p in listed if p.status == "free"]
    keep = [k for k, p in enumerate(listed) if p.status == "free"]
    known = [listed[k] for k in keep]
    bounds = _bounds(fit, tuple(p.name for p in known))
    if posterior is None:
        free = bounds.from_values(np.array([p.value for p in known]))
        slope = bounds.slope(free)
        covariance = fit.covariance[np.ix_(keep, keep)] / (slope[:, None] * slope)
    else:
        at = [posterior.names.index(p.name) for p in known]
        draws = bounds.from_values(posterior.draws[..., at].reshape(-1, len(at)))
        free, covariance = draws.mean(0), np.cov(draws, rowvar=False).reshape(len(at), len(at))
    left_out = {p.name: p.status for p in fit.parameters if p not in known}
    return Estimate(bounds, tuple(p.unit for p in known), free, covariance, left_out)


def _bounds(fit: FitResult, names: tuple[str, ...]) -> Transform:
    """The model's own bounds; sums over a grid have none, the numbers of a spectrum are positive."""
    whole = transform(fit.model, 1.0)
    inside = dict(zip(whole.names, zip(whole.low, whole.high, strict=True), strict=True))
    other = (0.0 if isinstance(fit.detail, DiscreteSpectrum) else -np.inf, np.inf)
    limits = [inside.get(name, other) for name in names]
    low, high = (tuple(float(limit[k]) for limit in limits) for k in (0, 1))
    return Transform(names, low, high, 1.0)


def in_common(
    estimates: Sequence[Estimate], parameters: Sequence[str] | None = None
) -> tuple[list[Estimate], dict[str, str]]:
    """The parameters that every fit knows in one unit, and the reasons why others are excluded.

    Raises `InputError` `not-comparable` if there is none, `unknown-parameter` for a name that no fit has.
    """
    every = dict.fromkeys(n for e in estimates for n in (*e.bounds.names, *e.left_out))
    wanted = list(every) if parameters is None else list(parameters)
    if unknown := [name for name in wanted if name not in every]:
        raise InputError(
            "unknown-parameter",
            f"no fit has a parameter {unknown[0]!r}; they have {', '.join(every)}.",
        )
    left_out = {
        name: e.left_out.get(name, "not in every fit")
        for e in estimates
        for name in wanted
        if name not in e.bounds.names
    }
    every_unit = [dict(zip(e.bounds.names, e.units, strict=True)) for e in estimates]
    for name in (name for name in wanted if name not in left_out):
        if len(units := sorted({units[name] for units in every_unit})) > 1:
            left_out[name] = f"in {' and '.join(units)}"
    shared = [name for name in wanted if name not in left_out]
    if not shared:
        said = ", ".join(f"{name}: {why}" for name, why in left_out.items())
        raise InputError(
            "not-comparable",
            f"no parameter is known in every fit ({said}).",
            fix="fit the same model to each record.",
        )
    return [e.of(shared) for e in estimates], left_out


def opened(
    fits: Sequence[Fitted], posteriors: Sequence[Posterior | None] | None = None
) -> tuple[list[FitResult], list[Posterior | None]]:
    """Fits, loaded if they are folders, with their posteriors: those given, otherwise those in the folders.

    Raises `InputError` for fewer than two fits, or another number of posteriors than fits.
    """
    if len(fits) < 2:
        raise InputError(
            "too-few-fits", f"{len(fits)} fit cannot be compared.", fix="give two or more."
        )
    if posteriors is None:
        posteriors = [None if isinstance(f, FitResult) else load_posterior(f) for f in fits]
    if len(posteriors) != len(fits):
        raise InputError("length-mismatch", f"{len(fits)} fits but {len(posteriors)} posteriors.")
    return [f if isinstance(f, FitResult) else load(f) for f in fits], list(posteriors)
