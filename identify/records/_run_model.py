"""Running a model over a record: every sequence starts from the virgin state."""

from typing import Any

import numpy as np
from jaxtyping import Float

from hysteresis import AbstractModel, Preisach, Record
from hysteresis.models._conditioned import with_condition
from hysteresis.preisach._preisach import PreisachInput


def prepare(model: AbstractModel, record: Record) -> Any:
    """The record's input prepared for the model; every sequence starts from the virgin state."""
    return model.prepare(
        record.time, with_condition(model, record, record.input), starts=starts_of(record)
    )


def located(model: Preisach, record: Record) -> PreisachInput:
    """`prepare` of a Preisach model in NumPy: nothing is compiled."""
    return model.located(record.input, starts=starts_of(record))


def predict(model: AbstractModel, record: Record) -> Float[np.ndarray, " samples"]:
    """The model's output on the record, in the output's unit; each sequence starts in the virgin state."""
    u = with_condition(model, record, record.input)
    return np.asarray(model.simulate(record.time, u, starts=starts_of(record)))


def starts_of(record: Record) -> tuple[int, ...]:
    """The first row of each sequence, as a model takes them."""
    return tuple(int(k) for k in record.starts)


def same_inputs(one: Record, other: Record, columns: tuple[str, ...] = ()) -> bool:
    """Whether two records differ at most in outputs and in the rows that count, `columns` included."""
    pairs = [(one.input, other.input), (one.starts, other.starts)]
    pairs += [(one.columns[name], other.columns[name]) for name in columns]
    if one.time is not None and other.time is not None:
        pairs.append((one.time, other.time))
    clocks = (one.time is None) == (other.time is None)
    return clocks and all(a is b or np.array_equal(a, b) for a, b in pairs)
