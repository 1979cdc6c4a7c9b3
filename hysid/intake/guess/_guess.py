"""Guess of `hysid init`: number format, input, output, clock, sequences and hold-out of a file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hysteresis import InputError, Record, read_table
from hysteresis.records._excitation import check_identifiable
from hysteresis.records._table import Table, rows_of
from hysteresis.records._units import OSCILLATION, kind_of, words_of, written_unit

from .._creep_fits import check_step
from .._options import HELD_OUT, OF_READING
from .._selection import selection_of
from ._column_pairs import (
    LEAST,
    Column,
    NothingDrivenError,
    columns_of,
    filled,
    held,
    logged_in_turn,
    no_header,
    pairs,
    rank_correlation,
    rises,
    usual_step,
)
from ._drive_and_response import FOLLOWS, SPECTRUM, Choice, Seen, choose
from ._remedies import HEAD, hold_out, reading, settle
from ._sequence_columns import (
    RESPONSES,
    RUNS,
    SPECIMENS,
    Sequences,
    condition_of,
    constant_within,
    counts_rows,
    moduli_of,
    runs_of,
    sequences_of,
)

SURE, LIKELY, GUESS = "sure", "likely", "guess"
_SURE_OF = {"encoding-guessed": LIKELY, "no-header": GUESS}
"""How sure notes of reading are that say no more than what is likely."""
_ASIDE = ("time", "index", "aside", "label", "speed", "frequency", "viscosity", OSCILLATION)
"""Kinds of columns that are no input and no output."""
MOST_TABLES = 12
"""Tables of a file that are tried where the longest one holds no input and output."""
CHAMBER = 0.05
"""Part of its range over all sequences that a temperature may move within one that holds it."""
HEATS = 0.9
"""Rank correlation from which on a temperature drives beside columns that do not follow each other."""
STAYS = 0.7
"""Share of rows above which an input counts as held constant."""


@dataclass(frozen=True)
class Finding:
    """One thing seen: an option's name, its value in words, how sure, and why."""

    what: str
    value: str
    sure: str
    why: str


@dataclass
class Guess:
    """What `hysid init` makes of a file.

    - `selection`, `fit`: options as a configuration file has them.
    - `found`: what was seen and assumed; `alternatives`: options that would do as well.
    - `warnings`: what stands against identifying a model; `text`: the record, as `hysid check` says it.
    - `columns`: every column of the table with its unit as the file writes it, `rows` of it.
    - `no_roles`: why no column is an input or an output; "" where some are. Of moduli over frequency the
      selection has those columns none the less.
    """

    selection: dict[str, Any] = field(default_factory=dict)
    fit: dict[str, Any] = field(default_factory=dict)
    found: list[Finding] = field(default_factory=list)
    alternatives: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    text: str = ""
    columns: list[dict[str, str]] = field(default_factory=list)
    rows: int = 0
    no_roles: str = ""
    sequences: int = 0
    cycles: int = 0

    def says(self, what: str, value: Any, sure: str, why: str) -> None:
        """Note a thing seen, or assumed."""
        self.found.append(Finding(what, str(value), sure, why))


def guess(file: Path, given: Mapping[str, Any] | None = None) -> Guess:
    """Options for `hysid fit` from the file alone, beside those `given`, which are not doubted.

    Raises `InputError` as reading does, and `no-header`, `cannot-decide` where the file does
    not show which columns are input and output; the message names the options to give.
    """
    given = {key: value for key, value in (given or {}).items() if value}
    if isinstance(inputs := given.get("input"), str | tuple):
        given["input"] = [inputs] if isinstance(inputs, str) else [*inputs]
    found = _guess(file, given)
    doubted = found.no_roles and "table" not in given
    # The longest table shows results at times, and another one the samples.
    for number in range(1, MOST_TABLES + 1) if doubted else ():
        try:
            other = _guess(file, {**given, "table": number})
        except InputError:
            break
        if not other.no_roles and other.rows >= LEAST:
            why = f"the longest table holds no samples: {found.no_roles}"
            other.selection["table"] = number
            other.says("table", number, LIKELY, why)
            return other
    return found


