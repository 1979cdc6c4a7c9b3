"""Options that make a file readable: decimal sign, missing values, remedies for the reader's faults."""

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hysteresis import InputError, Record
from hysteresis._quantities import conversion
from hysteresis.records._arrays import marks
from hysteresis.records._table import Table
from hysteresis.records._units import MASSES, is_unit, kind_of, unit_of
from hysteresis.records.importers._sheet import is_number

from .._selection import all_of, selection_of
from ._column_pairs import LARGEST, held, worked

Options = dict[str, Any]
Note = tuple[str, str, str]
SPARSE = 0.05
"""Above this share of gaps, rows without input and output belong to another part of the file."""
EVEN = 0.01
"""By how much of it even steps of a clock differ, but for a few."""
_INSIDE = ("N", "mN", "kN", "gf", "mm", "um", "V", "mV", "A", "mA", "Pa", "kPa", "MPa")


def settle(table: Table, options: Options) -> tuple[Options, list[Note]]:
    """Options with which the file can be read, and what was added.

    Every fault that the reader names has at most one remedy here, tried once; other faults are raised.
    """
    notes: list[Note] = []
    options = _units(table, dict(options), notes)
    tried: set[tuple[str, str]] = set()
    while True:
        try:
            good, faults = selection_of(options).records(table)
        except InputError as error:
            fault = error
        else:
            if not faults or len(faults) < len(good):
                return options, notes
            fault = all_of(faults)
        remedy = _REMEDIES.get(fault.code)
        if remedy is None or (fault.code, fault.place) in tried:
            raise fault
        tried.add((fault.code, fault.place))
        added, why = remedy(table, options, fault)
        for key in ("time",) if "dt" in added else ():
            options.pop(key, None)
        options |= added
        notes += [(key, str(value), why) for key, value in added.items()]


def _units(table: Table, options: Options, notes: list[Note]) -> Options:
    """A unit within a header ("force_N_raw"), and grams for a force."""
    for role in ("input", "output"):
        name = options.get(role)
        if not isinstance(name, str) or f"{role}_unit" in options or name not in table.columns:
            continue
        unit = unit_of(name, table.units.get(name))
        inside = [w for w in name.split("_")[1:] if w in _INSIDE]
        if unit == "1" and inside:
            options[f"{role}_unit"] = inside[0]
            notes.append((f"{role}_unit", inside[0], "part of the header"))
        elif unit in MASSES and kind_of(name, unit).name == "force":
            options[f"{role}_unit"] = MASSES[unit]
            why = f"a force in {unit} is the weight of that mass"
            notes.append((f"{role}_unit", MASSES[unit], why))
    return options


def _interpolate(table: Table, options: Options, fault: InputError) -> tuple[Options, str]:
    inputs = options["input"] if isinstance(options["input"], list) else [options["input"]]
    if options.get("nan") is None and "dt" not in options and "input_time" not in options:
        gaps = np.logical_or.reduce([np.isnan(table.number(name)) for name in inputs])
        both = np.isnan(table.number(options["output"])[gaps]).all()
        if both and gaps.mean() > SPARSE:
            return {"nan": "omit"}, "rows that have neither input nor output are left out"
    return {"nan": "interpolate"}, f"gaps of the input are interpolated linearly: {fault.problem}"


def _omit(table: Table, options: Options, fault: InputError) -> tuple[Options, str]:
    return {"nan": "omit"}, f"rows without an output are excluded: {fault.problem}"


def _segments(table: Table, options: Options, fault: InputError) -> tuple[Options, str]:
    t = table.columns[options["time"]]
    step = np.diff(t[np.isfinite(t)])
    if (step > 0).any() and -step.min() < np.median(step[step > 0]):
        return _even(table, options, fault)  # a stamp out of order begins no sequence
    return {"segments": "auto"}, f"a new sequence starts wherever time goes back: {fault.problem}"


def _even(table: Table, options: Options, fault: InputError) -> tuple[Options, str]:
    t = table.columns[options["time"]]
    t = t[np.isfinite(t)]
    # From one change of the clock to the next: the rows before the first and behind the last are cut off.
    # Where a new run begins, or a break ends, the clock leaps.
    at = np.flatnonzero(np.diff(t, prepend=-np.inf) != 0)[1:]
    rows, step = np.diff(at), np.diff(t[at])
    forward = step > 0
    if not forward.any():
        raise fault
    forward &= step < 20 * step[forward].mean()
    each = step[forward] / rows[forward]
    usual = float(np.median(each))
    even = np.mean(np.abs(each - usual) < EVEN * usual) >= 1 - SPARSE
    dt = usual if even else float(step[forward].sum() / rows[forward].sum())
    coarse = np.mean(np.diff(t) == 0) > SPARSE
    why = "because the recorded one is coarser than the sampling" if coarse else "by its usual step"
    why = f"an even clock, {why}"
    seconds = conversion(unit_of(options["time"], table.units.get(options["time"])), "s") or 1.0
    return {"dt": float(f"{dt * seconds:.4g}")}, f"{why}: {fault.problem}"


