"""A measurement as the page shows it: what was guessed, what is configured, its rows, and what to mind."""

import threading
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from hysteresis import InputError, Record, Table, check_identifiable, read_table
from hysteresis.records._data_warnings import clipped

from ..intake._constant_input import CONSTANT
from ..intake._creep_fits import check_step
from ..intake._lines import as_ranges, on_lines
from ..intake._selection import Pair, Selection
from ..intake._selection_options import HELD_OUT, OF_READING
from ..intake.guess._guess import guess
from ..operations._init import init
from . import _configuration
from ._views import EXCLUDED, GAP, USED, Series
from ._views import HELD_OUT as HELD

LARGE = 4_000_000
"""Bytes from which a file is first shown by an excerpt, while the whole of it is read."""
PART = 40
"""The excerpt of a large file is one part of so many."""
MOST_RANGES = 400
"""Stretches of lines that one option may hold."""


class Measurement:
    """One file with its configuration; reading it is done once, and again when either has changed."""

    def __init__(self, file: Path):
        self.file = file
        self.config = file.with_suffix(".toml")
        self._lock = threading.RLock()
        self._tables: dict[Any, Table] = {}
        self._reading: Any = None
        self._excerpt: tuple[Any, Series] | None = None
        self._guess: tuple[Any, dict[str, Any]] | None = None
        self._series: tuple[Any, Series] | None = None
        self._faults: dict[Any, Exception] = {}

    def configured(self) -> None:
        """Write the configuration that `hysid init` writes, where there is none.

        Raises `InputError` as `init` does.
        """
        with self._lock:
            if not self.config.exists():
                found = init(self.file, None, {})
                self._guess = (self._guess_key(), _of_guess(found))

    def look(self) -> dict[str, Any]:
        """Columns, roles, findings, warnings and held-out rows, as plain data.

        What cannot be read or used is told as `fault`, beside what could be found out.
        """
        found: dict[str, Any] = {"name": self.file.name, "fault": None} | _of_guess({})
        try:
            self.configured()
            found |= self._guessed()
        except InputError as error:
            found["fault"] = as_document(error)
        found["configured"] = self.config.exists()
        try:
            tables = _configuration.read(self.config)
            found |= {"selection": tables["selection"], "fit": tables["fit"]}
            found["parameters"] = bool(tables["parameters"])
            selection = _configuration.selection(self.config)
            selection.check_columns()
            found["held_out"] = [
                name for name in HELD_OUT if getattr(selection, name) not in (None, ())
            ]
        except InputError as error:
            found["fault"] = found["fault"] or as_document(error)
        return found

    def judged(self) -> dict[str, Any]:
        """Warnings about the rows of the measurement, each with the lines that it means; reads the file."""
        try:
            selection = _configuration.selection(self.config)
            records, faults = selection.records(self.table(selection))
        except InputError as error:
            return {"warnings": [], "fault": as_document(error), "records": []}
        warnings, told = [], []
        for value, (train, test) in records.items():
            head = f"{selection.each} = {value}: " if value else ""
            try:
                if selection.is_step:
                    text = check_step(train)["text"]
                else:
                    text = train.describe()
                    for note in check_identifiable(train):
                        spans = _spans_of(train) if note.code == "saturation" else []
                        warnings.append({"code": note.code, "text": head + note, "lines": spans})
                warnings += [
                    {"code": note.code, "text": head + note, "lines": []}
                    for note in train.history
                    if note.code in ("masked", "filled", "units-row", "cut")
                ]
                told.append(
                    {
                        "name": value, "text": text, "rows": len(train), "cycles": train.n_cycles,
                        "used": int(train.mask.sum()),
                        "held_out": 0 if test is None else int(test.mask.sum()),
                    }
                )  # fmt: skip
            except InputError as error:
                faults[value] = error
        for value, error in faults.items():
            said = f"{value}: {error.problem}" if value else error.problem
            warnings.append({"code": error.code, "text": f"{said} {error.fix}", "lines": []})
        return {"warnings": warnings, "fault": None, "records": told}

    def table(self, selection: Selection) -> Table:
        """The whole file."""
        key = self._key(selection)
        with self._lock:
            if key not in self._tables:
                self._tables = {key: selection.read(self.file)}
            return self._tables[key]

    def series(self) -> tuple[Series, bool, dict[str, str]]:
        """What the plots show, whether that is the whole file, and the names of the axes.

        Of a large file that is not read yet an excerpt, while a thread reads the rest.
        Raises `InputError`.
        """
        selection = _configuration.selection(self.config)
        selection.check_columns()
        key = self._key(selection)
        names, stamp = _names(selection), (key, selection)
        if key in self._faults:
            raise self._faults[key]
        if key not in self._tables and self.file.stat().st_size > LARGE:
            if self._excerpt is None or self._excerpt[0] != stamp:
                asked = {name: getattr(selection, name) for name in OF_READING}
                excerpt = read_table(self.file, **asked, most=self.file.stat().st_size // PART)
                if excerpt.share < 1:
                    self._excerpt = (stamp, _series(excerpt, selection, None))
            self._read_later(key, selection)
            if self._excerpt is not None and self._excerpt[0] == stamp:
                return self._excerpt[1], False, names
        with self._lock:
            if self._series is None or self._series[0] != stamp:
                table = self.table(selection)
                self._series = (stamp, _series(table, selection, selection.records(table)[0]))
            return self._series[1], True, names

    def brush(
        self, action: str, low: float | None, high: float | None, box: list[float] | None
    ) -> dict[str, Any]:
        """Exclude, hold out or include the rows in a stretch of time, and in a box of the loops.

        Returns the keys of [selection] that change. Raises `InputError` `bad-option`, `no-rows`.
        """
        selection = _configuration.selection(self.config)
        table = self.table(selection)
        series = self.series()[0]
        rows = series.chosen(low, high, box)
        if not rows.any():
            raise InputError(
                "no-rows", "No row is in the chosen part.", fix="Choose a larger part."
            )
        line = table.line
        left_out, held = (
            on_lines(line, x) for x in (selection.exclude_lines, selection.test_lines)
        )
        if action == "exclude":
            left_out |= rows
            held &= ~rows
        elif action == "hold-out":
            held |= rows
            left_out &= ~rows
        elif action == "include":
            left_out, held = left_out & ~rows, held & ~rows
        else:
            raise InputError("bad-option", f"There is no action {action!r}.")
        ranges = {"exclude_lines": as_ranges(line, left_out), "test_lines": as_ranges(line, held)}
        if max(map(len, ranges.values())) > MOST_RANGES:
            raise InputError(
                "bad-option",
                f"These rows are in more than {MOST_RANGES} stretches of the file.",
                fix="Choose a stretch of time, or a smaller part of the loops.",
            )
        changes: dict[str, Any] = {name: value or None for name, value in ranges.items()}
        if ranges["test_lines"]:
            changes |= {name: None for name in HELD_OUT if name != "test_lines"}
        return changes

    def _guessed(self) -> dict[str, Any]:
        """The guess from the file alone: what each column is, and why."""
        with self._lock:
            key = self._guess_key()
            if self._guess is None or self._guess[0] != key:
                found = guess(self.file, dict(key[1]))
                document = asdict(found) | {"found": [asdict(one) for one in found.found]}
                self._guess = (key, _of_guess(document))
            return self._guess[1]

    def _guess_key(self) -> Any:
        selection = _configuration.read(self.config)["selection"]
        reading = ((name, selection[name]) for name in OF_READING if name in selection)
        return _stamp(self.file), tuple(reading)

    def _key(self, selection: Selection) -> Any:
        return (_stamp(self.file), *(getattr(selection, name) for name in OF_READING))

    def _read_later(self, key: Any, selection: Selection) -> None:
        with self._lock:
            if self._reading == key:
                return
            self._reading = key

        def read() -> None:
            try:
                table = self.table(selection)
                made = _series(table, selection, selection.records(table)[0])
                self._series = ((key, selection), made)
            except InputError as error:
                self._faults[key] = error

        threading.Thread(target=read, daemon=True).start()


def _of_guess(found: Mapping[str, Any]) -> dict[str, Any]:
    """What the page takes of a guess, or of what `init` says."""
    return {
        "rows": found.get("rows", 0),
        "columns": found.get("columns", []),
        "findings": found.get("found", []),
        "alternatives": found.get("alternatives", []),
        "no_roles": found.get("no_roles", ""),
    }


def as_document(error: InputError) -> dict[str, str]:
    """An error as the command line's `--json` has it."""
    return {
        "code": error.code, "message": error.problem, "where": error.place, "cause": error.cause,
        "fix": error.fix,
    }  # fmt: skip


def _stamp(file: Path) -> tuple[int, int]:
    about = file.stat()
    return about.st_mtime_ns, about.st_size


def _names(selection: Selection) -> dict[str, str]:
    driving = selection.input or CONSTANT
    first = driving[0] if isinstance(driving, tuple) else driving
    return {"x": selection.time or "row", "u": first, "y": selection.output}


def _series(table: Table, selection: Selection, records: dict[str, Pair] | None) -> Series:
    """The columns of a table with the state of each row; without records, every row counts."""
    names, missing = _names(selection), np.full(len(table.line), np.nan)

    def numbers(name: str) -> np.ndarray:
        column = table.columns.get(name, missing)
        return np.asarray(column, float) if column.dtype.kind == "f" else missing

    clock = numbers(names["x"])
    if not np.all(np.diff(clock) >= 0):  # also where it holds what is not a number
        clock = np.asarray(table.line, float)
    state = np.full(len(table.line), USED)
    if records is not None:
        state[:] = EXCLUDED
        for train, test in records.values():
            for record, word in ((train, USED), (test, HELD)):
                if record is not None:
                    lines = record.line[record.mask]
                    state[np.searchsorted(table.line, lines[lines > 0])] = word
            begin = train.line[train.starts]
            state[np.searchsorted(table.line, begin[begin > 0])] += GAP
    return Series(clock, numbers(names["u"]), numbers(names["y"]), table.line, state)


def _spans_of(record: Record) -> list[str]:
    """The lines at which a reading is clipped."""
    stuck = np.zeros(len(record), bool)
    for found in clipped(record):
        stuck[found.rows] = True
    return as_ranges(record.line, stuck)[:MOST_RANGES]