def _guess(file: Path, given: Mapping[str, Any]) -> Guess:
    """The guess for one table of a file."""
    out = Guess()
    table = table_of(file, out, given)
    columns = columns_of(table)
    time = _time(columns, given, out)
    if in_turn := logged_in_turn(columns):
        columns |= {name: filled(columns[name]) for name in in_turn}
        why = "each has rows of its own; gaps are interpolated linearly to compare them"
        out.says("in turn", ", ".join(sorted(in_turn)), LIKELY, why)
    sequences = sequences_of(table, time)
    _sequences(sequences, given, out)
    if not given.get("input") and runs_of(columns, given, out):
        return _of_spectrum(table, out)
    still = {n for n, c in columns.items() if np.nanmax(c.x) == np.nanmin(c.x)}
    measured = _measured(table, columns, sequences, {*still, time or ""}, given)
    constant = [columns[n] for n in still]
    seen = Seen(table, time, out.selection, given)
    try:
        choice = choose(seen, measured, constant)
    except (InputError, NothingDrivenError) as nothing:
        # A ratio, an area or a temperature is no reading beside one; alone with its input it is.
        both = _with_aside(table, columns, sequences, {*still, time or ""})
        if not given and len(measured) < 2 and len(both) == 2:
            choice = choose(seen, both, constant)
        elif moduli_of(columns, given, out):
            out.no_roles = SPECTRUM
            return _of_spectrum(table, out)
        elif isinstance(nothing, NothingDrivenError):
            out.no_roles = str(nothing)
            return out
        else:
            raise
    _columns(choice, given, out)
    _clocks(columns, choice, time, given, out)
    out.selection, notes = settle(table, out.selection)
    for what, value, why in notes:
        out.says(what, value, LIKELY, why)
        out.found = [one for one in out.found if what != "dt" or one.what != "time"]
    _condition(table, columns, given, out)
    table = _head(table, file)  # its rows follow one another, as those of an excerpt do not
    _hold(table, out)
    kept, why = hold_out(table, out.selection, sequences.split)
    out.selection |= {} if any(given.get(key) for key in HELD_OUT) else kept
    why += ", as far as the part that was read shows" if table.share < 1 else ""
    said = ", ".join(f"{key} = {value}" for key, value in kept.items())
    out.says("held out", said or "nothing", LIKELY, why)
    _memory(columns, choice, out)
    _check(table, out)
    return out


def _of_spectrum(table: Table, out: Guess) -> Guess:
    """The guess for moduli over frequency, or over time at several temperatures."""
    out.says("held out", "nothing", LIKELY, "every row tells of time constants of its own")
    _check(table, out)
    return out


def table_of(file: Path, out: Guess, given: Mapping[str, Any]) -> Table:
    """The table of a file, read as it seems to ask for; `out` says how, and has its rows and columns."""
    options = {key: given[key] for key in OF_READING if given.get(key)}
    try:
        table = read_table(file, **options, most=HEAD)
    except InputError as error:
        if error.code == "no-header":
            raise no_header(str(file), error.problem) from None
        if error.code != "decimal-comma":
            raise
        options.setdefault("decimal", ",")
        table = read_table(file, **options, most=HEAD)
    more, notes = reading(table, options)
    options |= more
    table = read_table(file, **options, most=HEAD) if more else table
    nameless = any(note.code == "no-header" for note in table.notes)
    if nameless and not (given.get("input") and given.get("output")) and len(table.line) < LEAST:
        problem = f"{len(table.line)} rows are too few to tell the columns by their shape."
        raise no_header(str(file), problem)
    if nameless:
        told = f"The file names no columns, so {', '.join(table.columns)} are told by their shape alone."
        out.warnings.append(told)
    out.selection |= {k: list(v) if isinstance(v, tuple) else v for k, v in options.items()}
    names = ", ".join(f"{name!r}" for name in table.columns)
    if table.share < 1:
        rows = f"about {int(len(table.line) / table.share):,} rows"
        how = f"read from {table.share:.2%} of the file: its head, its tail, and pieces of all the rest"
        out.says("file", rows, LIKELY, f"{how}; columns {names}")
    else:
        out.says("file", f"{len(table.line)} rows", SURE, f"columns {names}")
    for note in table.notes:
        out.says("reading", note, _SURE_OF.get(note.code, SURE), "")
    for what, value, why in notes:
        out.says(what, value, SURE, why)
    out.rows = int(len(table.line) / table.share)
    out.columns = [
        {"name": name, "unit": written_unit(name, table.written_units.get(name)) or ""}
        for name in table.columns
    ]
    return table


def _head(table: Table, file: Path) -> Table:
    """The rows from the head of a file of which an excerpt was read; all rows of others."""
    if table.share == 1:
        return table
    with file.open("rb") as opened:
        lines = opened.read(HEAD).count(b"\n")
    return rows_of(table, np.flatnonzero(table.line <= lines))


