"""The condition that a fitted model depends on: its trained values, and the error between them."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import AbstractModel, Conditioned, Record
from hysteresis._format import ends
from hysteresis._quantities import require_same
from hysteresis.models._conditioned import condition_column, condition_of

from ..records._conditions import between, inner_folds, outside, trained_values
from ..records._folds import BLOCKS_OF_FOLD
from ..records._new_record import going_on
from ..records._sequence_terms import RELATIVE, FromKnown, Misfit, from_known

# What a fit predicts behind known rows.


def misfit_of(fit: Any) -> Misfit:
    """What the model of a fit errs by on its training rows, and how long an error lasts."""
    error, relative = fit.metrics["train"], fit.train.sigma_name == RELATIVE
    rms = 0.0 if error is None else error.rmse
    rms = rms / fit.train.typical_sigma if relative else rms
    return Misfit(rms, relative, fit.noise.correlation_time / 2)


def told(fit: Any, record: Record) -> FromKnown:
    """Outputs on a record as the model sees it, and their deviation for want of knowing the first state.

    Raises `InputError` `wrong-unit` where the output has another unit than the fit's.
    """
    check_units(fit, record, "output")
    if fit.sequences is not None:
        return FromKnown(*fit.sequences.predicted(record))
    return from_known(going_on(fit.model, record), record, misfit_of(fit))


def check_units(fit: Any, record: Record, *sides: str) -> None:
    """Raise `InputError` where a column is in another unit than it was fitted in, and both are known.

    Of a record the time, the conditions, and these sides, "input" and "output"; of several channels each.
    """
    train, channels = fit.train, fit.channels
    fitted = {train.input_name: train.input_unit} | train.conditions
    fitted |= {} if channels is None else dict(zip(channels.names, channels.units, strict=True))
    columns = {**record.channels, **record.conditions}
    known: list[Any] = [(name, unit, fitted.get(name, "1")) for name, unit in columns.items()]
    known += [
        (getattr(record, f"{side}_name"), *(getattr(of, f"{side}_unit") for of in (record, train)))
        for side in ("time", *sides)
        if side != "input" or not record.channels
    ]
    require_same(known)


# How many of the held-out rows lie beyond what a fit has seen, and how large its error is there.


class RowsBeyond(NamedTuple):
    """Some held-out rows: how many, and the rms error over them; None where there are none."""

    rows: int
    rmse: float | None


class Extrapolation(NamedTuple):
    """Held-out rows beyond the range of the fitted ones, by what is beyond, and those inside all ranges.

    - `input`: the input, a channel of it or a condition lies outside the trained ones, see
      `FitResult.beyond`. `rate`: it moves faster than ever.
    - `time`: it has been held for longer than ever, where that means within 2 % of its range.
    - `inside`: none of these.
    """

    input: RowsBeyond
    rate: RowsBeyond
    time: RowsBeyond
    inside: RowsBeyond

    @property
    def document(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {name: part._asdict() for name, part in self._asdict().items()}


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
        trained = ends(self.low, self.high, self.unit)
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
