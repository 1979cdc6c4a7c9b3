"""Which rows and columns of a file a command works on: options in, records out."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from inspect import signature
from pathlib import Path
from typing import Any, get_args, get_origin

import numpy as np

from hysteresis import InputError, Record, read_csv, read_table
from hysteresis._quantities import conversion
from hysteresis.records._csv import fulfilling, parse_condition, with_known
from hysteresis.records._table import Table, rows_of
from hysteresis.records._units import named_unit

from ._constant_input import CONSTANT, RUN, at_hold, with_constant, with_moduli, with_runs
from ._options import FIELDS, HELD_OUT, OF_READING, SelectionOptions

Pair = tuple[Record, Record | None]
"""What is fitted, and what is held out of it."""

OF_RECORD = tuple(name for name in FIELDS if name in signature(read_csv).parameters)
"""Selecting options that are options of `read_csv`."""


@dataclass(frozen=True)
class Selection(SelectionOptions):
    """The selecting options with what they do: from a file to records.

    `where` and `test_where` hold conditions as typed: `COL=VALUE[,VALUE]` or `COL%2=0`. With a `step`,
    the constant input of creep or relaxation, there is no `input` column; with `hold` it is the level
    that column is held at. Several are channels.
    """

    def __post_init__(self) -> None:
        if sum(given is not None for given in (self.input, self.step, self.frequency)) != 1:
            raise InputError(
                "conflicting-options",
                "Give one of the input column (--input COL), the constant value of the input (--step VALUE)"
                " and the frequency column of moduli (--frequency COL).",
            )
        if self.loss is not None and self.frequency is None:
            raise InputError(
                "conflicting-options",
                "--loss COL needs the frequency of its rows.",
                fix="Give --frequency COL as well.",
            )
        if self.step is not None and not (np.isfinite(self.step) and self.step):
            raise InputError(
                "not-a-step",
                f"A constant input of {self.step:g} has no effect.",
                fix="Give the constant force or displacement (--step VALUE).",
            )
        if self.hold and not isinstance(self.input, str):
            raise InputError(
                "no-hold",
                "--hold needs exactly one input column.",
                fix="Name it (--input COL), or leave out --hold.",
            )
        held_out = (self.test_where, self.test_cycles, self.test_tail, self.test_lines)
        if sum(h not in (None, ()) for h in held_out) > 1:
            raise InputError(
                "conflicting-options",
                "Give only one of --test-where, --test-cycles, --test-tail and --test-lines.",
            )
        if self.range and not (len(self.range) == 2 and self.range[0] <= self.range[1]):
            raise InputError(
                "zero-range",
                f"No input is within the range {', '.join(f'{end:g}' for end in self.range)}.",
                fix="Give --range LOW,HIGH, such as --range 2,20.",
            )
        if self.time is not None and self.dt is not None:
            raise InputError("conflicting-options", "Give --time COL or --dt SECONDS, not both.")
        if self.input_time is not None and (self.time is None or self.is_step):
            raise InputError(
                "no-time",
                "--input-time COL needs the clock of the output too.",
                fix="Give --time COL as well.",
            )

    @classmethod
    def from_json(cls, document: Any) -> "Selection":
        """A selection that `as_json` wrote. Raises `InputError` `damaged-file` where it did not."""
        given: dict[str, Any] = document if isinstance(document, dict) else {}
        pairs = given.items()
        options: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in pairs}
        odd = [k for k, v in options.items() if not fits_option(k, v)]
        odd += [k for k in ("input", "output") if k not in options]
        if odd:
            raise InputError(
                "damaged-file",
                f"which columns were chosen cannot be read: {odd[0]!r:.40}.",
                cause="The file was edited.",
                fix="Fit again.",
            )
        return cls(**options)

    def as_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)

    @property
    def is_step(self) -> bool:
        """A spectrum of time constants is fitted: to creep, relaxation or moduli."""
        return self.step is not None or self.frequency is not None or self.hold

    @property
    def input_words(self) -> str:
        """What the input is called."""
        if isinstance(self.input, tuple):
            return f"{len(self.input)} channels combined"
        return self.input or self.frequency or CONSTANT

    def without_hold_out(self) -> "Selection":
        """The same rows with none held out."""
        return replace(self, **{name: FIELDS[name].default for name in HELD_OUT})

    def check_columns(self, *others: str | None) -> None:
        """Raise `InputError` where one column is to be both the input and the output, or another output."""
        inputs = (self.input, self.frequency, self.loss)
        inputs = self.input if isinstance(self.input, tuple) else inputs
        roles = {"time": [self.time], "input": inputs, "condition": self.condition}
        said = [
            (n, "condition", "input or time") for n in self.condition if n in (*inputs, self.time)
        ]
        outputs = {self.output, *others} - {None}
        said += [(n, r, "output") for r, names in roles.items() for n in names if n in outputs]
        for name, role, other in said[:1]:
            fix = f"Name another column (--{role} COL{', or --output COL' * (other == 'output')})."
            raise InputError("given-twice", f"{name!r} is given as {role} and as {other}.", fix=fix)

    def read(self, file: Path) -> Table:
        """The whole file."""
        return read_table(file, **{name: getattr(self, name) for name in OF_READING})

    def records(self, table: Table) -> tuple[dict[str, Pair], dict[str, InputError]]:
        """Training and test record for every value of `each`, "" without it; the faults of others.

        The last ones are kept with the table: `init` asks for them several times. Raises `InputError` where
        no value can be read.
        """
        if vars(table).get("_of") != self:
            vars(table).update(_records=self._records(table), _of=self)
        return vars(table)["_records"]

    def _records(self, table: Table) -> tuple[dict[str, Pair], dict[str, InputError]]:
        fulfilling(table, self.test_where)  # a column that is not there is said now
        for lines in (self.test_lines, self.exclude_lines):
            check_lines(lines, table)
        where = dict(map(parse_condition, self.where))
        if self.each is None:
            return {"": self._counted(self._read(table, where))}, {}
        rows = fulfilling(table, self.where)
        if self.each not in table.columns:
            fulfilling(table, [f"{self.each}=?"])  # says what columns there are
        cells = table.text[self.each][rows]
        if (empty := np.flatnonzero(cells == "")).size:
            raise InputError(
                "no-value",
                f"{empty.size} rows have no {self.each}.",
                place=f"{table.path}, line {table.line[rows][empty[0]]}",
                fix="Fill them in, or select other rows (--where).",
            )
        good: dict[str, Pair] = {}
        faults: dict[str, InputError] = {}
        for value in dict.fromkeys(cells.tolist()):
            try:
                good[value] = self._counted(self._read(table, where | {self.each: [value]}))
            except InputError as error:
                faults[value] = error
        if not good:
            raise all_of(faults)
        return good, faults

    def _read(self, table: Table, where: dict[str, list[str]]) -> Record:
        held_out_by = {one.split("=")[0].split("%")[0].strip() for one in self.test_where}
        changed: dict[str, Any] = {}
        if self.is_step:
            chosen = (f"{name}={','.join(values)}" for name, values in where.items())
            table = rows_of(table, fulfilling(table, chosen))
        if self.frequency is not None:
            table = with_moduli(table, self.frequency, self)
            changed = {"time": None, "group": (RUN,)}
        elif self.step is not None and self.condition:
            table, changed = with_runs(table, self), {"group": (RUN,)}
        elif self.step is not None:
            table = with_constant(table, self)
        elif self.hold and isinstance(self.input, str):
            table = at_hold(table, self.input, self)
        chosen = {name: getattr(self, name) for name in OF_RECORD} | {
            "input": self.input_words if self.is_step else self.input, "where": where,
            "keep": tuple(sorted(held_out_by | ({self.known or ""} & {*table.columns}))),
        } | changed  # fmt: skip
        record = read_csv(table, **chosen)
        record = record if self.known is None else with_known(record, self.known)
        left_out = on_lines(record.line, self.exclude_lines)
        return record.exclude(left_out) if left_out.any() else record

    def _counted(self, record: Record) -> Pair:
        """Training and test record, with the rows of the branch and the range alone."""
        limits: Any = self.range or None
        branch: Any = self.branch
        train, test = self._split(record)
        return (train.select(branch, limits), None if test is None else test.select(branch, limits))

    def _split(self, record: Record) -> Pair:
        if self.test_cycles is not None:
            return record.split_cycles(self.test_cycles)
        if self.test_tail is not None:
            return record.split_tail(self.test_tail)
        if self.test_lines:
            held = on_lines(record.line, self.test_lines)
            return record.split_rows(held) if held.any() else (record, None)
        if not self.test_where:
            return record, None
        held = fulfilling(record, self.test_where, strict=self.each is None)
        if self.each is not None and not held.any():
            return record, None
        share = {label: held[rows].mean() for label, rows in record.sequences()}
        if set(share.values()) <= {0.0, 1.0} and 0 < sum(share.values()) < len(share):
            return record.split_groups([label for label, part in share.items() if part])
        return record.split_rows(held)


def selection_of(options: Mapping[str, Any]) -> Selection:
    """The selection that these keys of a configuration file give."""
    return Selection.from_json({"input": None, **options})


def all_of(faults: Mapping[str, InputError]) -> InputError:
    """One error for several values of `each`: the same fault once, of different ones the first."""
    first, *others = dict.fromkeys(map(str, faults.values()))
    if not others:
        return next(iter(faults.values()))
    value, fault = next(iter(faults.items()))
    if {error.code for error in faults.values()} == {fault.code}:
        problem = f"{value}: {fault.problem} {len(faults) - 1} more have the same fault."
        return InputError(fault.code, problem, place=fault.place, cause=fault.cause, fix=fault.fix)
    return InputError("nothing-fits", f"{value}: {first} {len(faults) - 1} more failed.")


def fits_option(name: str, value: Any) -> bool:
    """Whether there is a selecting option that can have this value: of its kind, and one of its words."""
    if name not in FIELDS:
        return False
    given = tuple(value) if isinstance(value, list) else value
    choices = FIELDS[name].metadata.get("choices")
    fits = _is_of_kind(given, FIELDS[name].type)
    return fits and (not choices or given in (None, *choices))


def _is_of_kind(value: Any, hint: Any) -> bool:
    """Whether a value is of a field's type: a word, a number, tuples of them, None where it may be."""
    if get_origin(hint) is tuple:
        (one, _) = get_args(hint)
        return isinstance(value, tuple) and all(_is_of_kind(v, one) for v in value)
    if kinds := get_args(hint):
        return any(_is_of_kind(value, kind) for kind in kinds)
    if isinstance(value, bool) and hint is not bool:
        return False
    return isinstance(value, (int, float) if hint is float else hint)


