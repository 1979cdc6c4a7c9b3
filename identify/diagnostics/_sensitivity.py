"""What the fitted parameters hang on: the first cycle, outliers, any one cycle."""

from collections.abc import Iterator
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Float

from .._levels import CHANCE, GROUPS
from ..posterior._log_posterior import target
from ..posterior._mode import likeliest_near
from ..results._fit_result import FitResult
from ..results._repeatability import cycles_or_sequences
from ._whiteness import innovations

SHORT = 10
"""Rows of a sequence that is no cycle of its own."""


class Without(NamedTuple):
    """The fit without some of its rows.

    - `said`: which. `rows`: how many. `values` (parameters,): in their units.
    - `changes` (parameters,): in standard errors, NaN for a parameter that has none. `expected`: what
      chance alone would make of that, sqrt(f / (1 - f)) for the fraction f of the rows.
    """

    said: str
    rows: int
    values: Float[np.ndarray, " parameters"]
    changes: Float[np.ndarray, " parameters"]
    expected: float

    @property
    def most(self) -> float:
        """The largest change."""
        return float(np.nan_to_num(np.abs(self.changes)).max(initial=0.0))

    @property
    def clear(self) -> bool:
        """Whether a parameter moves by more than chance, and by more than two errors."""
        return self.most > max(3 * self.expected, 2.0)


class Sensitivity(NamedTuple):
    """Parameters of the fit, and what they are without some rows."""

    names: tuple[str, ...]
    cases: tuple[Without, ...]

    @property
    def said(self) -> tuple[str, ...]:
        """The cases that matter, in words."""
        found = []
        for case in self.cases:
            if case.clear:
                k = int(np.nanargmax(np.abs(case.changes)))
                found.append(
                    f"Without {case.said}, {self.names[k]} moves by {case.most:.1f} standard errors to"
                    f" {case.values[k]:.4g}."
                )
        if not self.cases:
            return ("One cycle, so nothing can be left out.",)
        most = max(case.most for case in self.cases)
        calm = (
            f"No cycle, and no outlier, moves a parameter beyond chance ({most:.1f} standard errors"
            " at most)."
        )
        return tuple(found) or (calm,)


def sensitivity(fit: FitResult) -> Sensitivity:
    """The likelihood's maximum without the first cycle, without each cycle in turn, and without rows that
    are farther off than chance puts any in one of a hundred records. Sequences stand for cycles where there
    are several.

    Rows left out are not scored, but still drive the model and the noise. Each case is sought from the
    optimum by Newton's method; that takes a few steps.

    **Example:**

        >>> found = identify.sensitivity(fit)
        >>> [case.said for case in found.cases]
        ['the first cycle', 'cycle 2', 'cycle 3', 'cycle 4']
    """
    aim, used = target(fit), fit.used
    names = tuple(p.name for p in fit.parameters if p.name in aim.names)
    at = [aim.names.index(name) for name in names]
    error = np.array([p.stderr or np.nan for p in fit.parameters if p.name in aim.names], float)

    def values(scored: np.ndarray) -> np.ndarray:
        weights = jnp.asarray(scored.astype(float))
        everything = jnp.ones(len(aim.names), bool)
        found = likeliest_near(aim, aim.start, everything, weights)
        return aim.values(np.asarray(found.point))[at]

    whole, cases = values(used), []
    for said, left_out in _cases(fit):
        found = values(used & ~left_out)
        share = float((used & left_out).sum() / used.sum())
        chance = float(np.sqrt(share / (1 - share)))
        rows = int((used & left_out).sum())
        cases.append(Without(said, rows, found, (found - whole) / error, chance))
    return Sensitivity(names, tuple(cases))


def _cases(fit: FitResult) -> Iterator[tuple[str, np.ndarray]]:
    """What is left out, and those rows."""
    record, used = fit.train, fit.used
    kind = "sequence" if len(record.labels) > 1 else "cycle"
    labels, which = cycles_or_sequences(record)
    counts = np.bincount(which[used])
    numbers = [n for n in range(1, len(counts)) if counts[n] > SHORT]
    if len(numbers) > 1:
        groups = np.array_split(numbers, min(len(numbers), GROUPS))
        for group in groups:
            names = [labels[n].removeprefix("cycle ") for n in group]
            first = group[0] == numbers[0] and len(group) == 1
            said = f"the first {kind}" if first else f"{kind} {names[0]}"
            if len(group) > 1:
                said = f"{kind}s {names[0]} to {names[-1]}"
            yield said, np.isin(which, group)
    most = float(-scipy.special.ndtri(CHANCE / (2 * used.sum())))  # of so many normal deviations
    far = used & (np.abs(innovations(fit)) > most)
    if count := int(far.sum()):
        yield f"{count} row{'s'[: count > 1]} beyond {most:.2g} deviations", far
