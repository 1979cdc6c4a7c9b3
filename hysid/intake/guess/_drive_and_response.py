"""Choice of input and output: the best pair of quantities, and which of the two is the input."""

from collections.abc import Mapping
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from hysteresis import InputError, Record
from hysteresis._escape import shell_word
from hysteresis.records._excitation import CROSSED, loop_direction, turn_in_words
from hysteresis.records._table import Table
from hysteresis.records._units import OSCILLATION, words_of

from ._column_pairs import (
    PAIRS,
    STANDS,
    Column,
    NothingDrivenError,
    Pair,
    by_shape,
    columns_of,
    commanded,
    correlation,
    duplicates,
    filled,
    held,
    is_sine,
    leftover,
    noise,
    pairs,
    unsteadiness,
)
from ._sequence_columns import RESPONSES

MISSING = 0.05
"""Above this share of gaps a column cannot be an input, because history needs every sample."""
FAINT = 0.4
"""Below this score a pair is rejected if another pair scores almost as high."""
FOLLOWS = 0.5
"""Rank correlation from which on a column that is no reading by its name follows another."""
MOST = 40_000
"""Rows that are looked at."""
ALIKE = 0.99
"""Correlation of two readings of one quantity."""
NEAR = 0.97
"""The share of the best pair's score from which another transducer follows the input as well."""
SPECTRUM = (
    "each row is the result of an oscillation, with its storage and loss modulus (a sweep over frequency,"
    " temperature or amplitude), and no sample over time"
)
HELD = ("force", "stress", "strain", "displacement", "torque")
"""Kinds of columns that a creep or relaxation test holds constant."""
DEFORMED = ("displacement", "strain", "angle")
"""Kinds of columns that answer a load, and by which a rig moves as well."""
USUAL, SURELY = 1.0, 4.0
"""Bits for the usual way of a pair, and for a column that a rig commanded."""
LEAST, EXPLAINED = 1e-3, 0.01
"""Parts of its range to which a column is told at best, and below which nothing of it is unexplained."""


class Choice(NamedTuple):
    """Input (None for a constant input), output, certainty, reasons, further options, alternatives."""

    input: Column | None
    output: Column
    sure: str
    why: dict[str, str]
    options: dict[str, Any]
    alternatives: list[str]


class Seen(NamedTuple):
    """A table, its clock, the options that were found, and those that were given."""

    table: Table
    time: str | None
    options: Mapping[str, Any]
    given: Mapping[str, Any]


def choose(seen: Seen, columns: list[Column], still: list[Column]) -> Choice:
    """Input and output among the columns that change; `still` are those that do not.

    Raises `InputError` `cannot-decide`, `no-column`.
    """
    table, time, _, given = seen
    place = table.path
    inputs: list[str] = list(given.get("input") or ())
    for name in [*inputs, *([given["output"]] if given.get("output") else [])]:
        if name not in {c.name for c in columns}:
            table.number(name)  # says what columns there are, or which cell is no number
    if len(inputs) > 1:
        return _channels(columns, inputs, given, place)
    if not columns and _results(table).any():
        raise NothingDrivenError(SPECTRUM)
    if given.get("step") or all(c.name == given.get("output") for c in columns):
        return _step(seen, columns, still)
    asked_in, asked_out = inputs[0] if inputs else None, given.get("output")
    usable = [c for c in columns if c.name in (asked_in, asked_out)]
    usable += duplicates([c for c in columns if c not in usable])
    if len(usable) < 2 and asked_in is None:
        return _step(seen, columns, still)
    usable = _sampled(table, usable, {asked_in, asked_out})
    if any(note.code == "no-header" for note in table.notes) and not (asked_in and asked_out):
        usable = by_shape(table, usable, time, {asked_in, asked_out} - {None})
    clock = table.columns[time] if time else None
    every = pairs(usable, clock)
    turned = [Pair(p.output, p.input, p.score, p.follows) for p in every]
    wanted = lambda p: asked_in in (None, p.input.name) and asked_out in (None, p.output.name)  # noqa: E731
    found = [*filter(wanted, every)] or [*filter(wanted, turned if asked_in or asked_out else ())]
    if asked_in and asked_out:
        by_name = {c.name: c for c in columns}
        why = {"input": "given", "output": "given"}
        return Choice(by_name[asked_in], by_name[asked_out], "sure", why, {}, [])
    if not found:
        return _unknown(seen, usable)
    best = found[0]
    own = {best.input.name, best.output.name}
    second = next((p.score for p in found if {p.input.name, p.output.name} != own), -np.inf)
    if best.score < FAINT and second > 0.8 * best.score:
        raise _undecided(columns, place)
    read = best.input.kind.sure == best.output.kind.sure == 1.0  # by name and by unit
    sure = "likely" if best.score > 0.3 else "guess"
    sure = "sure" if second < 0.8 * best.score and read and best.score > 0.7 else sure
    best = _reading(table, best, found, asked_out)
    choice = _directed(seen, best, asked_in, asked_out)
    if sure == "sure":
        sure = choice.sure
    near = [_said(p.input.name, p.output.name) for p in found if p.score > 0.3 * best.score]
    chosen = _said(*(c.name for c in (choice.input, choice.output) if c is not None))
    more = [pair for pair in near if pair != chosen][:3]
    return choice._replace(sure=sure, alternatives=[*dict.fromkeys([*choice.alternatives, *more])])


