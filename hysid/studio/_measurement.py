"""A measurement as the page shows it: what was guessed, what is configured, its rows, and what to mind."""

import contextlib
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from hysteresis import InputError, Record, read_table
from hysteresis.records._excitation import check_identifiable, clipped
from hysteresis.records._table import Table, rows_read

from ..figures._format import plain_name, pretty
from ..intake._constant_input import CONSTANT
from ..intake._creep_fits import check_step
from ..intake._init import init
from ..intake._options import FIELDS, HELD_OUT, OF_READING
from ..intake._own_config import config_of
from ..intake._selection import Pair, Selection, as_ranges, on_lines
from ..intake.guess._column_pairs import columns_of
from ..intake.guess._guess import Guess, guess, table_of
from . import _equivalents
from ._views import EXCLUDED, GAP, USED, Series
from ._views import HELD_OUT as HELD

LARGE = 4_000_000
"""Bytes from which a file is first shown by an excerpt, while the whole of it is read."""
PART = 40
"""The excerpt of a large file is one part of so many."""
REPAIRS = ("masked", "filled", "units-row", "cut")
"""Codes of what reading a file has mended."""
MOST_RANGES = 400
"""Stretches of lines that one option may hold."""


class Measurement:
    """One file with its configuration; reading it is done once, and again when either has changed."""

    def __init__(self, file: Path):
        self.file = file
        self._lock = threading.RLock()
        self._guess: tuple[Any, dict[str, Any]] | None = None
        self._read: tuple[Any, Future[Table]] | None = None
        self._series: tuple[Any, Series] | None = None

    @property
    def config(self) -> Path:
        """Its configuration, which another file of the same stem may have taken since."""
        return config_of(self.file)

    def configured(self) -> None:
        """Write the configuration that `hysid init` writes, where there is none.

        Raises `InputError` as `init` does.
        """
        with self._lock:
            if not self.config.exists():
                self._write_guess({})

    def change(self, changes: Mapping[str, Mapping[str, Any]]) -> None:
        """Change the configuration; one that lacked columns is completed, as `hysid init` would with them.

        Raises `InputError` `bad-config`, `unknown-key`.
        """
        with self._lock:
            tables = _equivalents.read(self.config)
            begun = bool(tables["fit"]) or _has_roles(tables["selection"])
            if not self.config.exists():
                known = self._guessed()["selection"]
                changes = {**changes, "selection": known | dict(changes.get("selection", {}))}
            _equivalents.change(self.config, changes)
            with contextlib.suppress(InputError):  # `look` tells it
                given = _equivalents.read(self.config)["selection"]
                if not begun and (_has_roles(given) or not {"input", "output"} & given.keys()):
                    self._write_guess(given)

    def look(self) -> dict[str, Any]:
        """Columns, roles, findings, warnings and held-out rows, as plain data.

        What cannot be read or used is told as `fault`, beside what could be found out. Where no input and
        output was guessed, `asks` is true and `selection` is what is known.
        """
        found: dict[str, Any] = {"name": self.file.name, "fault": None, "asks": False, "fit": {}}
        found |= _of_guess({})
        with contextlib.suppress(InputError):
            self.configured()
        try:
            tables = _equivalents.read(self.config)
            found |= self._guessed()
            found |= {"selection": tables["selection"] or found["selection"], "fit": tables["fit"]}
            found["asks"] = not _has_roles(found["selection"])
            if not found["asks"]:
                found["fault"] = None
                _equivalents.selection(self.config).check_columns()
        except InputError as error:
            found["fault"] = error.document
        return found

    def judged(self) -> dict[str, Any]:
        """Warnings about the rows of the measurement, each with the lines that it means; reads the file."""
        try:
            selection = _equivalents.selection(self.config)
            records, faults = selection.records(self.table(selection).result())
        except InputError as error:
            return {"warnings": [], "fault": error.document, "records": []}
        warnings, told = [], []
        for value, (train, test) in records.items():
            head = f"{selection.each} = {value}: " if value else ""
            try:
                notes = [] if selection.is_step else check_identifiable(train)
                text = check_step(train)["text"] if selection.is_step else train.describe()
            except InputError as error:
                faults[value] = error
                continue
            for note in (*notes, *(one for one in train.history if one.code in REPAIRS)):
                spans = _spans_of(train) if note.code == "saturation" else []
                warnings.append({"code": note.code, "text": head + note, "lines": spans})
            told.append({
                "name": value, "text": text, "rows": len(train), "cycles": train.n_cycles,
                "used": int(train.mask.sum()), "held_out": 0 if test is None else int(test.mask.sum()),
            })  # fmt: skip
        for value, error in faults.items():
            said = f"{value}: {error.problem}" if value else error.problem
            warnings.append({"code": error.code, "text": f"{said} {error.fix}", "lines": []})
        return {"warnings": warnings, "fault": None, "records": told}

    def table(self, selection: Selection) -> Future[Table]:
        """The whole file, which a thread reads once."""
        key = (_stamp(self.file), *(getattr(selection, name) for name in OF_READING))
        with self._lock:
            if self._read is None or self._read[0] != key:
                self._read = key, _in_thread(lambda: selection.read(self.file))
            return self._read[1]

    def series(self) -> tuple[Series, bool, dict[str, str]]:
        """What the plots show, whether that is the whole file, and the names of the axes.

        Of a large file an excerpt, as long as the rest is being read. Raises `InputError`.
        """
        selection = _equivalents.selection(self.config)
        selection.check_columns()
        whole, size = self.table(selection), self.file.stat().st_size
        is_part = size > LARGE and not whole.done()
        stamp, shown = (whole, selection, is_part), self._series
        if shown is None or shown[0] != stamp:
            records = None
            if is_part:
                asked = {name: getattr(selection, name) for name in OF_READING}
                table = read_table(self.file, **asked, most=size // PART)
            else:
                table = whole.result()
                records = selection.records(table)[0]
            shown = self._series = stamp, _series(table, selection, records)
        return shown[1], not is_part, self._axes(selection)

    def _axes(self, selection: Selection) -> dict[str, str]:
        """Names of clock, input and output with their units, first those that were typed by hand."""
        units = {one["name"]: one["unit"] for one in self._guessed()["columns"]}
        typed = {"u": selection.input_unit, "y": selection.output_unit}
        found = _names(selection)
        for axis, unit in typed.items():
            if unit:
                plain = plain_name(found[axis], units.get(found[axis], ""))
                found[axis] = f"{plain} ({pretty(unit) or 'no unit'})"
        return found

    def brush(
        self, action: str, low: float | None, high: float | None, box: list[float] | None
    ) -> dict[str, Any]:
        """Exclude, hold out or include the rows in a stretch of time, and in a box of the loops.

        Returns the keys of [selection] that change. Raises `InputError` `bad-option`, `no-rows`.
        """
        selection = _equivalents.selection(self.config)
        table = self.table(selection).result()
        series = self.series()[0]
        rows = series.chosen(low, high, box)
        if not rows.any():
            said = "No row is in the chosen part."
            raise InputError("no-rows", said, fix="Choose a larger part.")
        line = table.line
        left_out = on_lines(line, selection.exclude_lines) & ~rows
        held = on_lines(line, selection.test_lines) & ~rows
        if action == "exclude":
            left_out |= rows
        elif action == "hold-out":
            held |= rows
        elif action != "include":
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

    def _write_guess(self, given: Mapping[str, Any]) -> None:
        asked = {name: _as_given(name, value) for name, value in given.items()}
        found = init(self.file, None, asked, overwrite=True)
        self._guess = (self._guess_key(), _of_guess(found))

    def _guessed(self) -> dict[str, Any]:
        """The guess from the file: what each column is, and why; without one the columns, and a `fault`."""
        with self._lock:
            key = self._guess_key()
            if self._guess is None or self._guess[0] != key:
                given = {name: _as_given(name, value) for name, value in key[1]}
                try:
                    found = _of_guess(asdict(guess(self.file, given)))
                except InputError as error:
                    found = _of_guess(self._columns(given)) | {"fault": error.document}
                self._guess = (key, found)
            return self._guess[1]

    def _columns(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Of a file that is not understood: how it is read, and its columns, those that change first.

        Raises `InputError` where it cannot be read.
        """
        found = Guess()
        table = table_of(self.file, found, given)
        moves = {n for n, c in columns_of(table).items() if np.nanmax(c.x) > np.nanmin(c.x)}
        found.columns.sort(key=lambda one: one["name"] not in moves)
        return asdict(found)

    def _guess_key(self) -> Any:
        selection = _equivalents.read(self.config)["selection"]
        names = OF_READING if _has_roles(selection) else FIELDS
        given = ((name, selection[name]) for name in names if name in selection)
        return _stamp(self.file), tuple(
            (k, tuple(v) if isinstance(v, list) else v) for k, v in given
        )


def _in_thread(function: Callable[[], Table]) -> Future[Table]:
    """What a function returns or raises in a thread, which ends with the process."""
    found: Future[Table] = Future()

    def run() -> None:
        try:
            found.set_result(function())
        except Exception as error:
            found.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return found


def _of_guess(found: Mapping[str, Any]) -> dict[str, Any]:
    """What the page takes of a guess, or of what `init` says."""
    usual = {"rows": 0, "columns": [], "found": [], "selection": {}, "no_roles": ""}
    told = usual | {name: found[name] for name in usual.keys() & found.keys()}
    return {"findings" if name == "found" else name: value for name, value in told.items()}


def _has_roles(selection: Mapping[str, Any]) -> bool:
    """Whether both sides are chosen."""
    return bool(selection.get("output")) and bool({"input", "step"} & selection.keys())


def _as_given(name: str, value: Any) -> Any:
    """An option as `init` takes it: columns that may be several as a tuple."""
    several = {"repeated", "joined"} & FIELDS[name].metadata.keys()
    return value if not several or isinstance(value, tuple | list) else (value,)


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
                    state[rows_read(table, record)[record.mask & (record.line > 0)]] = word
            begin = train.starts[train.line[train.starts] > 0]
            state[rows_read(table, train)[begin]] += GAP
    return Series(clock, numbers(names["u"]), numbers(names["y"]), table.line, state)


def _spans_of(record: Record) -> list[str]:
    """The lines at which a reading is clipped."""
    stuck = np.zeros(len(record), bool)
    for found in clipped(record):
        stuck[found.rows] = True
    return as_ranges(record.line, stuck)[:MOST_RANGES]
