"""Fits of creep and relaxation: their options, what is in a record, what a prediction is worth."""

from typing import Any

import numpy as np

import identify
from hysteresis import InputError, Record

from ._fit_options import FIT_FIELDS

BEYOND = "beyond the trained times"
RANGE = ("since the step", "low", "high")
"""Columns that a step's prediction has besides."""
_NOT_OF_STEP: dict[str, Any] = {"parameters": {}} | {
    name: one.default for name, one in FIT_FIELDS.items() if not one.metadata.get("of_step")
}


def step_options(options: dict[str, Any]) -> dict[str, Any]:
    """Those options of `fit` that `fit_step` takes. Raises `InputError` where others were set."""
    for name, usual in _NOT_OF_STEP.items():
        if options.get(name, usual) != usual:
            raise InputError(
                "bad-option",
                f"--{name} cannot be used with --step or --hold.",
                cause="Creep and relaxation are fitted by a spectrum of time constants; the evidence"
                " chooses its order.",
                fix="Leave it out.",
            )
    return {name: value for name, value in options.items() if name not in _NOT_OF_STEP}


def check_step(record: Record) -> dict[str, Any]:
    """What is in a record of creep or relaxation, and what to mind."""
    record = identify.internal.stepped(record)
    kind = identify.internal.kind_of(record)
    rows = record.mask & np.isfinite(record.output)
    assert record.time is not None
    t = record.time[rows]
    decades = float(np.log10(t[-1] / t[t > 0][0]))
    warnings = [str(note) for note in identify.internal.told_by_the_change(record, kind)]
    if decades < 1:
        warnings.append(
            f"The rows span {decades:.2g} decades of time: more than one time constant can hardly be"
            " told. [short-span]"
        )
    text = record.describe(loop=f"step   {kind} over {decades:.2g} decades of time")
    found = {"kind": kind, "decades": decades, "warnings": warnings}
    return {"text": text} | found | record.summary()


def on_the_clock_of(fitted: identify.FitResult, record: Record) -> Record:
    """A record with its step where the fitted one had it: at zero of its clock, or at its first row."""
    return identify.internal.stepped(
        record, at_first_row=identify.internal.is_at_first_row(fitted.train)
    )


def later(fitted: identify.FitResult, record: Record) -> list[str]:
    """What to say about each row of a record: is it beyond the times that were fitted?"""
    assert record.time is not None
    span = _spectrum(fitted).span
    return [BEYOND if t > span else "OK" for t in record.time]


def open_range(fitted: identify.FitResult, record: Record) -> np.ndarray:
    """Of every row the time, the least and the largest output that the fitted record leaves open.

    NaN on the way to a hold.
    """
    assert record.time is not None
    way = identify.internal.way_of(record)
    found = _spectrum(fitted)._replace(way=way)
    _, low, high = found.predict(np.maximum(record.time, 0.0))
    ends = np.sort(np.stack([low, high], 1) * record.input[-1], axis=1)
    ends[record.time < 0] = np.nan
    return np.column_stack([record.time, ends])


def _spectrum(fitted: identify.FitResult) -> identify.Spectrum:
    assert isinstance(fitted.detail, identify.DiscreteSpectrum)
    return fitted.detail.spectrum
