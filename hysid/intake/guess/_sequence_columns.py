"""Columns that tell runs apart: sequences, specimens, an existing split; and those of a spectrum: moduli
over frequency, or over time in runs at several temperatures."""

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hysteresis import Record
from hysteresis._quantities import conversion
from hysteresis.records._branch_rows import STILL
from hysteresis.records._branch_rows import constant_within as channel_within
from hysteresis.records._table import Table, rows_read
from hysteresis.records._units import OSCILLATION, UNITS, words, words_of

from .._constant_input import RATIO, turns_back
from ._column_pairs import Column

if TYPE_CHECKING:
    from ._guess import Guess

RUNS = words(
    "trial trials run runs test tests curve sweep rep repeat repetition replicate versuch lauf messung "
    "essai experiment id file sheet segment group series loop record sequence press block event"
)
SPECIMENS = words(
    "sample specimen probe material location sensor electrode device pruefling proben echantillon site"
)
SPLITS = {"train", "training", "test", "testing", "val", "validation", "holdout", "held-out", "fit"}


class Sequences(NamedTuple):
    """Columns of groups, of specimens and of a split, their sentences, and what is no measurement.

    - `group`: columns whose values name independent sequences of one model.
    - `each`: the column with a model for each value, or None.
    - `split`: `(column, value)` of rows to hold out that the file itself names, or None.
    - `labels`: columns that only name or count something.
    """

    group: tuple[str, ...]
    each: str | None
    split: tuple[str, str] | None
    labels: frozenset[str]
    said: tuple[tuple[str, str, str], ...]

    @property
    def keys(self) -> tuple[str, ...]:
        """The columns of groups and of specimens."""
        return self.group + ((self.each,) if self.each else ())


def sequences_of(table: Table, time: str | None) -> Sequences:
    """Columns that separate the sequences of a file.

    A column counts when it holds words, or whole numbers under a name for runs or specimens or at each of
    whose changes the clock begins again, and each of its values several rows. A column is no group if time
    continues across its changes.
    """
    rows = len(table.line)
    labels, said = set(), []
    groups: list[str] = []
    specimens: list[str] = []
    split = None
    for name, x in table.columns.items():
        values, code = np.unique(table.text[name], return_inverse=True)
        named, text = set(words_of(name)), x.dtype.kind != "f"
        if text:
            labels.add(name)
        if len(values) < 2 or 4 * len(values) > rows:
            continue
        lowered = {v.lower() for v in values.tolist()}
        tests = [v for v in values.tolist() if v.lower() in ("test", "testing", "holdout")]
        if text and tests and len(lowered) <= 3 and lowered <= SPLITS:
            split = (name, tests[0])
            continue
        kinds = named & (RUNS | SPECIMENS)
        whole = not text and np.all(np.isfinite(x)) and np.all(x == np.round(x))
        runs = 1 + int(np.count_nonzero(np.diff(code)))
        blocks = whole and runs == len(values) and _restarts(table, name, time)
        if not (text or (whole and kinds) or blocks) or named & {"z"}:
            continue
        if runs > max(4 * len(values), 20) and not named & SPECIMENS:
            continue
        if text and not kinds and (runs > 2 * len(values) or len(values) > 50):
            continue
        labels.add(name)
        if named & SPECIMENS and not named & RUNS and len(values) <= 40:
            specimens.append(name)
        elif named & RUNS or text or blocks:
            groups.append(name)
    each = min(specimens, key=lambda n: len(np.unique(table.text[n])), default=None)
    if each is not None:
        said.append(("each", each, "one fit for each specimen"))
    groups = [g for g in groups if _cuts(table, g, time)]
    if len(groups) > 1:  # the finest; others come in where its values are not in one piece
        groups.sort(key=lambda g: -len(np.unique(table.text[g])))
    chosen = tuple(groups[:1])
    if chosen:
        others = (*groups[1:], *(split or ())[:1])
        more = [n for n in others if _mends(table, chosen[0], n)]
        chosen += tuple(more[:1])
        count = len(set(zip(*(table.text[n].tolist() for n in chosen), strict=True)))
        said.append(("group", ", ".join(chosen), f"{count} independent sequences of one model"))
    if split:
        said.append(("test_where", f"{split[0]}={split[1]}", "the file marks the rows for testing"))
    return Sequences(chosen, each, split, frozenset(labels), tuple(said))