def _reading(table: Table, best: Pair, found: list[Pair], asked_out: str | None) -> Pair:
    """One of several readings of the output that follow the input as well.

    Of two results for one signal, as those of a magnetometer, the one that the instrument fitted better,
    then the one with less noise; of several transducers the first in the file.
    """
    if asked_out:
        return best
    others = [
        p for p in found if p.input.name == best.input.name and p.output[1:3] == best.output[1:3]
    ]
    twins = [p for p in others if abs(correlation(p.output.x, best.output.x)) > ALIKE]
    if len(twins) > 1:
        shared = set.intersection(*(set(words_of(p.output.name)) for p in twins))
        return min(twins, key=lambda p: (-_fit_of(table, p.output.name, shared), noise(p.output.x)))
    near = [p for p in others if p.score > NEAR * best.score]
    return min(near, key=lambda p: list(table.columns).index(p.output.name))


def _fit_of(table: Table, name: str, shared: set[str]) -> float:
    """How well the instrument says that it fitted a reading: a column of its words and "fit"; else 0."""
    own = set(words_of(name)) - shared
    for other, x in table.columns.items():
        said = set(words_of(other))
        if x.dtype.kind == "f" and own and own <= said and "fit" in said:
            return float(np.nanmean(x))
    return 0.0


def _sampled(table: Table, columns: list[Column], asked: set[str | None]) -> list[Column]:
    """Columns whose rows are samples over time, beside those `asked` for.

    Left out: results of oscillations, one a row, with their storage and loss modulus beside them; strains
    and angles that only add up under a shear rate; the current of a magnet whose field is known.

    Raises `NothingDrivenError` where only results of oscillations are left.
    """
    every, results = columns_of(table).values(), _results(table)
    flow = [c for c in columns if c.kind.name == "rate"]
    field = any(c.kind.name == "field" for c in every)
    magnet = field and any(c.kind.name == "moment" for c in columns)
    found, spectrum = [], 0
    for c in columns:
        good = np.isfinite(c.x)
        if c.name not in asked and results[good].mean() > 0.5:
            spectrum += 1
            continue
        step = np.diff(c.x[good])
        adds_up = bool(flow) and c.kind.name in ("strain", "angle") and np.mean(step < 0) < 0.05
        if c.name in asked or not (adds_up or (magnet and c.kind.name == "current")):
            found.append(c)
    if spectrum and not found:
        raise NothingDrivenError(SPECTRUM)
    return found


def _results(table: Table) -> np.ndarray:
    """Rows that are results of oscillations, (n,)."""
    moduli = [np.isfinite(c.x) for c in columns_of(table).values() if c.kind.name == OSCILLATION]
    return np.logical_and.reduce(moduli) if len(moduli) > 1 else np.zeros(len(table.line), bool)


