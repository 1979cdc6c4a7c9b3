"""The condition that a fitted model depends on: its trained values, and the error between them."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import AbstractModel, Conditioned, Record
from hysteresis._format import quantity
from hysteresis.models._conditioned import condition_column, condition_of

from ..records._conditions import between, inner_folds, outside, trained_values
from ..records._folds import BLOCKS_OF_FOLD


class TrainedCondition(NamedTuple):
    """The condition that a fitted model depends on.

    - `name`, `unit`; `low`, `high`: range of the training rows.
    - `values`: the distinct trained values; None where the condition varies within sequences.
    - `knots`, `axis`: of the model, see `Conditioned`.
    - `error`: rms error at trained values that were held out while the model was chosen, in the unit of the
      output: what to expect between trained values. None where fewer than three were trained.
    """

    name: str
    unit: str
    low: float
    high: float
    values: tuple[float, ...] | None
    knots: tuple[float, ...]
    axis: str
    error: float | None

    def beyond(self, record: Record) -> Bool[np.ndarray, " samples"]:
        """Rows whose condition is outside the trained range, by more than trained values scatter."""
        return outside(np.asarray(record.columns[self.name], float), self.low, self.high)

    def between(self, record: Record) -> Bool[np.ndarray, " samples"]:
        """Rows whose condition lies between trained values."""
        c = np.asarray(record.columns[self.name], float)
        if self.values is None:
            return np.zeros(len(c), bool)
        return between(c, np.array(self.values))

    def __str__(self) -> str:
        trained = f"{self.low:.4g} to {quantity(self.high, self.unit)}"
        if self.values is not None:
            trained = f"{', '.join(f'{v:.4g}' for v in self.values)} {self.unit}"
        knots = ", ".join(f"{knot:.4g}" for knot in self.knots)
        return (
            f"The model depends on {self.name}, trained at {trained}: it is interpolated between"
            f" {knots} on a {'straight' if self.axis == 'linear' else self.axis} axis."
        )


def trained_condition(
    model: AbstractModel, train: Record, blocks: Float[np.ndarray, " blocks"] | None
) -> TrainedCondition | None:
    """The condition of a model that was fitted to a record, given its held-out mean squared errors."""
    found: Conditioned | None = condition_of(model)
    if found is None:
        return None
    used = condition_column(train, found.condition)[train.mask]
    values = trained_values(train, found.condition)
    count = BLOCKS_OF_FOLD * inner_folds(values)
    error = None
    if blocks is not None and 0 < count <= len(blocks):
        error = float(np.sqrt(np.mean(blocks[:count])))
    return TrainedCondition(
        found.condition, train.conditions.get(found.condition, found.unit),
        float(used.min()), float(used.max()), None if values is None else tuple(values.tolist()),
        tuple(np.asarray(found.knots, float).tolist()), found.axis, error,
    )  # fmt: skip