def check_lines(ranges: Sequence[str], table: Table) -> None:
    """Raise `InputError` `no-match` where a range of lines holds no row of a table."""
    for one in ranges:
        if not on_lines(table.line, [one]).any():
            raise InputError(
                "no-match",
                f"No row of the file is on lines {one}.",
                place=table.path,
                fix=f"The rows are on lines {table.line.min()} to {table.line.max()}.",
            )


def on_lines(line: np.ndarray, ranges: Sequence[str]) -> np.ndarray:
    """Which rows, whose lines (n,) are given, are on one of these ranges, `FIRST-LAST` or one number.

    Raises `InputError` `bad-option`.
    """
    found = np.zeros(len(line), bool)
    for one in ranges:
        match = re.fullmatch(r"\s*(\d{1,18})(?:\s*-\s*(\d{1,18}))?\s*", one)
        first, last = (int(x or match[1]) for x in match.groups()) if match else (1, 0)
        if last < first:
            raise InputError(
                "bad-option",
                f"{one!r} is not a range of lines.",
                fix="Write the first and the last line of the file: 120-340.",
            )
        found |= (line >= first) & (line <= last)
    return found


def as_ranges(line: np.ndarray, chosen: np.ndarray) -> list[str]:
    """The ranges of lines that hold the chosen rows and no others; the inverse of `on_lines`.

    Lines between neighbouring rows, such as comments, are taken along.
    """
    order = np.argsort(line, kind="stable")
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen[order].astype(int), [0]])))
    first, last = line[order][edges[::2]], line[order][edges[1::2] - 1]
    return [f"{a}-{b}" for a, b in zip(first.tolist(), last.tolist(), strict=True)]