def _time(columns: Mapping[str, Column], given: Mapping[str, Any], out: Guess) -> str | None:
    """The clock: a column named so that rises."""
    for key in ("dt", "time"):
        if given.get(key):
            out.selection[key] = given[key]
            return given[key] if key == "time" else None
    clocks = _clocks_of(columns)
    if not clocks:
        first = [*columns.values()][:1]  # where a clock without its name stands
        first = [c for c in first if c.kind.name == "unknown" and rises(c.x) == 1.0]
        first = [c for c in first if not (RUNS | SPECIMENS) & set(words_of(c.name))]
        clocks = [c for c in first if not counts_rows(c.x) and usual_step(c.x) > 0 and c.x[0] >= 0]
    if not clocks:
        why = "no column rises like a clock; give --dt SECONDS if speed matters"
        out.says("time", "none", LIKELY, why)
        return None

    def plainness(column: Column) -> tuple[bool, bool, int]:
        words = len(words_of(column.name))
        return words <= 2, column.missing == 0, -words

    best = max(clocks, key=plainness)
    sure = SURE if best.kind.sure == 1.0 else LIKELY
    sure = sure if best.kind.name == "time" else GUESS
    out.selection["time"] = best.name
    out.says("time", best.name, sure, f"it rises, with a median step of {usual_step(best.x):.4g}")
    return best.name


def _clocks_of(columns: Mapping[str, Column]) -> list[Column]:
    return [c for c in columns.values() if c.kind.name == "time" and rises(c.x) > 0.9]


def _sequences(sequences: Sequences, given: Mapping[str, Any], out: Guess) -> None:
    for key in ("group", "each"):
        value = given.get(key) or getattr(sequences, key)
        if value:
            out.selection[key] = list(value) if isinstance(value, tuple) else value
    chosen_elsewhere = ("input", "output", "time", "dt", "step", "group", "each", *OF_READING)
    for key, value in given.items():
        if key not in chosen_elsewhere:
            out.selection[key] = list(value) if isinstance(value, tuple) else value
    for what, value, why in sequences.said:
        if not given.get(what):
            out.says(what, value, LIKELY, why)


