"""What a record holds and what it is fit for: summary, excitation, warnings."""

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, NamedTuple, TypeVar

import numpy as np

from .._errors import InputError
from .._escape import shell_word
from .._format import ends, number_of, quantity
from .._verdict import Note, warning
from ._abstract_record import AbstractRecord
from ._arrays import FEWEST, in_rows, marks, pieces
from ._change import change_warnings
from ._cycles import LoopSums, default_dead_band, loop_sums, noise_level, turning_points
from ._units import UNITS
from ._zero import comparable, lost_contact, zero_jumps

_Found = TypeVar("_Found")

WIDER = 3.0
"""Times the noise by which the branches of a loop are apart: noise alone makes 1.1."""

CROSSED = 0.5
"""Of a loop's area, what turns one way more than the other, below which it has no direction."""

MANY = 8
"""Samples at a limit that are too many for a peak."""

LEAPS, GOES_ON = 0.8, 0.1
"""Part of its range by which a column leaps that turns over, and by which the other one moves meanwhile."""

FURTHER = 2
"""Times the way of the input over which the output stays as it is elsewhere, as behind a backlash."""


class Clipped(NamedTuple):
    """A series stuck at its largest or smallest value: which, where, and that value."""

    role: str
    rows: np.ndarray
    limit: float


def once(function: Callable[[AbstractRecord], _Found]) -> Callable[[AbstractRecord], _Found]:
    """What takes long and several checks ask for: it is kept with the record."""

    @wraps(function)
    def kept(record: AbstractRecord) -> _Found:
        results, key = vars(record), f"_{function.__name__}"
        if key not in results:
            results[key] = function(record)
        return results[key]

    return kept


def loop_direction(record: AbstractRecord) -> float:
    """Which way the loops turn, in [-1, 1]: +1 counter-clockwise (the output lags), -1 clockwise.

    `sum of int D du / sum of int |D| du`, D(u) = y_unloading(u) - y_loading(u)

    over the loops of `loops_of`. Crossed loops fall between the bounds; 0 where no loop is wider than the
    noise.

    **Example:**

        >>> round(hysteresis.internal.loop_direction(record), 2)
        1.0
    """
    loops = loops_of(record)
    least = WIDER * noise_over_input(record, record.mask)
    return loops.net / loops.total if loops.total and loops.width > least else 0.0


@once
def clipped(record: AbstractRecord) -> list[Clipped]:
    """Where input or output is stuck at a limit while the other one moves.

    Stuck: at least 1 % of the rows and eight of them. The output is clipped where the input moves by
    2 % of its range, and twice as far as where the output stays as it is elsewhere, in steps of an encoder
    or behind a backlash; the input where, in one run of rows, the output goes 2 % of its range beyond
    both ends and comes back: in a hold it creeps one way, and single readings err. Zero and the value of
    the first row are the rest, not a limit.
    """
    u, y, found = record.input, record.output, []
    for role, x in (("output", y), ("input", u)):
        for limit in (np.nanmax(x), np.nanmin(x)) if np.isfinite(x).any() else ():
            rows = np.flatnonzero(x == limit)
            if limit in (0.0, x[0]) or len(rows) < max(MANY, 0.01 * len(x)):
                continue
            if role == "output":
                if not record.mask[rows].any():  # they are excluded
                    continue
                at, elsewhere = _ways_at_rest(record, limit)
                stuck = np.ptp(u[rows]) > 0.02 * np.ptp(u) and at > FURTHER * elsewhere
            else:
                least = max(0.02 * np.nanmax(y) - 0.02 * np.nanmin(y), 8 * noise_level(y))
                # One row or two have no middle that goes beyond their ends.
                runs = (run for run in _runs(record, rows) if len(run) > 2)
                stuck = any(_bulge(y[run]) > least for run in runs)
            if stuck:
                found.append(Clipped(role, rows, float(limit)))
    return found


def suspicions(record: AbstractRecord) -> list[Note]:
    """What is probably wrong with the readings, each a sentence with its fix and its code."""
    found = [note for note in record.history if note.code == "other-unit"]
    if marked := _marked(record):  # beside which zeros jump, and loops turn the other way
        return [*found, *marked]
    for role, rows, limit in clipped(record):
        runs = _runs(record, rows)
        longest = max(runs, key=len)
        others = f" and {len(runs) - 1} more runs" if len(runs) > 1 else ""
        other = "input" if role == "output" else "output"
        at = quantity(limit, getattr(record, f"{role}_unit"))
        mask = _missing_at(record, role, [limit], runs)
        mend = (
            f"mask or censor (--{mask}), or measure with a wider range"
            if role == "output"
            else "measure with a wider range, or leave those rows' cycles out (--where)"
        )
        said = (
            f"{len(rows) / len(record):.1%} of the {role} at {at}: clipped, {record.lines(longest)}"
            f"{others} while the {other} moves; {mend}."
        )
        found.append(warning("saturation", said))
    return [*_turned_over(record), *found, *_zeros(record), *_created_energy(record)]