def constant_within(table: Table, name: str, keys: tuple[str, ...], within: float = 1e-3) -> bool:
    """Whether a column has one value in each sequence, to a part of its range: a label, no measurement."""
    if not keys:
        return False
    cells = zip(*(table.text[k].tolist() for k in keys), strict=True)
    _, code = np.unique(["/".join(row) for row in cells], return_inverse=True)
    x = table.columns[name]
    low, high = np.full(code.max() + 1, np.inf), np.full(code.max() + 1, -np.inf)
    np.fmin.at(low, code, x)
    np.fmax.at(high, code, x)
    span = max(float(np.nanmax(x) - np.nanmin(x)), 1e-300)
    return bool(code.max() > 0 and np.mean(high - low <= within * span) > 0.9)


CONDITIONS = ("temperature", "current", "voltage", "stress", "field")
"""Kinds of what a rig holds in a run: a chamber, a coil, a pressure."""


def condition_of(columns: Mapping[str, Column], record: Record, table: Table) -> str | None:
    """The one column of a table that a rig held in each sequence of its record, at three values or more."""
    rows = rows_read(table, record)
    # A weight that hangs on an actuator; beside a force that is read it would be the size of the test.
    weight = ("force",) if sum(c.kind.name == "force" for c in columns.values()) == 1 else ()
    kinds = (*CONDITIONS, *weight)
    held = {name: c.x[rows] for name, c in columns.items() if c.kind.name in kinds}
    name = channel_within(held, record.starts)
    if name is None:
        return None
    values = np.sort(held[name][record.starts])
    several = np.count_nonzero(np.diff(values) > STILL * np.ptp(values)) > 1
    warm = columns[name].kind.name != "temperature" or np.ptp(values) > RANGE
    return name if several and warm else None


def counts_rows(x: np.ndarray) -> bool:
    """Whether a column only numbers the rows, from the start or within each sequence."""
    step = np.diff(x)
    return len(x) > 2 and bool(np.all(np.isfinite(x))) and float(np.mean(step == 1)) > 0.75


def _steps(table: Table, name: str, time: str) -> tuple[np.ndarray, float]:
    """The steps of time where a column changes, and the usual size of all."""
    step = np.diff(table.columns[time])
    known = np.abs(step[np.isfinite(step)])
    change = table.text[name][1:] != table.text[name][:-1]
    return step[change], float(np.median(known)) if known.size else 0.0


def _restarts(table: Table, name: str, time: str | None) -> bool:
    """Whether time goes back wherever this column changes."""
    return time is not None and bool((_steps(table, name, time)[0] < 0).all())


def _cuts(table: Table, name: str, time: str | None) -> bool:
    """Whether time stops or starts anew where this column changes."""
    if time is None:
        return True
    steps, typical = _steps(table, name, time)
    return bool(np.any((steps < 0) | (steps > 20 * typical)))


def _mends(table: Table, name: str, other: str) -> bool:
    """Whether values of a column lie in several pieces that another one tells apart."""
    pieces = lambda key: 1 + int(np.count_nonzero(key[1:] != key[:-1]))  # noqa: E731
    one, two = table.text[name], table.text[other]
    both = np.char.add(np.char.add(one, "/"), two)
    return pieces(one) > len(np.unique(one)) and len(np.unique(both)) > len(np.unique(one))


LOSS = re.compile(r"loss|perte|verlust|viscous|^[EG](''|\"|″|2\b)", re.IGNORECASE)
WHOLE = re.compile(r"complex|\*|^\|", re.IGNORECASE)
SPAN = 3.0
"""The factor that a sweep's frequencies cover, at least: less does not tell a spectrum."""
STANDS = 0.5
"""Share of the rows with the frequency of the row before, up to which a sweep is one of frequencies."""
RANGE = 2.0
"""Kelvins by which a temperature has to differ to be a condition; within a run it differs by less."""
ROWS = 3
"""Of a run over time, at least."""
RESPONSES = ("modulus", "compliance")
"""Kinds of what a unit step gives, over time."""


