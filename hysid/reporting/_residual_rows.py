"""What a report shows beyond the fit itself: residuals of all rows, and the round trip."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from compensate import AbstractCompensator, Status, estimate
from hysteresis import Record

TRIP = 4_000
"""Rows sent through a compensator, at most, twice. The slowest inverses take 0.35 ms a row."""

Outputs = Callable[[Record], Float[np.ndarray, " samples"]]


class Rows(NamedTuple):
    """Residuals of the rows of one or two records, in order.

    `word`: "training", "excluded" (from the fit), "held-out", or "" for rows that do not count.
    """

    input: Float[np.ndarray, " rows"]
    residual: Float[np.ndarray, " rows"]
    word: np.ndarray
    branch: np.ndarray
    starts: Int[np.ndarray, " sequences"]


def residual_rows(
    records: list[Record],
    predicted: list[np.ndarray],
    used: Bool[np.ndarray, " samples"],
    held_out: Bool[np.ndarray, " samples"] | None,
) -> Rows:
    """Rows of the training record and, where that is another, of the held-out one.

    `used` says which training rows were fitted, `held_out` which of that record's are the held-out ones.
    """
    train, *tests = records
    words = [np.where(train.mask, np.where(used, "training", "excluded"), "")]
    if held_out is not None:
        words[0] = np.where(held_out, "held-out", words[0])
    words += [np.where(test.mask, "held-out", "") for test in tests]
    offsets = np.cumsum([0, *map(len, records[:-1])])
    residual = np.concatenate([p - r.output for p, r in zip(predicted, records, strict=False)])
    word = np.where(np.isfinite(residual), np.concatenate(words), "")
    return Rows(
        np.concatenate([r.input for r in records]),
        residual,
        word,
        np.concatenate([r.branch for r in records]),
        np.concatenate([r.starts + k for r, k in zip(records, offsets, strict=True)]),
    )


class RoundTrip(NamedTuple):
    """Measured outputs sent backwards through the compensator.

    - `record`: the rows that were sent, the first of which is `first` of a long record.
    - `estimate`, `status` (rows,): of these rows, each sequence from the virgin state.
    - `counted` (rows,): those that count in an error: masked, with a finite estimate.
    - `rms`, `largest`: of estimate - input, in the input's unit.
    - `exactness`: max |model(compensator(y)) - y| / range over y from the model itself.
    """

    record: Record
    first: int
    estimate: Float[np.ndarray, " rows"]
    status: Int[np.ndarray, " rows"]
    counted: Bool[np.ndarray, " rows"]
    rms: float
    largest: float
    exactness: float


def round_trip(outputs: Outputs, compensator: AbstractCompensator, record: Record) -> RoundTrip:
    """Run the compensator over a record's measured output, and over the model's own `outputs`."""
    span = float(np.ptp(record.output[record.mask])) or 1.0
    first = 0
    if len(record) > TRIP:
        # Rows before those that count make good an unknown first state.
        first = max(0, int(np.argmax(record.mask)) - TRIP // 2)
        record = record.take_rows(first, first + TRIP)
    found = estimate(compensator, record)
    value, status = np.asarray(found.value), np.asarray(found.status)

    own = outputs(record)
    again = estimate(compensator, replace(record, output=own)).value
    back = outputs(replace(record, input=np.asarray(again)))
    exactness = float(np.abs(back - own).max()) / span

    counted = record.mask & np.isfinite(value) & (status != Status.INVALID)
    error = (value - record.input)[counted]
    if not len(error):
        error = np.array([np.nan])
    rms, largest = float(np.sqrt(np.mean(error**2))), float(np.abs(error).max())
    return RoundTrip(record, first, value, status, counted, rms, largest, exactness)
