"""A new record from arrays, for a model that was fitted to another one."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, ChannelMap, InputError, Preisach, Record
from hysteresis.models._conditioned import condition_column, condition_of, with_condition
from hysteresis.models._extrapolation import extended
from hysteresis.preisach._preisach import PreisachInput

# Combining several channels into the one input of a scalar model, by a map that was fitted.


def combine(record: Record, channels: ChannelMap | None) -> Record:
    """The record with its channels combined, as it is where none are left to combine.

    Raises `InputError` where the record lacks a channel of the map, or has channels and there is no map.
    """
    if not record.channels and (channels is None or record.input_name == combined_name(channels)):
        return record
    names = () if channels is None else channels.names
    if lacking := [name for name in names if name not in record.channels]:
        problem = (
            f"Fitted to {len(names)} channels, of which the record lacks {', '.join(lacking)}."
        )
        raise InputError("wrong-channels", problem, fix="give the channels it was fitted to.")
    if channels is None:
        problem = f"Fitted to one input, and the record has {len(record.channels)} channels."
        raise InputError("wrong-channels", problem, fix="give the input it was fitted to.")
    x = columns_of(record, channels)
    # Curves of all rows at once: JAX compiles for each length.
    combined = np.array(channels.curves(x))
    for _, rows in record.sequences() if channels.memory is not None else ():
        combined[rows] += channels.left(x[rows], None if record.time is None else record.time[rows])
    return replace(
        record,
        input=combined,
        input_name=combined_name(channels),
        input_unit=record.output_unit,
        channels={},
    )


def as_condition(record: Record, name: str, conditions: Collection[str]) -> Record:
    """The record with the input `name` and some of its other channels as conditions, where it has both as
    channels, or the one for the other."""
    units = {**record.channels, record.input_name: record.input_unit, **record.conditions}
    if not {name, *conditions} <= {*units} & {*record.columns}:
        return record
    held = {one: units[one] for one in conditions}
    return replace(
        record, input=record.columns[name], input_name=name, input_unit=units[name], channels={},
        conditions=held,
    )  # fmt: skip


def combined_name(channels: ChannelMap) -> str:
    """What the combined input is called."""
    return f"{len(channels.names)} channels combined"


def beyond(record: Record, channels: ChannelMap, seam: float) -> Bool[np.ndarray, " samples"]:
    """Where some channel is outside what the map was fitted on, by more than this part of its range."""
    x, nodes = columns_of(record, channels), np.asarray(channels.nodes)
    low, high = nodes[:, 0], nodes[:, -1]
    margin = seam * (high - low)
    return np.any((x < low - margin) | (x > high + margin), axis=1)


def columns_of(record: Record, channels: ChannelMap) -> Float[np.ndarray, "samples channels"]:
    """The channels of a map, as columns."""
    return np.column_stack([record.columns[name] for name in channels.names])


def new_record(
    fitted: Record,
    channels: ChannelMap | None,
    input: ArrayLike,
    time: ArrayLike | None,
    condition: ArrayLike | Mapping[str, ArrayLike] | None,
) -> Record:
    """One sequence of inputs (n,), or (n, channels), in the units of the fitted record; without outputs.

    Raises `InputError` `length-mismatch`, `bad-option`, and as `Record.from_arrays` does.
    """
    names, values = [*fitted.conditions], np.asarray(input, float)
    given = condition if isinstance(condition, Mapping) else dict.fromkeys(names[:1], condition)
    columns = {
        name: np.broadcast_to(np.asarray(x, float), len(values))
        for name, x in given.items()
        if x is not None
    }
    if (condition is not None and not names) or not {*columns} <= {*names}:
        raise InputError(
            "bad-option",
            f"The output depends on {', '.join(names) or 'no condition'} in this fit.",
            fix="Name its conditions alone (condition=)." if names else "Leave out condition=.",
        )
    wanted = (len(values),) if channels is None else (len(values), len(channels.names))
    if values.shape != wanted:
        raise InputError("length-mismatch", f"input: shape {values.shape}; the fit takes {wanted}.")
    if channels is not None:
        columns |= dict(zip(channels.names, values.T, strict=True))
        values = np.asarray(channels(values))
    return Record.from_arrays(
        values,
        np.full(len(values), np.nan),
        time,
        mask=np.zeros(len(values), bool),
        columns=columns,
        conditions={name: fitted.conditions[name] for name in columns if name in names},
        input_name=fitted.input_name if channels is None else combined_name(channels),
        input_unit=fitted.input_unit,
        output_name=fitted.output_name,
        output_unit=fitted.output_unit,
        time_unit=fitted.time_unit,
    )


# Running a model over a record: every sequence starts from the virgin state.


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


def going_on(model: Any, record: Record) -> Any:
    """The model as it predicts inputs and conditions of the record beyond its own, see `extended`."""
    columns = [record.input]
    if (found := condition_of(model)) is not None:
        columns.append(condition_column(record, found.condition))
    inputs, *conditions = [(float(np.nanmin(x)), float(np.nanmax(x))) for x in columns]
    return extended(model, *inputs, *conditions)


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
