"""Choice of the rows to hold out, so that models are tested on unseen rows."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hysteresis import InputError, Record
from hysteresis.records._table import Table

from .._selection import selection_of
from ._column_pairs import held, worked

SHARE = 0.25
LONGER = 10.0
"""A relaxation goes on in the logarithm of time: a decade is the most that a record foretells."""


def hold_out(
    table: Table, options: Mapping[str, Any], split: tuple[str, str] | None
) -> tuple[dict[str, Any], str]:
    """The hold-out as an option of `hysid fit`, and why that one.

    In this order: what the file itself calls a test; a quarter of the sequences, within the range of the
    others; the last cycles; the last part of a long way; nothing.
    """
    for proposed, why in _proposals(table, options, split):
        if not proposed:
            return {}, why
        try:
            good, faults = selection_of(dict(options) | proposed).records(table)
        except InputError:
            continue
        if len(good) > len(faults):
            return proposed, why
    return {}, "there are too few rows to hold any out"


def _proposals(table: Table, options: Mapping[str, Any], split: tuple[str, str] | None):
    if split is not None:
        yield {"test_where": [f"{split[0]}={split[1]}"]}, "the file marks these rows as test rows"
    good, _ = selection_of(options).records(table)
    if selection_of(options).is_step:
        if any(_far(record) for record, _ in good.values()):
            long = "the last fifth of its rows lasts many times as long as all before"
            yield {}, f"{long}, which do not tell it"
        yield {"test_tail": 0.2}, "the last fifth, which tests the prediction of later times"
        return
    record = next(iter(good.values()))[0]
    group = tuple(options.get("group") or ())
    if group and len(good) == 1 and len(record.labels) >= 4:
        chosen = _sequences(table, record, group[0])
        if chosen:
            yield {"test_where": [chosen]}, "whole sequences, within the range of the others"
    counts = min(int(r.cycle_counts.min()) for r, _ in good.values())
    if counts >= 2:
        n = max(1, counts // 3)
        yield {"test_cycles": n}, f"the last{f' {n}' * (n > 1)} of {counts} cycles"
    if group and len(good) == 1 and 2 <= len(record.labels) <= 3:
        last = list(record.labels)[-1].split("/")[0]
        yield {"test_where": [f"{group[0]}={last}"]}, "the last sequence"
    if counts < 2 and all(held(worked(r.input)) > 0.7 and not _far(r) for r, _ in good.values()):
        why = "the last fifth of the hold, which tests the prediction of later times"
        yield {"test_tail": 0.2}, why
    turns = sum(int(np.count_nonzero(np.diff(r.branch))) for r, _ in good.values())
    if turns >= 3:
        why = "the last quarter of the rows, because there are too few complete cycles"
        yield {"test_tail": SHARE}, why
    yield {}, "one loop only; a test on unseen rows needs a second one"


def _far(record: Record) -> bool:
    """Whether the last fifth of a sequence's rows goes on for more than `LONGER` times all before, as rows
    that are even in the logarithm of time do."""
    time = record.time
    clocks = [] if time is None else [time[rows] for _, rows in record.sequences()]
    return any(t[-1] - t[0] > LONGER * (t[int(0.8 * (len(t) - 1))] - t[0]) for t in clocks)


def _sequences(table: Table, record: Record, column: str) -> str:
    """A condition that holds out about a quarter of the sequences: those of middling range."""
    values = list(dict.fromkeys(table.text[column].tolist()))
    whole = all(v.lstrip("-").isdigit() for v in values)
    if whole and len(values) >= 12:
        return f"{column}%4=0"
    spans = {}
    for label, rows in record.sequences():
        key = label.split("/")[0].split("#")[0]
        u = record.input[rows]
        low, high = spans.get(key, (np.inf, -np.inf))
        spans[key] = min(low, float(np.nanmin(u))), max(high, float(np.nanmax(u)))
    low, high = min(a for a, _ in spans.values()), max(b for _, b in spans.values())
    slack = 0.02 * (high - low)
    widest = max(spans, key=lambda k: spans[k][1] - spans[k][0])
    least, most = spans[widest][0] - slack, spans[widest][1] + slack
    inside = [
        k for k, (a, b) in spans.items() if k != widest and "," not in k and least <= a and b <= most
    ]  # fmt: skip
    count = max(1, int(SHARE * len(spans)))
    chosen = inside[:: max(1, len(inside) // count)][-count:] if inside else []
    return f"{column}={','.join(chosen)}" if chosen else ""