# The columns of a fit, and the same ones in another file.


def in_unit(table: Table, name: str, wanted: str) -> np.ndarray:
    """A column in a unit, unchanged if either unit is "1". Raises `InputError` `wrong-unit`."""
    unit = named_unit(name, None, table.units.get(name)) or "1"
    factor = 1.0 if "1" in (unit, wanted) else conversion(unit, wanted)
    if factor is None:
        said = f"Column {name!r} is in {unit}, not in a unit like {wanted}."
        raise InputError("wrong-unit", said, place=table.path, fix="Correct its header.")
    return factor * table.number(name)


def selection_of_fit(document: dict[str, Any]) -> Selection:
    """The columns a fit was made from; a fit saved from Python knows their names alone."""
    try:
        if "selection" in document:
            return Selection.from_json(document["selection"])
        words = document["records"]["train"]
        time = words["time_name"] if words["time_unit"] != "1" else None
        channels = "channels" in document
        names = tuple(document["channels"]["names"]) if channels else words["input_name"]
        return Selection(names, words["output_name"], time)
    except (KeyError, TypeError) as error:
        raise InputError(
            "damaged-file",
            f"fit.json does not say which columns were fitted: {type(error).__name__} {error}.",
            cause="fit.json was edited.",
            fix="Fit again.",
        ) from error


