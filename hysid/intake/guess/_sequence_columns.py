"""Columns that separate the sequences of a file: runs, specimens, an existing split."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hysteresis import Record
from hysteresis.records._branch_rows import STILL
from hysteresis.records._branch_rows import constant_within as channel_within
from hysteresis.records._column_quantity import words, words_of
from hysteresis.records._table import Table

from ._column_pairs import Column
from ._moduli_columns import RANGE

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


def condition_of(columns: Mapping[str, Column], record: Record, line: np.ndarray) -> str | None:
    """The one column that a rig held in each sequence of the record, at three values or more.

    `columns`: of a table whose rows are on these lines of the file, `line` (n,).
    """
    rows = np.searchsorted(line, record.line)
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
