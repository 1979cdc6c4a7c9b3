"""Baselines that are linear in their unknowns: constant, straight line, cubic per branch, ridge."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from hysteresis import Record
from hysteresis.numerics import _recurrence as input_memory

from .._levels import PRIOR_STRENGTHS, RADII
from ..records._clocks import slow_times
from ._input_memory import OncePerInput

Design = Callable[[Record], Float[np.ndarray, "samples columns"]]

LAGS = tuple(2**k for k in range(6))
"""Rows back."""

FEW = 2
"""So many further columns also multiply all others."""


class Weights(NamedTuple):
    """Output = level + (columns - centre) weights."""

    level: float
    centre: Float[np.ndarray, " columns"]
    weights: Float[np.ndarray, " columns"]


@dataclass(frozen=True)
class LinearBaseline:
    """Least squares on some columns, with a penalty on standardised weights where one is given.

        minimise  sum (y - level - X w)^2 + penalty n sum (w_k sd_k)^2

    Source: Hastie, Tibshirani, Friedman, The Elements of Statistical Learning (2009), section 3.4.
    """

    name: str
    design: Design
    penalty: float = 0.0

    def prepared(self, record: Record) -> Float[np.ndarray, "samples columns"]:
        return self.design(record)

    def fitted(
        self, seen: np.ndarray, output: np.ndarray, rows: np.ndarray, weights: np.ndarray
    ) -> Weights:
        x, y, each = seen[rows], output[rows], weights[rows, None]
        centre, level = (np.average(a, 0, each[:, 0] ** 2) for a in (x, y))
        x, y = x - centre, each[:, 0] * (y - level)
        size = x.std(0)
        # A column that is constant here, up to rounding, says nothing: its weight is 0.
        told = size > 1e-12 * np.maximum(np.abs(centre), np.abs(x).max(0, initial=0.0))
        x = each * x[:, told] / size[told]
        found_all = np.zeros(len(centre))
        if self.penalty:
            normal = x.T @ x / len(y) + self.penalty * np.eye(x.shape[1])
            found = np.linalg.solve(normal, x.T @ y / len(y))
        else:
            found = np.linalg.lstsq(x, y, rcond=None)[0]
        found_all[told] = found / size[told]
        return Weights(float(level), centre, found_all)

    def predicted(self, seen: np.ndarray, unknowns: Weights) -> Float[np.ndarray, " samples"]:
        # The columns are not copied: they are the largest array there is.
        level = unknowns.level - unknowns.centre @ unknowns.weights
        return level + seen @ unknowns.weights


def constant() -> LinearBaseline:
    """The mean output of the rows it is fitted to."""
    return LinearBaseline("constant", lambda record: np.empty((len(record), 0)))


def straight_line(columns: tuple[str, ...], combined: bool = False) -> LinearBaseline:
    """A line in the input, and in each of further columns; where these are `combined` to the input, in them
    alone, because it may be a sum of them."""
    name = "straight line" if not columns else "linear in all columns"

    def design(record: Record) -> np.ndarray:
        inputs = [] if combined else [record.input]
        return np.column_stack([*inputs, *(record.columns[c] for c in columns)])

    return LinearBaseline(name, design)


def cubic_per_branch(train: Record, branches: OncePerInput) -> LinearBaseline:
    """A cubic of the input while it rises, and another one while it falls; `branches` say which it does."""
    u = train.input[train.mask]
    middle, half = (u.max() + u.min()) / 2, (np.ptp(u) / 2) or 1.0

    def design(record: Record) -> np.ndarray:
        x = (record.input - middle) / half
        rises = branches(record) > 0
        found = np.empty((len(x), 7), order="F")
        for k in range(7):
            np.power(x, (k + 1) % 4, out=found[:, k])
            if k > 2:
                found[:, k] *= rises
        return found

    return LinearBaseline("cubic per branch", design)


def ridges(train: Record, columns: tuple[str, ...]) -> tuple[LinearBaseline, ...]:
    """Ridge regression on the input, its lags, stop operators and, with a clock, slow states, at several
    penalties."""
    radii = RADII * (float(np.ptp(train.input[train.mask])) or 1.0)
    times = slow_times(train)

    def made(record: Record) -> np.ndarray:
        # A condition, such as a pressure, changes the size of an effect.
        factors = [record.columns[name] for name in columns] if len(columns) <= FEW else []
        slow = 0 if record.time is None else len(times)
        widths = len(radii), 1, len(LAGS), slow, len(columns)
        width = sum(widths)
        # The largest array of a fit. By columns, it takes no memory before each part is put there: first
        # what takes most memory beside it.
        found = np.empty((len(record), width * (1 + len(factors))), order="F")
        parts = np.split(found[:, :width], np.cumsum(widths)[:-1], axis=1)
        for _, rows in record.sequences():
            u, (of_stops, _, lags, states, _) = record.input[rows], [part[rows] for part in parts]
            if slow and record.time is not None:
                input_memory.slow_states(u, record.time[rows], np.array(times), states)
            input_memory.stops(u, radii, of_stops)
            # Less what it was so many rows ago; before its sequence it was as in the first row.
            for k, back in enumerate(LAGS):
                lags[:, k] = u
                lags[:back, k] -= u[0]
                lags[back:, k] -= u[:-back]
        parts[1][:, 0] = record.input
        for k, name in enumerate(columns):
            parts[4][:, k] = record.columns[name]
        for k, factor in enumerate(factors, 1):
            np.multiply(
                found[:, :width], factor[:, None], out=found[:, k * width : (k + 1) * width]
            )
        return found

    memory = "lags, stops and slow states" if times else "lags and stops"
    design = OncePerInput(made, columns)
    return tuple(
        LinearBaseline(f"ridge on {memory}", design, penalty) for penalty in PRIOR_STRENGTHS
    )