def _unknown_unit(table: Table, options: Options, fault: InputError) -> tuple[Options, str]:
    name = fault.place.rpartition("column ")[2]
    if name == repr(options.get("time")):
        added, _ = _even(table, options, fault)
        return added, f"{fault.problem} Its steps are read as seconds"
    role = "input" if name == repr(options.get("input")) else "output"
    return {f"{role}_unit": "1"}, f"{fault.problem} Give the unit, or keep the column without one"


_REMEDIES: Mapping[str, Callable[[Table, Options, InputError], tuple[Options, str]]] = {
    "nan-input": _interpolate,
    "nan-output": _omit,
    "time-backwards": _segments,
    "time-repeated": _even,
    "nan-time": _even,
    "unknown-unit": _unknown_unit,
}


HEAD = 2**19
"""Bytes of a large file that are read from its head; eight pieces of all the rest come besides."""


def reading(table: Table, asked: Options) -> tuple[Options, list[Note]]:
    """Options of `read_table` that make numbers of a table's cells, beside those it was read with, `asked`;
    and what was seen."""
    options, notes = Options(), list[Note]()
    # The text of columns that are numbers already takes a while to make, and says no more.
    texts = [table.text[name] for name, x in table.columns.items() if x.dtype.kind != "f"]
    commas = [x for x in texts if _share(x, ",") > 0.8 and _share(x, ".") < 0.8]
    if commas and "decimal" not in asked and table.decimal == ".":
        options["decimal"] = ","
        why = f"{len(commas)} columns contain numbers with a decimal comma"
        notes.append(("decimal", ",", why))
    decimal = options.get("decimal", asked.get("decimal", table.decimal))
    odd: Counter[str] = Counter()
    for name, x in table.columns.items():
        if x.dtype.kind == "f" and (large := np.abs(x) > LARGEST).any():  # or infinite
            odd.update(table.text[name][large].tolist())
    for cells in texts:
        if _share(cells[1:], decimal) >= 0.5:
            odd.update(c for c in cells.tolist() if c and not _good(c, decimal))
    if "units_row" not in asked and _is_units(table, texts, decimal):
        options["units_row"] = int(table.line[0])
        notes.append(("units_row", str(table.line[0]), "a row of units under the header"))
        odd.subtract(Counter(cells[0] for cells in texts))
    words = [w for w, n in odd.most_common(6) if n > 0 and "," not in w]
    marked = _marks(table)
    if (words or marked) and "na_values" not in asked:
        options["na_values"] = (*words, *marked)
        kinds = {"words among the numbers": words, "numbers far from all others": marked}
        why = " and ".join(kind for kind, cells in kinds.items() if cells)
        notes.append(("na_values", ", ".join((*words, *marked)), f"{why}, read as missing values"))
    return options, notes


def _marks(table: Table) -> list[str]:
    """Numbers for missing values, as the file writes them; one that is a reading elsewhere stays."""
    numbers = {name: x for name, x in table.columns.items() if x.dtype.kind == "f"}
    found = {name: marks(x) for name, x in numbers.items()}
    cells: list[str] = []
    for value in sorted({one for each in found.values() for one in each}):
        holding = [name for name, x in numbers.items() if (x == value).any()]
        if all(value in found[name] for name in holding):
            cells.append(str(table.text[holding[0]][numbers[holding[0]] == value][0]))
    return cells


def _is_units(table: Table, texts: list[np.ndarray], decimal: str) -> bool:
    """Whether the first row has words where all others have numbers."""
    if table.units or len(table.line) < 3:
        return False
    first = [cells[0] for cells in texts if _share(cells[1:], decimal) > 0.8]
    words = [c for c in first if c and not _good(c, decimal)]
    named = 2 * sum(map(is_unit, words)) >= len(words)
    alone = len(texts) == len(table.columns) and len(words) == len(first)
    return len(words) > 1 and (named or alone)


def _share(cells: np.ndarray, decimal: str) -> float:
    """The share of numbers among the cells that are not empty, of at most a thousand."""
    some = [c for c in cells[:: max(1, len(cells) // 1000)].tolist() if c]
    return sum(_good(c, decimal) for c in some) / len(some) if some else 0.0


def _good(cell: str, decimal: str) -> bool:
    other = "," if decimal == "." else "."
    return is_number(cell) and other not in cell


# Choice of the rows to hold out, so that models are tested on unseen rows.

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
