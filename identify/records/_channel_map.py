"""Combining several channels into the one input of a scalar model, by a map that was fitted."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import ChannelMap, InputError, Record


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