def _directed(seen: Seen, pair: Pair, asked_in: str | None, asked_out: str | None) -> Choice:
    """A pair with its input and output chosen.

    A model with memory describes a loop whose output lags its input. The pair is turned if the usual
    input has gaps, or if what speaks for the usual output as the drive outweighs the usual way.
    """
    a, b = pair.input, pair.output
    why = {"input": "the usual input of this pair", "output": "the usual output of this pair"}
    record, other = _record(seen, a, b), _record(seen, b, a)
    votes = [] if asked_in == a.name or asked_out == b.name else _votes(seen, a, b, record, other)
    for_b, total = max(votes, default=_NONE), sum(vote.bits for vote in votes)
    for_a = min(votes, default=_NONE)
    if total > USUAL:
        a, b, record = b, a, other
        why = {"input": for_b.said, "output": "the response to it"}
    elif for_a.bits < 0:
        why["input"] = for_a.said
    if loop_direction(record) and record.n_cycles:
        why["output"] += f"; loop {turn_in_words(record)}"
    kinds = pair.output.kind.name, pair.input.kind.name
    either = kinds[0] in DEFORMED or kinds in PAIRS
    shown = abs(total - USUAL) >= SURELY - USUAL or {asked_in, asked_out} & {a.name, b.name}
    sure = "sure" if shown or not either else "likely"
    return Choice(a, b, sure, why, {}, [_said(b.name, a.name)])


class _Vote(NamedTuple):
    """How much likelier it is that the second of two columns drives, in bits; less than 0: the first."""

    bits: float
    said: str


_NONE = _Vote(0.0, "")


def _votes(seen: Seen, a: Column, b: Column, record: Record, other: Record) -> list[_Vote]:
    """What speaks for either column as the drive: gaps of the other, that a rig commanded it (`commanded`),
    and of a load and what it deforms that it goes one way while the other turns back (a test to failure),
    that it determines the other better (a slack specimen: the force rests while it moves), and that it is
    read with less noise (a controlled motion is smoother than the response of a specimen)."""
    if a.missing > max(MISSING, 2 * b.missing):
        gaps = f"{a.name!r} has gaps ({a.missing:.0%}), and an input must be complete"
        return [_Vote(SURELY, gaps)]
    for sign, one, rest in ((1, b, a), (-1, a, b)):
        if how := _driven(seen, one, rest):
            return [_Vote(sign * SURELY, f"{one.name!r} {how}, so the rig commanded it")]
    if b.kind.name not in DEFORMED:
        return []
    # Specimens differ: of one sequence.
    rows = max((rows for _, rows in record.sequences()), key=lambda rows: rows.stop - rows.start)
    for sign, one, rest in ((1, b, a), (-1, a, b)):
        if is_sine(*_together(seen, one, rest, rows)):
            return [_Vote(sign * SURELY, f"{one.name!r} moves as a sine, so the rig commanded it")]
    found = []
    turns = [np.ptp(r.branch) > 0 for r in (record, other)]
    if turns[0] != turns[1]:
        sign, one, rest = (1, b, a) if turns[0] else (-1, a, b)
        found.append(_Vote(sign * 2.0, f"{one.name!r} goes one way while {rest.name!r} turns back"))
    ours, theirs = (
        max(leftover(r.input[rows], r.output[rows], r.branch[rows]), EXPLAINED)
        for r in (record, other)
    )
    bits = float(np.clip(np.log2(ours / theirs), -2.0, 2.0))
    one, rest = (b, a) if bits > 0 else (a, b)
    said = f"{one.name!r} determines {rest.name!r} better than the other way round"
    left = f"unexplained: {min(ours, theirs):.1%}, {max(ours, theirs):.1%}"
    found.append(_Vote(bits, f"{said} ({left})"))
    quiet = [max(unsteadiness(c.x), LEAST) for c in (a, b)]
    bits = float(np.clip(np.log2(quiet[0] / quiet[1]) / 2, -1.5, 1.5))
    one, rest = (b, a) if bits > 0 else (a, b)
    found.append(_Vote(bits, f"{one.name!r} is smoother than {rest.name!r}"))
    return found


def _driven(seen: Seen, column: Column, other: Column) -> str:
    """How the rig drove a column and not the other one, in words; "" where that does not show."""
    few = 0 < other.missing <= MISSING  # gaps, as at an overload: at a reversal one bends the drive
    return commanded(*_together(seen, column, filled(other) if few else other))