def _measured(
    table: Table,
    columns: Mapping[str, Column],
    sequences: Sequences,
    not_these: set[str],
    given: Mapping[str, Any],
) -> list[Column]:
    """Columns that can be an input or an output."""
    kinds = {column.kind.name for column in columns.values()}
    magnetic = "moment" in kinds or {"field", "resistance"} <= kinds
    found, heat = [], []
    for name, column in columns.items():
        asked = name in (given.get("output"), *(given.get("input") or ()))
        few = len(np.unique(column.x[np.isfinite(column.x)])) < min(5, 2 + len(column.x) // 8)
        if not asked and (
            name in not_these or name in sequences.labels or column.kind.name in _ASIDE or few
            or counts_rows(column.x) or constant_within(table, name, sequences.keys)
        ):  # fmt: skip
            continue
        hot = column.kind.name == "temperature" and not (magnetic or asked)
        (heat if hot else found).append(column)
    others = [pair.follows for pair in pairs(found)] if heat else []
    if heat and len(found) > 1 and max(others, default=0.0) < FOLLOWS:
        # A heated wire, a bath: what nothing else drives.
        least = HEATS if others else FOLLOWS
        hot = [p for p in pairs([*heat, *found]) if any(p.input is c for c in heat)]
        found += [p.input for p in hot[:1] if p.follows > least]
    return found


def _with_aside(
    table: Table, columns: Mapping[str, Column], sequences: Sequences, not_these: set[str]
) -> list[Column]:
    """The columns that change, whatever their names say, where they are two that follow each other. What a
    chamber holds in each sequence is a condition of it."""
    found = [
        column for name, column in columns.items()
        if name not in not_these and name not in sequences.labels
        and not constant_within(table, name, sequences.keys, CHAMBER)
        and column.kind.name not in ("time", "index", "label", OSCILLATION)
        and not counts_rows(column.x)
    ]  # fmt: skip
    has_deviation = any(column.kind.name in RESPONSES for column in found)  # beside its response
    if len(found) != 2 or has_deviation or abs(rank_correlation(found[0].x, found[1].x)) < FOLLOWS:
        return []
    return [c._replace(kind=kind_of(c.name, c.unit, aside=False)) for c in found]


def _columns(choice: Choice, given: Mapping[str, Any], out: Guess) -> None:
    for role in ("input", "output"):
        column: Column | None = getattr(choice, role)
        if column is not None:
            out.selection[role] = column.name
            sure = SURE if given.get(role) else choice.sure
            unit = "no unit" if column.unit == "1" else column.unit
            out.says(role, column.name, sure, f"{column.kind.name}, {unit}; {choice.why[role]}")
    out.selection |= choice.options
    constant = {"step", "hold"} & set(choice.options)
    if constant and _each_of_group(out):
        out.says("each", out.selection["each"], LIKELY, "one fit for each constant input")
    if "step" in constant:
        out.says("step", choice.options["step"], choice.sure, choice.why["step"])
    out.alternatives += choice.alternatives


def _clocks(
    columns: Mapping[str, Column],
    choice: Choice,
    time: str | None,
    given: Mapping[str, Any],
    out: Guess,
) -> None:
    """Clocks named after the columns they belong to."""
    if given.get("time") or choice.input is None:
        return
    own, clocks = {}, _clocks_of(columns)
    for role, column in (("input", choice.input), ("output", choice.output)):
        words = set(words_of(column.name))
        own[role] = next((c.name for c in clocks if words & {*words_of(c.name)}), None)
    if own["output"] and own["output"] != time:
        out.selection["time"] = own["output"]
        out.found = [f for f in out.found if f.what != "time"]
        out.says("time", own["output"], SURE, "the output's own clock")
    if own["input"] and own["output"] and own["input"] != own["output"]:
        out.selection["input_time"] = own["input"]
        out.says("input_time", own["input"], SURE, "the input has its own clock")


def _condition(table: Table, columns: Mapping[str, Column], given: Mapping, out: Guess) -> None:
    """Selects what the rig held in each sequence, if that is one quantity."""
    if given or table.share < 1 or {"step", "each"} & set(out.selection):
        return
    (record, _), *_ = selection_of(out.selection).records(table)[0].values()
    if name := condition_of(columns, record, table):
        out.selection["condition"] = [name]
        out.says("condition", name, LIKELY, "it stays in every sequence and differs between them")


def _hold(table: Table, out: Guess) -> None:
    """Selects the hold, if the input moves one way and stays there, to fit its spectrum."""
    if selection_of(out.selection).is_step or not isinstance(out.selection["input"], str):
        return
    if not {"time", "dt"} & set(out.selection):
        return
    records = [record for record, _ in selection_of(out.selection).records(table)[0].values()]
    if not all(_goes_and_stays(record) for record in records):
        return
    out.selection["hold"] = True
    try:
        selection_of(out.selection).records(table)
    except InputError as error:
        if error.code != "no-hold":
            raise
        del out.selection["hold"]  # small beside its range, the input moves on
        return
    why = "the input moves one way and stays there, so the hold shows creep or relaxation"
    if _each_of_group(out):
        why += "; one fit for each value of the group"
    out.says("hold", "true", LIKELY, why)


def _each_of_group(out: Guess) -> bool:
    """Fits each value of the one group apart; whether there is such a group."""
    group = out.selection.get("group", ())
    if len(group) != 1 or "each" in out.selection:
        return False
    del out.selection["group"]
    out.found = [one for one in out.found if one.what != "group"]
    out.selection["each"] = group[0]
    return True


def _goes_and_stays(record: Record) -> bool:
    one_way = all(np.ptp(record.branch[rows]) == 0 for _, rows in record.sequences())
    return one_way and np.ptp(record.input) > 0 and held(record.input) > STAYS


def _memory(columns: Mapping[str, Column], choice: Choice, out: Guess) -> None:
    """First-order reversal curves come down from saturation before they rise."""
    reversal = any({"reversal", "reversals", "umkehr"} & set(words_of(name)) for name in columns)
    if reversal and choice.input is not None and choice.input.kind.name in ("field", "current"):
        out.fit["initial"] = "positive"
        out.says("initial", "positive", LIKELY, "reversal curves start from positive saturation")


def _check(table: Table, out: Guess) -> None:
    """The record as it will be fitted, and what stands against it."""
    selection = selection_of(out.selection)
    good, faults = selection.without_hold_out().records(table)
    records = {value: train for value, (train, _) in good.items()}
    out.sequences = sum(len(r.labels) for r in records.values())
    out.cycles = sum(r.n_cycles for r in records.values())
    first, record = next(iter(records.items()))
    text = check_step(record)["text"] if selection.is_step else record.describe()
    out.text = (f"{selection.each} = {first}\n" if first else "") + text
    seen: dict[str, None] = {}
    for record in [] if selection.is_step else records.values():
        try:
            seen |= dict.fromkeys(check_identifiable(record))
        except InputError as error:
            seen[str(error)] = None
    out.warnings += list(seen)[:8]
    out.warnings += [f"{value}: {error}" for value, error in faults.items()][:4]