def _missing_at(
    record: AbstractRecord, role: str, values: list[float], runs: list[np.ndarray]
) -> str:
    """The option that reads values of the input or the output as missing, without its dashes."""
    # A word for missing values is one in every column that is read.
    columns = {"input": record.input, "output": record.output, "time": record.time}
    if any(
        x is not None and np.isin(x, values).any() for name, x in columns.items() if name != role
    ):
        return f"exclude-lines {_ranges(record, runs)}"
    words = ",".join(f"{value:.15g}" for value in values)
    return f"na-values {words} --nan {'omit' if role == 'output' else 'interpolate'}"


def _ranges(record: AbstractRecord, runs: Sequence[Any]) -> str:
    """The lines of runs of rows, each from its first to its last, as options take them."""
    return ",".join("{}-{}".format(*np.sort(record.line[[run[0], run[-1]]])) for run in runs)


def _marked(record: AbstractRecord) -> list[Note]:
    """Numbers in place of readings that are missing, and spikes."""
    found = []
    for role in ("input", "output"):
        x = getattr(record, role)
        for values in [[one] for one in marks(x[record.mask])] or _spikes(record, x):
            rows = np.flatnonzero(np.isin(x, values) & record.mask)
            at = ", ".join(quantity(one, getattr(record, f"{role}_unit")) for one in values)
            option = _missing_at(record, role, values, _runs(record, rows))
            mend = f" If so, those are not readings (--{option})." if record.source else ""
            said = (
                f"The {role} is {at} in {number_of(len(rows), 'row')}, {record.lines(rows)}, farther from"
                " all others than these lie apart: a spike, or what the rig writes where a reading is"
                f" missing?{mend}"
            )
            found.append(warning("missing-mark", said, {"role": role, "value": values[0]}))
    return found


def _spikes(record: AbstractRecord, x: np.ndarray) -> list[list[float]]:
    """The values of single rows, at most eight, farther from all others than these lie apart, or nothing.
    A pulse has more rows, and a sequence may begin at rest."""
    at = np.flatnonzero(record.mask & np.isfinite(x))
    at = at[np.argsort(-np.abs(x[at] - np.median(x[at])))] if len(at) > FEWEST else at[:0]
    for n in range(FEWEST, 0, -1) if len(at) else ():
        rows, others = at[:n], x[at[n:]]
        beyond = np.maximum(others.min() - x[rows], x[rows] - others.max()) > np.ptp(others)
        alone = np.union1d(rows, record.starts)
        apart = len(alone) == n + len(record.starts) and np.diff(alone).min() > 1
        if beyond.all() and apart and len(np.unique(others)) >= FEWEST:
            return [np.unique(x[rows]).tolist()]
    return []


def _turned_over(record: AbstractRecord) -> list[Note]:
    """A counter or an angle that turns over: it leaps back by its range, goes on the same way before and
    behind, and the other column does not leap."""
    found, within = [], np.ones(max(len(record) - 1, 0), bool)
    within[record.starts[1:] - 1] = False
    for role, other in (("input", "output"), ("output", "input")):
        x, y = getattr(record, role), getattr(record, other)
        if len(x) < MANY or not np.isfinite(x).all() or not np.isfinite(y).any():
            continue
        (at,) = np.nonzero(within & (np.abs(step := np.diff(x)) > LEAPS * np.ptp(x)))
        at = at[(at > 0) & (at < len(step) - 1)]
        both = np.sign(step[at])[:, None] * step[at[:, None] + [-1, 1]] < -MANY * noise_level(x)
        smooth = ~(np.abs(np.diff(y)[at]) > GOES_ON * (np.nanmax(y) - np.nanmin(y)))
        turns = both.all(1) & smooth
        if turns.sum() < 2 or turns.mean() <= 0.5:  # once, a specimen may have snapped
            continue
        period = float(np.median(np.abs(step[at])))
        unit = getattr(record, f"{role}_unit")
        said = (
            f"The {role} leaps by {quantity(period, unit)}, nearly its whole range, at"
            f" {record.place(int(at[0]) + 1)} and {number_of(len(at) - 1, 'more row')}, and the {other}"
            " does not leap: a counter or an angle that turns over? Unwrap it before the fit, as"
            " numpy.unwrap(x, period=...) does."
        )
        found.append(warning("turned-over", said, {"leaps": len(at), "size": period}))
    return found