def _together(
    seen: Seen, column: Column, other: Column, rows: slice = slice(MOST)
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Those of the rows where both are numbers, of both, and their clock."""
    at = np.flatnonzero(np.isfinite(column.x) & np.isfinite(other.x))[rows]
    return column.x[at], other.x[at], seen.table.columns[seen.time][at] if seen.time else None


def _record(seen: Seen, a: Column, b: Column) -> Record:
    """Rows where both are numbers, in their sequences, without a clock."""
    table, options = seen.table, seen.options
    keys = [*(options.get("group") or ()), *([options["each"]] if options.get("each") else [])]
    keys = [k for k in keys if k in table.text]
    good = np.flatnonzero(np.isfinite(a.x) & np.isfinite(b.x))[:MOST]
    # Text is read anew whenever it is asked for.
    cells = [table.text[k][good].tolist() for k in keys]
    parts = np.array(["/".join(row) for row in zip(*cells, strict=True)]) if keys else None
    return Record.from_arrays(a.x[good], b.x[good], groups=parts)


def _step(seen: Seen, columns: list[Column], still: list[Column]) -> Choice:
    """Creep or relaxation: a constant input, and the output over time."""
    table, time, _, given = seen
    found = [c for c in columns if given.get("output") in (None, c.name)]
    found = [c for c in found if c.kind.name != "unknown"] or found
    every = columns_of(table)
    sides = {"unknown", *RESPONSES, *chain(*PAIRS)} - {"temperature"}
    aside = len(every) > 2 and not sides & {column.kind.name for column in every.values()}
    if time is not None and not given and aside:
        raise NothingDrivenError("no column beside the clock drives or answers another")
    numbers = [name for name, x in table.columns.items() if x.dtype.kind == "f"]
    if time is None and found and given.get("step"):
        said = "No column is a clock, over which the output of a constant input changes."
        fix = "Name the column of times (--time COL)."
        raise InputError("cannot-decide", said, place=table.path, fix=fix)
    for name in table.columns:
        _grouped(table, name)
    words = [
        f"{n!r} ({str(x[0])[:20]!r}, ...)" for n, x in table.columns.items() if x.dtype.kind != "f"
    ]
    text = f" Columns of text: {', '.join(words[:4])}." if words else ""
    if time is None or not found:
        what = f"{len(found) or 'None'} of them can be an input or an output; a loop needs two that change."
        if len(found) > 1:
            alike = " and ".join(repr(c.name) for c in found[:4])
            what = f"{alike} hold one quantity; a loop needs two that change."
        raise InputError(
            "cannot-decide",
            f"Columns of numbers: {', '.join(map(repr, numbers)) or 'none'}. {what}{text}",
            place=table.path,
            cause="A single column, words instead of numbers, or a separator other than , ; tab |.",
            fix="Export input and output side by side; for creep give --step VALUE.",
        )
    output = found[0]
    why = {"output": "the only column that changes over time"}
    value, unit, sure = given.get("step"), given.get("input_unit"), "sure"
    kept = next((c for c in still if c.kind.name in HELD), None)
    others = (c for c in every.values() if c.kind.name in HELD and c.name != output.name)
    once = [c for c in others if _steps_once(c.x)]
    if value is None and kept is None and len(once) == 1:
        why["input"] = f"it steps to {once[0].x[-1]:g} and stays there"
        why["output"] = "it goes on changing"
        return Choice(once[0], output, "likely", why, {}, [])
    keys = [*(seen.options.get("group") or ()), seen.options.get("each")]
    named = next((every[k] for k in keys if k in every and every[k].kind.name in HELD), None)
    if value is None and kept is None and named is not None:
        why["input"] = "it is constant in each sequence, and time begins anew where it changes"
        return Choice(named, output, "likely", why, {"hold": True}, [])
    if value is not None:
        why["step"] = "given"
    elif kept is not None and float(np.nanmax(kept.x)):
        value, unit = float(np.nanmax(kept.x)), None if kept.unit == "1" else kept.unit
        said = f"{kept.name!r} is {value:g} in every row"
        why["step"] = f"{said}, so this is a creep or relaxation test"
    elif output.kind.name in RESPONSES:
        value, sure = 1.0, "likely"
        why["step"] = f"a {output.kind.name} is the response to a unit step"
    else:
        moving = [c.name for c in every.values() if np.nanmax(c.x) > np.nanmin(c.x)]
        others = [repr(name) for name in moving if name not in (output.name, time)]
        said = f"Only {output.name!r} changes over time; the constant input is not known."
        both = "or a file with both columns."
        if others:
            said = f"{output.name!r} changes over time, and nothing says which column drives it: "
            said += f"{', '.join(others[:20])}."
            both = "or name both columns (--input COL --output COL)."
        said += text
        fix = f"Give the constant input (hysid init FILE --step VALUE), {both}"
        raise InputError("cannot-decide", said, place=table.path, fix=fix)
    options = {"step": value} | ({"input_unit": unit} if unit else {})
    return Choice(None, output, sure, why, options, [])


def _grouped(table: Table, name: str) -> None:
    """Raises `InputError` `thousands-separator` where that is why a column is text."""
    try:
        table.number(name)
    except InputError as fault:
        if fault.code == "thousands-separator":
            raise


def _steps_once(x: np.ndarray) -> bool:
    """Whether a column moves one way, and then stays for more than half of its rows."""
    moves = np.diff(x)
    return bool(
        moves.any() and np.mean(x == x[-1]) > 0.5 and ((moves >= 0).all() or (moves <= 0).all())
    )


def _channels(
    columns: list[Column], inputs: list[str], given: Mapping[str, Any], place: str
) -> Choice:
    by_name, output = {c.name: c for c in columns}, given.get("output")
    if output is None:
        said, fix = "There are several inputs but no output.", "Name the output (--output COL)."
        raise InputError("cannot-decide", said, place=place, fix=fix)
    why = {"input": f"one of {len(inputs)} channels", "output": "given"}
    return Choice(by_name[inputs[0]], by_name[output], "sure", why, {"input": inputs}, [])


def _unknown(seen: Seen, columns: list[Column]) -> Choice:
    """Two columns with unknown names: the rig commanded one, or the loop shows which one lags."""
    given, place = seen.given, seen.table.path
    asked = {given.get("output"), *(given.get("input") or ())} - {None}
    if len(columns) > 2 and not asked and all(c.kind.name != "unknown" for c in columns):
        kinds = ", ".join(dict.fromkeys(c.kind.name for c in columns))
        raise NothingDrivenError(f"its columns are readings ({kinds}) of which none drives another")
    if len(columns) != 2:
        raise _undecided(columns, place)
    a, b = columns
    if b.name in (given.get("input") or ()) or a.name == given.get("output"):
        a, b = b, a
    record = _record(seen, a, b)
    way = loop_direction(record)
    leads = (way < 0) != (correlation(record.input, record.output) < 0)
    why = {"input": "the names do not tell which of the two drives", "output": "the other column"}
    if not asked:
        nameless = a.kind.name == b.kind.name == "unknown"
        theirs, ours = _driven(seen, b, a), _driven(seen, a, b)
        # A switch is held as a command is, and may answer what has a name.
        told = nameless or max(held(a.x), held(b.x)) < STANDS
        if told and (how := theirs or ours):
            a, b = (b, a) if theirs else (a, b)
            why["input"] += f"; {a.name!r} {how}, so the rig commanded it"
            why["output"] = "the response to it"
        elif abs(way) >= CROSSED:
            a, b = (b, a) if leads else (a, b)
            why["input"] += "; with this input the output lags"
            why["output"] = "it lags the input"
    return Choice(a, b, "guess", why, {}, [_said(b.name, a.name)])


def _undecided(columns: list[Column], place: str) -> InputError:
    names = ", ".join(f"{c.name!r} ({c.kind.name})" for c in columns[:20])
    return InputError(
        "cannot-decide",
        f"It is not clear which of these columns is the input and which the output: {names}.",
        place=place,
        fix='Give their exact headers: hysid init FILE --input "COL" --output "COL".',
    )


def _said(input: str, output: str) -> str:
    return f"--input {shell_word(input)} --output {shell_word(output)}"