def for_new_file(
    selection: Selection, table: Table, inverse: bool
) -> tuple[Selection, bool, list[str]]:
    """The fit's selection on a file that may lack columns: (selection, comparable, what was said).

    Without the column that is predicted nothing is compared; conditions and groups of columns that
    are not there are let go, and so are excluded lines, which are those of the fitted file. The driving
    column, the clock and `each` have to be there.
    """
    driving, wanted = selection.input or CONSTANT, selection.output
    if inverse:
        driving, wanted = wanted, driving
    first = driving[0] if isinstance(driving, tuple) else driving
    columns = table.columns
    where = tuple(c for c in selection.where if c.partition("=")[0].strip() in columns)
    group = tuple(column for column in selection.group if column in columns)
    said = [
        f"The file has no column for {c!r}, so every row is used."
        for c in selection.where
        if c not in where
    ]
    if lost := [column for column in selection.group if column not in group]:
        said.append(
            f"The file has no column {', '.join(lost)}, so its sequences are not separated by it."
        )
    selection = replace(
        selection, where=where, group=group, exclude_lines=(), rezero=(), branch=None, range=(),
        turn=tuple(column for column in selection.turn if column in columns),
        known=selection.known if wanted in columns else None,
        sigma=selection.sigma if selection.sigma in columns else None,
    )  # fmt: skip
    if selection.is_step:
        if inverse or wanted in columns or selection.time is None:
            return selection, True, said
        return replace(selection, output=selection.time, output_unit=None), False, said
    if wanted in columns or first not in columns:
        return selection, True, said
    alone = replace(selection, input=driving, output=first, input_unit=None, output_unit=None)
    return alone, False, said


def known_records(selection: Selection, table: Table, folders: Collection[str]) -> dict[str, Pair]:
    """The records of a new file by those values of `each` that were fitted.

    Raises the fault of one of these, and `InputError` `no-match` where the file has none of them.
    """
    records, faults = selection.records(table)
    if faults := {value: error for value, error in faults.items() if value in folders}:
        raise all_of(faults)
    if known := {value: pair for value, pair in records.items() if value in folders}:
        return known
    raise InputError(
        "no-match",
        f"The file has no value of {selection.each or 'a specimen'} that was fitted: {', '.join(folders)}.",
        place=str(table.path),
        fix="" if selection.each else "Name the folder of one specimen, DIR/NAME.",
    )