def _zeros(record: AbstractRecord) -> list[Note]:
    """One note on the jumps of the zero, and one on the rows without contact."""
    found, unit = [], record.output_unit
    lost = lost_contact(record)
    jumps = zero_jumps(record, lost)
    if jumps:
        each = [f"{quantity(size, unit)} at {record.place(row)}" for row, size in jumps]
        more = f", and {len(each) - 3} more times" if each[3:] else ""
        option = ",".join(f"{record.line[row]}:{size:.4g}" for row, size in jumps)
        mend = f"--rezero {option} subtracts" if record.source else "subtract"
        said = (
            f"The zero of the output jumps by {', by '.join(each[:3])}{more}, and the input does not jump"
            f" there. If that is a tare, {mend} it from the rows behind; or fit one side alone"
            " (--exclude-lines FIRST-LAST)."
        )
        values = [{"line": int(record.line[row]), "size": size} for row, size in jumps]
        found.append(warning("zero-jump", said, {"jumps": values}))
    if lost:
        each = [record.lines(np.array([one.first, one.last])) for one in lost]
        more = f" and {len(each) - 3} more stretches" if each[3:] else ""
        first, last = record.line[[lost[0].first, lost[0].last]].tolist()
        option = _ranges(record, [(one.first, one.last) for one in lost])
        said = (
            f"The output stays at {quantity(lost[0].zero, unit)} in {', '.join(each[:3])}{more}, from"
            f" {record.place(lost[0].first)} on, while the input moves where it reads more elsewhere. If"
            f" the contact was lost, leave those rows out (--exclude-lines {option})."
        )
        values = {"first": first, "last": last, "zero": lost[0].zero, "stretches": len(lost)}
        found.append(warning("lost-contact", said, values))
    return found


def _created_energy(record: AbstractRecord) -> list[Note]:
    """Loops of force over displacement that give more energy than they take."""
    units = record.input_unit, record.output_unit
    kinds = [[kind for kind in ("displacement", "force") if one in UNITS[kind]] for one in units]
    to_force = kinds == [["displacement"], ["force"]]
    if not to_force and kinds != [["force"], ["displacement"]]:
        return []
    u, y = in_rows(comparable(record), record.input, record.output)
    if not (len(u) and np.ptp(u) and np.ptp(y)):
        return []
    loops = loops_of(record)
    # Force over displacement takes energy clockwise.
    taken = (-loops.net if to_force else loops.net) / max(loops.count, 1)
    # Where loops are thin or crossed a small lag between the channels turns them.
    if taken > -0.01 * np.ptp(u) * np.ptp(y) or abs(loops.net) < CROSSED * loops.total:
        return []
    cause, mend = "Columns swapped, or a lag between them", "exchange --input and --output"
    if correlation(record) < 0:
        cause = "The sign of one column is turned"
        mend = f"turn it (--turn {shell_word(record.output_name)})"
    force, length = units[::-1] if to_force else units
    said = (
        f"Loops create energy ({taken:.3g} {force} {length} a loop): no specimen does. {cause}? If"
        f" so, {mend}."
    )
    return [warning("energy-created", said, {"energy": taken, "loops": loops.count})]


@once
def correlation(record: AbstractRecord) -> float:
    """Of input and output, in [-1, 1]; 0 where one of them is constant."""
    u, y = in_rows(np.isfinite(record.output), record.input, record.output)
    if not (len(u) and np.ptp(u) and np.ptp(y)):
        return 0.0
    off, of_both = np.array([[u.mean()], [y.mean()]]), np.zeros((2, 2))
    for rows in pieces(len(u)):
        both = np.stack([u[rows], y[rows]]) - off
        of_both += both @ both.T
    return float(of_both[0, 1] / np.sqrt(of_both[0, 0]) / np.sqrt(of_both[1, 1]))


@once
def loops_of(record: AbstractRecord) -> LoopSums:
    """The sums over the loops of all sequences, in the rows that count."""
    return loop_sums(record, record.output, record.mask)


def noise_over_input(record: AbstractRecord, used: np.ndarray) -> float:
    """Standard deviation from row to row of the output at an input that is read with noise as well:

    `hypot(noise_level(y), noise_level(u) range(y) / range(u))`, the median of all sequences
    """
    used = used & np.isfinite(record.output)
    each = [in_rows(used[s], record.input[s], record.output[s]) for _, s in record.sequences()]
    found = [
        float(np.hypot(noise_level(y), noise_level(u) * np.ptp(y) / (np.ptp(u) or np.inf)))
        for u, y in each
        if len(y)
    ]
    return float(np.median(found or [0.0]))


