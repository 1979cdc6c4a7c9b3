"""The condition of a record, such as a temperature: its trained values, and folds that hold some out."""

import numpy as np
from jaxtyping import Bool, Float, Int

from hysteresis import InputError, Record
from hysteresis.records._branch_rows import STILL

from .._levels import GROUPS
from ._folds import QUARTERS, Fold, Parts

BLOCKS = QUARTERS + 2
"""Of consecutive rows, where no condition can be held out; the first and the last are always trained."""


def name_of_condition(record: Record) -> str | None:
    """The condition of a record; None where it has none.

    Raises `InputError` `several-conditions` where it has more than one.
    """
    if len(record.conditions) > 1:
        raise InputError(
            "several-conditions",
            f"The record has {len(record.conditions)} conditions: {', '.join(record.conditions)}.",
            cause="a model depends on one condition beside its input.",
            fix="name the one that matters most (--condition COL), and fit the others apart (--each COL).",
        )
    return next(iter(record.conditions), None)


def trained_values(record: Record, name: str) -> Float[np.ndarray, " values"] | None:
    """The distinct values of a condition that is nearly constant in every sequence; None where it varies.

    Values closer than `STILL` of their range are one.
    """
    c = record.columns[name]
    span = float(np.ptp(c[record.mask]))
    found = []
    for _, rows in record.sequences():
        used = c[rows][record.mask[rows]]
        if used.size and np.ptp(used) > STILL * span:
            return None
        if used.size:
            found.append(used.mean())
    each = np.sort(found)
    groups = np.split(each, np.flatnonzero(np.diff(each) > STILL * span) + 1)
    return np.array([group.mean() for group in groups])


def outside(
    c: Float[np.ndarray, " samples"], low: float, high: float
) -> Bool[np.ndarray, " samples"]:
    """Where a condition is beyond the trained ones, by more than they scatter."""
    margin = STILL * (high - low)
    return (c < low - margin) | (c > high + margin)


def between(
    c: Float[np.ndarray, " samples"], trained: Float[np.ndarray, " values"]
) -> Bool[np.ndarray, " samples"]:
    """Where a condition lies between trained values, farther from each than they scatter."""
    margin = STILL * float(np.ptp(trained))
    near = np.abs(c[:, None] - trained).min(1) <= margin
    return ~near & ~outside(c, float(trained.min()), float(trained.max()))


def condition_parts(record: Record, name: str) -> Parts:
    """The rows that count in parts of one value, or a narrow range, of the condition, and folds of them.

    Of three values or more each inner one is held out in turn, because a model is judged by how it
    interpolates; then blocks of rows of the two outer ones, because those are never held out. Of fewer,
    sequences are held out, some of each value; of a single sequence, or where the condition varies, blocks
    of consecutive rows.
    """
    values, c = trained_values(record, name), record.columns[name]
    if values is None or len(values) > GROUPS:
        ends = np.linspace(c[record.mask].min(), c[record.mask].max(), GROUPS + 1)
        bin_of = np.clip(np.digitize(c, ends[1:-1]), 0, GROUPS - 1)
    else:
        bin_of = _nearest(c, values)
    fold, how = _folds_of(record, values, c)
    bins = int(bin_of.max()) + 1
    label = np.where(record.mask, fold * bins + bin_of, -1)
    cells, packed = np.unique(label[label >= 0], return_inverse=True)
    label[label >= 0] = packed
    of = cells // bins
    folds = tuple(
        Fold(tuple(np.flatnonzero(of != k).tolist()), tuple(np.flatnonzero(of == k).tolist()))
        for k in range(1, int(of.max()) + 1)
    )
    return Parts(label, folds, None, how)


def inner_folds(values: Float[np.ndarray, " values"] | None) -> int:
    """How many of the folds of `condition_parts`, the first ones, hold out conditions."""
    return 0 if values is None else int(np.clip(len(values) - 2, 0, QUARTERS))


def _folds_of(
    record: Record, values: Float[np.ndarray, " values"] | None, c: Float[np.ndarray, " samples"]
) -> tuple[Int[np.ndarray, " samples"], str]:
    """The fold that holds each row out, from 1; 0 where none does. And that in words."""
    fold = np.zeros(len(record), int)
    counted = [rows for _, rows in record.sequences() if record.mask[rows].any()]
    if values is not None and (number := inner_folds(values)):
        nearest = _nearest(c, values)
        inner = (nearest > 0) & (nearest < len(values) - 1)
        for rows in counted:
            fold[rows] = np.where(inner[rows], 0, _blocks(record, rows, number, 2))
        fold[inner] = 1 + (nearest[inner] - 1) % number
        return fold, f"{len(values) - 2} inner conditions and on parts of the outer ones"
    keys = np.zeros(len(counted), int)
    if values is not None:
        keys = np.array([_nearest(c[rows].mean(keepdims=True), values)[0] for rows in counted])
    least = int(np.bincount(keys)[np.unique(keys)].min())
    if least > 1:
        number, seen = min(QUARTERS, least), dict.fromkeys(keys.tolist(), 0)
        for key, rows in zip(keys.tolist(), counted, strict=True):
            fold[rows] = 1 + seen[key] % number
            seen[key] += 1
        return fold, f"{number} groups of sequences, each held out in turn"
    for rows in counted:
        fold[rows] = _blocks(record, rows, 0, BLOCKS - 2)
    return fold, f"{BLOCKS - 2} inner blocks of rows, each held out in turn"


def _blocks(record: Record, rows: slice, first: int, folds: int) -> Int[np.ndarray, " rows"]:
    """The inner blocks of a sequence's rows dealt to folds `first` + 1 and on; 0 for the outer ones."""
    counted = np.cumsum(record.mask[rows])
    block = np.minimum(BLOCKS * counted // (counted[-1] + 1), BLOCKS - 1)
    inner = (block > 0) & (block < BLOCKS - 1)
    return np.where(inner, first + 1 + (block - 1) % folds, 0)


def _nearest(
    c: Float[np.ndarray, " samples"], values: Float[np.ndarray, " values"]
) -> Int[np.ndarray, " samples"]:
    return np.abs(c[:, None] - values).argmin(1)
