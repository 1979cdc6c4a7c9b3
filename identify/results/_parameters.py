"""Fitted parameters: what is told of each, one by its name, and how they are correlated."""

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from hysteresis import InputError
from hysteresis._format import ends

Status = Literal["free", "fixed", "tied", "at bound", "unidentified", "inseparable"]


class Parameter(NamedTuple):
    """A fitted parameter: value, unit, standard error, status.

    - `stderr`: None for a parameter that is fixed, at a bound, unidentified or inseparable. A tied one has
      that of the parameter that it is a multiple of, times the factor.
    - `low`, `high`: its 90 % interval. Skewed like the posterior under the user's prior if one was given,
      otherwise under a flat prior on the unconstrained scale; clipped at the bounds. Of one that is
      "inseparable" from others, the ends between which the data leave it open; None where there is none.
    - `repeatability`: standard error of the best value from what differs between cycles, three or more, of
      the fitted rows. It says how well the best parameters are known; `stderr` takes what the model misses
      for noise, and says how far it is from the material. Where no noise explains the residuals, `low` and
      `high` are by this one, with Student's quantile: 90 % of such tests give a line in there.
    """

    name: str
    value: float
    unit: str
    stderr: float | None
    status: Status
    low: float | None = None
    high: float | None = None
    repeatability: float | None = None

    def __str__(self) -> str:
        return "  ".join(filter(None, self.cells))

    @property
    def is_determined(self) -> bool:
        """Whether the data tell it from nothing, or the range that they leave it."""
        return self.status != "unidentified" and (
            self.stderr is None or self.stderr < abs(self.value)
        )

    @property
    def cells(self) -> tuple[str, ...]:
        """Name, value and error, unit, 90 % interval, status."""
        error = "" if self.stderr is None else f" +- {self.stderr:.2g}"
        if self.repeatability is not None:
            error = f" +- {self.repeatability:.2g} from cycle to cycle"
            error += "" if self.stderr is None else f" ({self.stderr:.2g} with the misfit)"
        word = "open:" if self.status == "inseparable" else "90 %:"
        interval = (
            "" if self.low is None or self.high is None else f"{word} {ends(self.low, self.high)}"
        )
        return (
            self.name,
            f"{self.value:.5g}{error}",
            "" if self.unit == "1" else self.unit,
            interval,
            self.status,
        )


def named(parameters: tuple[Parameter, ...], name: str) -> Parameter:
    """The parameter of this name, or of the only one that differs from it by its case.

    Raises `InputError` `unknown-parameter`.
    """
    names = [p.name for p in parameters]
    same = [p for p in parameters if p.name == name] or [
        p for p in parameters if p.name.casefold() == str(name).casefold()
    ]
    if len(same) == 1:
        return same[0]
    near = get_close_matches(str(name), names, 5, 0.5) or names[:10]
    raise InputError(
        "unknown-parameter",
        f"The fit has no parameter {name!r}.",
        fix=f"Use {' or '.join(map(repr, near))}." if near else "This model has no parameters.",
    )


def with_ties(
    parameters: tuple[Parameter, ...], ties: Mapping[str, tuple[str, float]]
) -> tuple[Parameter, ...]:
    """The parameters, of which those that are a factor times another one have that one's errors."""
    sources = {p.name: p for p in parameters}

    def tied(p: Parameter, source: Parameter, factor: float) -> Parameter:
        first, second, *sizes = (
            None if x is None else factor * x
            for x in (source.low, source.high, source.stderr, source.repeatability)
        )
        ends = (first, second) if factor > 0 else (second, first)
        stderr, repeatability = (None if x is None else abs(x) for x in sizes)
        return Parameter(p.name, p.value, p.unit, stderr, "tied", *ends, repeatability)

    return tuple(
        tied(p, sources[ties[p.name][0]], ties[p.name][1]) if p.name in ties else p
        for p in parameters
    )


def correlated(
    parameters: tuple[Parameter, ...], covariance: Float[np.ndarray, "free free"]
) -> dict[str, dict[str, float]]:
    """Correlations of the parameters that have a standard error, by their names."""
    fitted = [p for p in parameters if p.status not in ("fixed", "tied", "inseparable")]
    known = [k for k, p in enumerate(fitted) if p.stderr and len(fitted) == len(covariance)]
    among = covariance[np.ix_(known, known)]
    size = np.sqrt(np.diagonal(among))
    names = [fitted[k].name for k in known]
    rows = (among / np.outer(size, size)).tolist()
    return {n: dict(zip(names, row, strict=True)) for n, row in zip(names, rows, strict=True)}