def _runs(record: AbstractRecord, rows: np.ndarray) -> list[np.ndarray]:
    """Rows in pieces that follow each other in one sequence."""
    cut = (np.diff(rows) > 1) | np.isin(rows[1:], record.starts)
    return np.split(rows, np.flatnonzero(cut) + 1)


def _ways_at_rest(record: AbstractRecord, limit: float) -> tuple[float, float]:
    """How far the input moves at most while the output stays at `limit`, and while it stays elsewhere."""
    u, y = record.input, record.output
    rests = np.append(y[1:] == y[:-1], False)  # where the next row reads the same
    rests[record.starts[1:] - 1] = False
    ends = np.flatnonzero(np.diff(rests, prepend=False))  # the first and the last row of each rest
    cut = ends + np.arange(len(ends)) % 2
    cut = cut[cut < len(u)]
    way = (np.maximum.reduceat(u, cut) - np.minimum.reduceat(u, cut))[::2]
    at = y[ends[::2]] == limit
    return float(way[at].max(initial=0.0)), float(way[~at].max(initial=0.0))


def _bulge(y: np.ndarray) -> float:
    """How far a quarter of a series lies beyond both its ends, on one side."""
    ends = y[[0, -1]]
    low, high = np.quantile(y, [0.25, 0.75])
    return float(max(high - ends.max(), ends.min() - low))


def check_identifiable(record: AbstractRecord, n_parameters: int | None = None) -> list[Note]:
    """Can these rows tell a model's parameters? Returns warnings, each with its `code`, in which it ends.

    **Raises:** `InputError` `too-few-rows`, `constant-input`, `constant-output`, `no-excitation`.

    **Example:**

        >>> hysteresis.internal.check_identifiable(record, n_parameters=3)
        []
    """
    u, unit, place = record.input, record.input_unit, record.source
    turns = check_rows(record, n_parameters)
    span, noise = float(np.ptp(u)) if len(u) else 0.0, _spread(record, "input")["noise"]
    if span == 0:
        problem = f"Input {record.input_name!r} is {quantity(u[0], unit)} in every row."
        mend = "choose another column (--input COL), or drive the rig."
        raise InputError("constant-input", problem, place=place, fix=mend)
    (counted,) = in_rows(record.mask & np.isfinite(record.output), record.output)
    if not np.ptp(counted):
        at = quantity(counted[0], record.output_unit)
        problem = f"Output {record.output_name!r} is {at} in every row; nothing to identify."
        mend = "choose another column (--output COL), or look at the sensor."
        raise InputError("constant-output", problem, place=place, cause="a dead channel?", fix=mend)
    # Steps drawn anew at every row look like noise, but the output follows them.
    if span < 10 * noise and abs(correlation(record)) < 0.5:
        problem = f"Input range {quantity(span, unit)} is about the noise; nothing to identify."
        raise InputError("no-excitation", problem, place=place, fix="drive the rig further.")
    found = []
    if all(np.ptp(record.branch[s]) == 0 for _, s in record.sequences()) and turns <= 1:
        way, other = ("rises", "un") if record.branch[0] > 0 else ("falls", "")
        said = (
            f"Input only {way}: no {other}loading branch, so nothing tells hysteresis from a curve; "
            "measure the way back."
        )
        found.append(warning("one-way-input", said))
    others = suspicions(record)
    # A zero that jumps moves, too, and so does one that is read for a while; either is told first.
    zeros = [note for note in others if note.code in ("missing-mark", "zero-jump", "lost-contact")]
    first = zeros or change_warnings(record)
    found = [*first, *found, *(note for note in others if note not in first)]
    single = [x for x, s in record.sequences() if s.stop - s.start < 2]
    if single:
        said = f"{number_of(len(single), 'sequence')} of one row, first {single[0]!r}."
        found.append(warning("short-sequence", said))
    return found


def check_rows(record: AbstractRecord, n_parameters: int | None = None) -> float:
    """Are there rows enough to tell so many parameters? Returns the number of cycles of the input.

    **Raises:** `InputError` `too-few-rows`.
    """
    rows, needed = int(record.mask.sum()), n_parameters or 2
    turns = sum(_turns(record.input[s]) for _, s in record.sequences())
    least = max(8, needed + 1)
    if rows < least or (rows < 10 * needed and turns < 1):
        asked = f"{n_parameters} parameters, " if n_parameters else ""
        wanted = f"{least}" if rows < least else f"one cycle, or {10 * needed}"
        cycles = np.floor(100 * turns) / 100  # 0.98 is not one
        problem = f"{rows} samples, {asked}{cycles:g} cycles; need at least {wanted} samples."
        raise InputError(
            "too-few-rows", problem, place=record.source, fix="use more rows, or fix parameters."
        )
    return turns