def moduli_of(columns: Mapping[str, Column], given: Mapping[str, Any], out: "Guess") -> bool:
    """Notes the columns of a frequency sweep in `out`; whether the table holds one."""
    moduli = [c for c in columns.values() if c.kind.name == OSCILLATION]
    ratios = [c for c in moduli if RATIO.search(c.name)]
    parts = [c for c in moduli if c not in ratios and not WHOLE.search(c.name)]
    losses = [c for c in parts if LOSS.search(c.name)]
    storage = next((c for c in parts if c not in losses), None)
    if storage is None:
        return False
    # E'' belongs to E', and not to G'.
    alike = [c for c in losses if c.unit == storage.unit or conversion(c.unit, storage.unit)]
    loss = next(iter(sorted(alike, key=lambda c: c.name[:1] != storage.name[:1]) + ratios), None)
    there = np.isfinite(storage.x)
    sweeps = [c for c in columns.values() if _is_sweep(c, there)]
    if not sweeps:
        return False
    frequency = max(sweeps, key=lambda c: int((np.isfinite(c.x) & there).sum()))
    chosen = {"frequency": frequency, "output": storage} | ({} if loss is None else {"loss": loss})
    hot = next((c for c in columns.values() if _varies(c, there)), None)
    _noted(chosen, hot, given, out)
    return True


def runs_of(columns: Mapping[str, Column], given: Mapping[str, Any], out: "Guess") -> bool:
    """Notes the columns of creep or relaxation at several temperatures in `out`; whether there are such.

    Of each temperature there is a run: its times begin anew, upwards or downwards. Where a column names the
    runs and times rise, each is fitted alone.
    """
    for response in (c for c in columns.values() if c.kind.name in RESPONSES):
        there = np.isfinite(response.x)
        hot = next((c for c in columns.values() if _varies(c, there)), None)
        for clock in (c for c in columns.values() if c.kind.name == "time"):
            rows = there & np.isfinite(clock.x)
            t = clock.x[rows]
            if hot is None or len(t) < 2 * ROWS or t.max() < SPAN * max(t.min(), 0.0):
                continue
            cuts = 1 + np.flatnonzero(turns_back(t))
            runs = np.split(hot.x[rows], cuts)
            steady = [len(run) >= ROWS and np.ptp(run) <= RANGE for run in runs]
            if len(runs) > 1 and all(steady):
                rising = all((np.diff(run) > 0).all() for run in np.split(t, cuts))
                others = (c for c in columns.values() if c not in (response, hot, clock) and rising)
                named = next((c for c in others if _names(np.split(c.x[rows], cuts))), None)
                _noted({"time": clock, "output": response}, None if named else hot, given, out)
                if named is not None:
                    why = f"it names the runs; --condition '{hot.name}' shifts them to one curve instead"
                    out.selection["each"] = named.name
                    out.says("each", named.name, "likely", why)
                out.selection["step"] = given.get("step") or 1.0
                out.says("step", out.selection["step"], "likely", WHY["step"])
                return True
    return False


def _names(runs: list[np.ndarray]) -> bool:
    """Whether a column has one value in each run, and another one in every other."""
    return all(np.ptp(run) == 0 for run in runs) and len({run[0] for run in runs}) == len(runs)


def _noted(
    chosen: Mapping[str, Column], hot: Column | None, given: Mapping[str, Any], out: "Guess"
) -> None:
    """What the columns are, in `out`, in place of a clock and of groups."""
    for key in ("time", "group"):
        out.selection.pop(key, None)
    out.found = [one for one in out.found if one.what not in ("time", "group")]
    for key, column in chosen.items():
        out.selection[key] = given.get(key) or column.name
        unit = "no unit" if column.unit == "1" else column.unit
        why = WHY["step" if key == "output" and "time" in chosen else key]
        out.says(key, out.selection[key], "likely", f"{column.kind.name}, {unit}; {why}")
    if hot is not None:
        out.selection["condition"] = [hot.name]
        why = "it differs between the runs: their times are shifted"
        out.says("condition", hot.name, "likely", why)


WHY = {
    "frequency": "each row is the result of an oscillation at it",
    "output": "storage modulus",
    "time": "it begins anew in each run",
    "step": "the rows answer a unit step",
    "loss": "loss modulus, or its ratio to the storage modulus",
}


def _is_sweep(column: Column, there: np.ndarray) -> bool:
    named = {"frequency", "freq", "omega"} & {*words_of(column.name)}
    x = column.x[there & np.isfinite(column.x)]
    if not (named or column.unit in UNITS["frequency"]) or len(x) < 4 or x.min() <= 0:
        return False
    return bool(x.max() >= SPAN * x.min() and np.mean(np.diff(x) == 0) <= STANDS)


def _varies(column: Column, there: np.ndarray) -> bool:
    x = column.x[there & np.isfinite(column.x)]
    return column.kind.name == "temperature" and len(x) > 1 and float(np.ptp(x)) > RANGE
