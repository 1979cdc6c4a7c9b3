"""Sentences of verdicts, recomputed from the arrays of the fit by other means.

Each reason carries the numbers that it tells. Here they are computed again in NumPy: errors from
predictions and readings, loops from branches on a grid, drifts from cycles against the middle one. A
sentence is false where a number is off by more than its tolerance; those are printed.
"""

import sys
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import identify
from hysteresis import InputError, Note, Record

from .. import _other_rigs as rigs
from .._measure import Row, judged, noted
from ..accuracy import TASKS, data_folder
from .passes import _virtual

WHAT = "sentences of verdicts recomputed from the arrays over every data set at hand and 60 virtual records"
MOST, SHORT = 3000, 64
"""Rows of a measured record, and of each of its sequences at least."""

QUICK: dict[str, Any] = {"noise": "gaussian", "starts": 2}
GRID = (np.arange(64) + 0.5) / 64
Same = Callable[[float, float], bool]


def rows(quick: bool) -> list[Row]:
    """How many sentences are false."""
    checked = false = 0
    for name, record, test, model in _records(quick):
        options = {} if model == "Composition" else QUICK
        try:
            fit = identify.fit(record, model, test=test, **options)
        except InputError as error:
            print(f"  {name}, {model}: {error.code}", file=sys.stderr)
            continue
        for note in map(Note.of, fit.verdict.reasons):
            for key, told, found, same in _again(fit, note):
                checked += 1
                if not same:
                    false += 1
                    said = f"{name}, {model}, {note.code} {key}: told {told:.4g}, found {found:.4g}"
                    print(f"  false: {said}", file=sys.stderr, flush=True)
    return [judged(f"{WHAT}: false ones", false, 0.0), noted("  numbers checked", checked)]


