"""The contract of a baseline: what it reads of a record, how it is fitted, what it predicts."""

from dataclasses import replace
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import Record

from .._levels import ENOUGH_ROWS
from ..records._folds import thinned
from ._input_memory import branches_of
from ._linear import cubic_per_branch, straight_line


@runtime_checkable
class AbstractBaseline(Protocol):
    """A predictor in three steps, so that what depends on the input alone is computed once:

        seen = prepared(record);  unknowns = fitted(seen, output, rows, weights);  predicted(seen, unknowns)

    `rows` are the numbers of those it is fitted to; each error is taken times the row's weight. It is
    causal: a prediction depends on the inputs up to its row, and never on an output there.
    """

    @property
    def name(self) -> str: ...
    def prepared(self, record: Record) -> Any: ...
    def fitted(self, seen: Any, output: Any, rows: np.ndarray, weights: np.ndarray) -> Any: ...
    def predicted(self, seen: Any, unknowns: Any) -> np.ndarray: ...


# Baselines of an inverse: the input behind an output, from the output alone and which way it goes.


class Backwards(NamedTuple):
    """A simple inverse: its name, and its estimates of the input in every row."""

    name: str
    estimates: Float[np.ndarray, " samples"]


def backwards(train: Record, used: Bool[np.ndarray, " samples"], record: Record) -> list[Backwards]:
    """A straight line from output to input, and a cubic for either way the output goes, of a record.

    They are fitted to the `used` rows of `train`. Conditions are columns of the line.
    """
    turned, asked = _turned(train), _turned(record)
    rows = thinned(np.flatnonzero(used & np.isfinite(train.output)), ENOUGH_ROWS)
    found = []
    for one in (straight_line((*train.conditions,)), cubic_per_branch(turned, branches_of(turned))):
        unknowns = one.fitted(one.prepared(turned), turned.output, rows, turned.weights)
        found.append(Backwards(one.name, one.predicted(one.prepared(asked), unknowns)))
    return found


def _turned(record: Record) -> Record:
    """The record with its output as input; where that has a gap, the reading before is held."""
    y = record.output.copy()
    for _, rows in record.sequences():
        known = np.flatnonzero(np.isfinite(y[rows]))
        if len(known):
            at = np.searchsorted(known, np.arange(rows.stop - rows.start), side="right") - 1
            y[rows] = y[rows][known[np.maximum(at, 0)]]
    return replace(record, input=np.nan_to_num(y), output=record.input, sigma_name="")