@once
def summary(record: AbstractRecord) -> dict[str, Any]:
    """Rows, sequences, cycles, ranges, noise, clock, saturation and loop direction."""
    stuck = sum(len(found.rows) for found in clipped(record) if found.role == "output")
    return {
        "source": record.source,
        "sha256": record.sha256,
        "rows": len(record),
        "rows_used": int(record.mask.sum()),
        "sequences": len(record.labels),
        "cycles": record.n_cycles,
        "input": _spread(record, "input"),
        "output": _spread(record, "output") | {"saturated": stuck / max(len(record), 1)},
        "conditions": [
            {"name": name, "unit": unit, "min": float(x.min()), "max": float(x.max())}
            for name, unit in record.conditions.items()
            if (x := record.columns[name]).size
        ],
        "dt": _clock(record),
        "loop_direction": loop_direction(record),
    }


def turn_in_words(record: AbstractRecord) -> str:
    """Which way the loops of a record turn, and whether the output lags or leads its input."""
    way, falls = loop_direction(record), correlation(record) < 0
    if abs(way) < CROSSED:
        return "its parts turn both ways"
    turn = "counter-clockwise" if way > 0 else "clockwise"
    # Where the output falls with the input, lagging loops turn clockwise.
    return turn + (": the output lags" if (way > 0) != falls else ": the output leads")


def describe(record: AbstractRecord, loop: str | None = None) -> str:
    """The summary for a reader, and the record's history; `loop` replaces the line about the loops.

    Moduli over frequency have no noise from row to row, and their outputs are storage and loss.
    """
    s, is_sweep = summary(record), loop is not None and record.time is None
    way, turn = s["loop_direction"], turn_in_words(record)
    lines = [
        f"{s['source'] or 'arrays'}: {s['rows']} rows ({s['rows_used']} count), "
        f"{number_of(s['sequences'], 'sequence')}, {number_of(s['cycles'], 'complete cycle')}"
    ]
    for role in ("input", "output"):
        x, unit = s[role], s[role]["unit"]
        noise = "" if is_sweep else f", noise {quantity(x['noise'], unit)}"
        name = "moduli" if is_sweep and role == "output" else x["name"]
        lines.append(f"{role:6} {name}: {ends(x['min'], x['max'], unit)}{noise}")
    for x in s["conditions"]:
        lines.append(f"condition {x['name']}: {ends(x['min'], x['max'], x['unit'])}")
    if s["dt"]:
        low, high = (f"{s['dt'][k]:.4g}" for k in ("min", "max"))
        usual = quantity(s["dt"]["median"], record.time_unit)
        lines.append(f"dt     {low} to {high}, median {usual}")
    if s["output"]["saturated"]:
        lines.append(f"clipped: {s['output']['saturated']:.1%} of the output")
    if loop is None:
        loop = f"loop   {way:+.2f} ({turn})" if way else "loop   none wider than the noise"
    lines.append(loop)
    return "\n".join([*lines, *record.history])


def _turns(u: np.ndarray) -> float:
    """Path length over twice the range: 1 for one loop, 1/2 for one ramp."""
    path = np.abs(np.diff(u[turning_points(u, default_dead_band(u))])).sum()
    return float(path / (2 * np.ptp(u))) if path else 0.0


def _clock(record: AbstractRecord) -> dict[str, Any] | None:
    """The steps of time within sequences, None where there is none."""
    if record.time is None:
        return None
    steps = np.diff(record.time)
    if len(record.starts) > 1:
        steps = np.delete(steps, record.starts[1:] - 1)
    if not steps.size:
        return None
    low, mid, high = np.quantile(steps, [0, 0.5, 1], overwrite_input=True).tolist()
    return {"min": low, "median": mid, "max": high, "unit": record.time_unit}


def _spread(record: AbstractRecord, role: str) -> dict[str, Any]:
    x = getattr(record, role)
    good = np.isfinite(x)
    (known,) = in_rows(good, x)
    low, high = (float(known.min()), float(known.max())) if len(known) else (np.nan, np.nan)
    noise = float(np.median([noise_level(*in_rows(good[s], x[s])) for _, s in record.sequences()]))
    names = {"name": getattr(record, f"{role}_name"), "unit": getattr(record, f"{role}_unit")}
    return names | {"min": low, "max": high, "noise": noise}