def _records(quick: bool) -> Iterator[tuple[str, Record, Record | None, str]]:
    count = 3 if quick else 60
    foams = [*_virtual(max(1, count // 3))]
    others = [
        (name, rigs.reading_of(rig, rigs.motion(rig), seed))
        for seed in range(3)
        for name, rig in rigs.RIGS.items()
    ][: count - len(foams)]
    for k, (name, record) in enumerate([*foams, *others]):
        train, test = record.split_cycles(2)
        yield f"virtual {name}", train, test, ("Composition", "LinearSponge", "Preisach")[k % 3]
    if quick or not data_folder().exists():
        return
    for k, task in enumerate(TASKS):
        with TemporaryDirectory() as out:
            file = task.file
            path = data_folder() / file if isinstance(file, str) else file(data_folder(), Path(out))
            if not path.exists():
                continue
            records, _ = task.selection.records(task.selection.read(path))
        for value, (train, test) in records.items():
            if not train.channels and not train.conditions:
                few = [None if one is None else _thinned(one) for one in (train, test)]
                assert few[0] is not None
                yield f"{task.what} {value}", few[0], few[1], ("LinearSponge", "Preisach")[k % 2]


def _thinned(record: Record) -> Record:
    """Every so many rows of each sequence, and every so many sequences where they are short, as a record of
    their own."""
    parts = [rows for _, rows in record.sequences()]
    shortest = min(rows.stop - rows.start for rows in parts)
    step = max(min(-(-len(record) // MOST), shortest // SHORT), 1)
    kept = parts[:: -(-len(record) // (step * MOST))]
    each = [np.arange(one.start, one.stop, step) for one in kept]
    rows = np.concatenate(each)
    labels = np.repeat([str(k) for k in range(len(each))], [len(one) for one in each])
    return Record.from_arrays(
        record.input[rows], record.output[rows], None if record.time is None else record.time[rows],
        labels, mask=record.mask[rows], nan="omit", input_unit=record.input_unit,
        output_unit=record.output_unit,
    )  # fmt: skip


def _again(fit: identify.FitResult, note: Note) -> Iterator[tuple[str, float, float, bool]]:
    """The numbers of a reason: name, as told, as found here, and whether they are the same."""
    own = _ours(fit, note)
    for key, (found, tolerance) in own.items():
        told = note.values.get(key, float("nan"))
        yield key, told, found, bool(abs(told - found) <= tolerance)


def _ours(fit: identify.FitResult, note: Note) -> dict[str, tuple[float, float]]:
    train, used = fit.train, fit.used
    test = train if fit.test is None else fit.test
    judged_rows = used if fit.test is None else test.mask
    error = (fit.predict(test) - test.output)[judged_rows]
    fitted = (fit.predict(train) - train.output)[used]
    rmse = _rms(error)
    match note.code:
        case "error":
            percent = 100 * rmse / np.ptp(test.output[judged_rows])
            return _close(rmse=rmse, percent=percent, largest=float(np.abs(error).max()))
        case "baseline-better" | "best-baseline" if fit.test is not None:
            found = _close(of_fit=rmse)
            simple = {"constant": 0, "straight line": 1}.get(note.values["baseline"])
            if simple is not None:
                rows = train.mask & np.isfinite(train.output)
                line = np.polyfit(train.input[rows], train.output[rows], simple)
                off = np.polyval(line, test.input) - test.output
                found |= _close(rmse=_rms(off[judged_rows]))
            told = note.values["rmse"] - rmse  # more than the fit, or less: the sentence says which
            return found | {"more": (told, 0.02 * abs(told) + 1e-9 * rmse)}
        case "worse-than-trained":
            return _close(times=rmse / _rms(fitted), held_out=rmse, trained=_rms(fitted))
        case "beyond":
            u, (low, high) = train.input[train.mask], (0.0, 0.0)
            low, high = u.min() - 0.01 * np.ptp(u), u.max() + 0.01 * np.ptp(u)
            out = ((test.input < low) | (test.input > high))[judged_rows]
            return {"rows": (int(out.sum()), 0), "rmse": (_rms(error[out]), 1e-9 + 1e-6 * rmse)}
        case "loops-left":
            # Two ways to close a loop differ by some per cent of the wider one, and by half of what a line
            # for the drift takes off: creep that decays is none.
            values = (train.output, fit.residuals)
            width, left = (_width(train, one, used, True) for one in values)
            open_width, open_left = (_width(train, one, used, False) for one in values)
            share, off = left / width, abs(open_left / open_width - left / width)
            return {
                "width": (width, 0.15 * width + 0.5 * abs(open_width - width)),
                "share": (share, 0.15 + 0.5 * off),
            }
        case "settling":
            return {"rows": (int((train.mask & ~used).sum()), 0)}
        case "drift":
            rate, doubt = _rate(train)
            return {"rate": (rate, 3 * doubt + 0.1 * abs(rate))}
        case "growth":
            cycles = [_rms(error[test.cycle[judged_rows] == c]) for c in _cycles(test, judged_rows)]
            third = len(cycles) // 3
            return {
                "first": (_rms(np.array(cycles[:third])), 0.02 * rmse),
                "last": (_rms(np.array(cycles[-third:])), 0.02 * rmse),
            }
        case "energy-created":
            taken = _energy(train)
            return {"energy": (taken, 0.1 * abs(taken))}
        case "correlated-residuals":
            return {"count": (note.values["rows"] / note.values["samples"], 1.0)}
    return {}


def _close(**values: float) -> dict[str, tuple[float, float]]:
    return {key: (value, 1e-6 * abs(value)) for key, value in values.items()}


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x)))) if len(x) else float("nan")


def _cycles(record: Record, counted: np.ndarray) -> list[int]:
    """Numbers of the cycles of which most rows count."""
    numbers = np.unique(record.cycle[counted & (record.cycle > 0)])
    whole = [record.cycle == number for number in numbers]
    return [
        int(c) for c, own in zip(numbers, whole, strict=True) if 2 * own[counted].sum() > own.sum()
    ]


def _legs(
    record: Record, rows: np.ndarray, values: np.ndarray, level: np.ndarray
) -> np.ndarray | None:
    """Both branches of some rows, read at some inputs."""
    found = []
    for sign in (1, -1):
        leg = rows[record.branch[rows] == sign]
        if len(leg) < 2:
            return None
        leg = leg[np.argsort(record.input[leg], kind="stable")]
        found.append(np.interp(level, record.input[leg], values[leg]))
    return np.array(found)


def _width(record: Record, values: np.ndarray, used: np.ndarray, closed: bool) -> float:
    """Mean distance of the branches of each cycle; where `closed`, a steady drift is taken out."""
    total = span = 0.0
    for _, where in record.sequences():
        here = np.arange(where.start, where.stop)
        here = here[used[here] & np.isfinite(values[here]) & (record.cycle[here] > 0)]
        drift = _drift(record, here, values) if closed else 0.0
        steady = values - drift * np.arange(len(values))
        for number in np.unique(record.cycle[here]):
            rows = here[record.cycle[here] == number]
            legs = [record.input[rows[record.branch[rows] == sign]] for sign in (1, -1)]
            if min(map(len, legs)) < 2:
                continue
            low, high = max(x.min() for x in legs), min(x.max() for x in legs)
            read = _legs(record, rows, steady, low + (high - low) * GRID)
            if read is not None and high > low:
                total += float(np.abs(read[0] - read[1]).mean()) * (high - low)
                span += high - low
    return total / span if span else float("nan")


def _drift(record: Record, here: np.ndarray, values: np.ndarray) -> float:
    """What a branch moves a row until the next cycle's, half of them more; 0 of fewer than three cycles."""
    each = [here[record.cycle[here] == c] for c in np.unique(record.cycle[here])]
    moves = []
    for one, other in pairwise(each):
        low = max(record.input[rows].min() for rows in (one, other))
        high = min(record.input[rows].max() for rows in (one, other))
        level = low + (high - low) * GRID
        first, second = (_legs(record, rows, values, level) for rows in (one, other))
        if high > low and first is not None and second is not None:
            moves.append(float((second - first).mean()) / (other.mean() - one.mean()))
    return float(np.median(moves)) if len(moves) > 1 else 0.0


def _rate(record: Record) -> tuple[float, float]:
    """Change of the output a cycle over the later half, of cycles against the middle one; its deviation."""
    best: tuple[float, float] = float("nan"), float("nan")
    most = 0
    for _, where in record.sequences():
        here = np.arange(where.start, where.stop)
        here = here[record.mask[here] & np.isfinite(record.output[here]) & (record.cycle[here] > 0)]
        each = [here[record.cycle[here] == c] for c in np.unique(record.cycle[here])]
        # A cycle of less than half the widest one's range, or of one branch, is none.
        ranges = [float(np.ptp(record.input[rows])) for rows in each]
        branches = [[np.sum(record.branch[rows] == sign) for sign in (1, -1)] for rows in each]
        each = [
            rows for rows, span, legs in zip(each, ranges, branches, strict=True)
            if 2 * span > max(ranges) and min(legs) >= 2
        ]  # fmt: skip
        if len(each) <= max(most, 2):
            continue
        low = max(record.input[rows].min() for rows in each)
        high = min(record.input[rows].max() for rows in each)
        level = low + (high - low) * GRID
        table = np.array([_legs(record, rows, record.output, level) for rows in each])
        most = len(each)
        apart = (table - table[len(table) // 2]).mean((1, 2))
        later = apart[len(apart) // 2 :] if len(apart) >= 8 else apart
        fit, covariance = np.polyfit(np.arange(len(later)), later, 1, cov=True)
        best = float(fit[0]), float(np.sqrt(covariance[0, 0]))
    return best


def _energy(record: Record) -> float:
    """Work a loop, counter-clockwise: the area of the polygon of each cycle's readings."""
    areas = []
    for number in _cycles(record, record.mask):
        rows = np.flatnonzero(record.cycle == number)
        u, y = record.input[rows], record.output[rows]
        areas.append(0.5 * float(np.sum(u * np.roll(y, -1) - np.roll(u, -1) * y)))
    area = float(np.mean(areas))
    # Counter-clockwise force over displacement gives energy.
    return -area if record.output_unit in ("N", "kN", "mN") else area
