"""What a fit says of the specimen: stiffness, loop width, energy, relaxation time, softening, zero drift.

The parts of a composition and the weights of a grid are not separable, so that their numbers mean little
one by one. What the model does over the motion that it was trained on is determined, and can be laid beside
the measured loops.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import Record
from hysteresis.records._cycles import loop_sums

from ..records._loads import kind_of_units

FULL = 0.95
"""Of the widest cycle's range of inputs: cycles that pass so much of it are compared."""

PACE = 1.25
"""Times the shortest of these cycles that the longest may take: at another rate, or after another rest,
creep moves stiffness and zero as well."""

COUNTED = 0.9
"""Of a cycle's rows that have to count."""

END = 0.02
"""Of a cycle's range of inputs: rows so close to an end belong to it."""

LEVELS, MARGIN = 33, 0.05
"""Of the input, at which the middle between the branches is taken, and the part left out at either end."""

HELD, HELD_ROWS = 0.02, 8
"""A hold: so many rows in which the input stays within this part of its range."""

LEVEL, SCATTER = 1e-3, 6.0
"""At its level an input is this close, of its range, or this many median deviations."""

RESTS = 0.05
"""Of the way that the input goes in the time of a hold where it moves: more is a slow turn."""

ALIKE = 0.5
"""Of the largest change in a hold: holds that change by so much are compared."""

SURE = 3.0
"""Times the error of the mean by which a change has to exceed it, to have a time."""

Rows = Float[np.ndarray, " rows"]


class Characteristic(NamedTuple):
    """A figure of the specimen, from the model's output over the fitted rows.

    - `value`: None where the record does not tell it; `reason` then says why.
    - `error`: how far the model's figure is from the measured one, rms over the same cycles or holds; of a
      change rms over all pairs of cycles.
    - `basis`: which cycles or holds; "" without a value.
    """

    name: str
    value: float | None
    error: float | None
    unit: str
    basis: str = ""
    reason: str = ""


class _Cycle(NamedTuple):
    """Ends of the input, and figures of the model and of the readings: (2,) each."""

    sequence: int
    duration: float
    low: float
    high: float
    slope: np.ndarray
    width: np.ndarray
    area: np.ndarray
    foot: np.ndarray


def characteristics(
    record: Record, residuals: Float[np.ndarray, " samples"], used: Bool[np.ndarray, " samples"]
) -> tuple[Characteristic, ...]:
    """The figures of a record and of a model that leaves these residuals on its `used` rows.

    - stiffness: of the line through the middle of the loop, load over deformation where the units tell
      them apart; otherwise the slope, output over input.
    - loop width: mean distance of the branches. energy a cycle: the loop's area.
    - softening: change of the stiffness from the first of these cycles to the last.
    - zero drift: change of the output at the cycle's lowest input, likewise.
    - relaxation time: mean time of the change in holds, int (y - y_end) dt / (y_start - y_end).
    """
    counted = used & np.isfinite(residuals) & np.isfinite(record.output)
    outputs = np.stack([record.output + residuals, record.output])
    found = _cycles(record, outputs, counted)
    widest = max((c.high - c.low for c in found), default=0.0)
    full = [c for c in found if c.high - c.low >= FULL * widest]
    return (*_of_cycles(record, full), _relaxation(record, outputs, counted))


def _of_cycles(record: Record, full: Sequence[_Cycle]) -> tuple[Characteristic, ...]:
    kind = kind_of_units(record)
    load, deformation = record.output_unit, record.input_unit
    if kind == "creep":
        load, deformation = deformation, load
    stiffness = "slope" if kind is None else "stiffness"
    energy = "loop area" if kind is None else "energy a cycle"
    units = {
        stiffness: _over(load, deformation),
        "loop width": record.output_unit,
        energy: _times(load, deformation),
        "softening": "percent",
        "zero drift": record.output_unit,
    }
    if not full:
        why = "no complete cycle counts"
        return tuple(
            Characteristic(name, None, None, unit, "", why) for name, unit in units.items()
        )
    basis = _count(len(full), "cycle") + _between(full, record.input_unit)
    slopes = np.array([c.slope for c in full])
    stiff = 1 / slopes if kind == "creep" else slopes
    found = [
        _mean(name, values, units[name], basis)
        for name, values in (
            (stiffness, stiff),
            ("loop width", np.array([c.width for c in full])),
            (energy, np.array([c.area for c in full])),
        )
    ]
    last = full[-1].sequence
    chain = [k for k, c in enumerate(full) if c.sequence == last]
    why = "one complete cycle in a row" if len(chain) < 2 else ""
    times = [full[k].duration for k in chain]
    if max(times) > PACE * min(times):
        why = "these cycles differ in rate or rest"
    if record.conditions:
        why = f"{', '.join(record.conditions)} may change between cycles"
    if why:
        later = [Characteristic(name, None, None, units[name], "", why) for name in (*units,)[3:]]
    else:
        a = chain[0]
        basis = f"from the first to the last of {_count(len(chain), 'cycle')}"
        feet = np.array([c.foot for c in full])
        later = [
            _change("softening", -100 * stiff[chain] / stiff[a, 0], "percent", basis),
            _change("zero drift", feet[chain], units["zero drift"], basis),
        ]
    return (*found, *later)


def _cycles(
    record: Record, outputs: Float[np.ndarray, "2 samples"], counted: Bool[np.ndarray, " samples"]
) -> list[_Cycle]:
    found = []
    for number, (_, where) in enumerate(record.sequences()):
        cycle = record.cycle[where]
        edges = np.flatnonzero(np.diff(cycle, prepend=0, append=0))
        for first, end in pairwise(edges.tolist()):
            if not cycle[first]:
                continue
            # The row before belongs to the loop: it is where the last cycle ended.
            rows = where.start + np.arange(max(first - 1, 0), end)
            if counted[rows].mean() < COUNTED or counted[rows].sum() < HELD_ROWS:
                continue
            rows = rows[counted[rows]]
            u, y = record.input[rows], outputs[:, rows]
            t = rows if record.time is None else record.time[rows]
            if (one := _cycle(number, float(np.ptp(t)), u, y)) is not None:
                found.append(one)
    return found


def _cycle(number: int, duration: float, u: Rows, y: Float[np.ndarray, "2 rows"]) -> _Cycle | None:
    """None where the two legs pass no input alike."""
    low, high = float(u.min()), float(u.max())
    turn = int(np.argmax(np.abs(u - u[0])))
    legs = [
        leg[np.argsort(u[leg], kind="stable")]
        for leg in (np.arange(turn + 1), np.arange(turn, len(u)))
    ]
    ends = max(u[leg[0]] for leg in legs), min(u[leg[-1]] for leg in legs)
    if not ends[0] < ends[1]:
        return None
    # Close to its ends a branch is still that of the leg before.
    levels = ends[0] + (ends[1] - ends[0]) * np.linspace(MARGIN, 1 - MARGIN, LEVELS)
    middle = np.mean([[np.interp(levels, u[leg], one[leg]) for one in y] for leg in legs], axis=0)
    x = levels - levels.mean()
    slope = middle @ x / (x @ x)
    bottom = u <= low + END * (high - low)
    sums = [loop_sums(u, one, np.ones(len(u), bool)) for one in y]
    area = np.array([abs(one.net) for one in sums])
    common = np.array([one.span for one in sums])
    width = np.divide(area, common, out=np.zeros(2), where=common > 0)
    # The last time at the lowest input: a rest there belongs to it.
    at = np.flatnonzero(bottom)
    at = at[at > at[-1] - HELD_ROWS]
    return _Cycle(number, duration, low, high, slope, width, area, y[:, at].mean(1))


def _relaxation(
    record: Record, outputs: Float[np.ndarray, "2 samples"], counted: Bool[np.ndarray, " samples"]
) -> Characteristic:
    def none(why: str) -> Characteristic:
        return Characteristic("relaxation time", None, None, record.time_unit, "", why)

    if record.time is None:
        return none("the record has no clock")
    held = (rows[counted[rows]] for rows in _holds(record))
    holds = [rows for rows in held if len(rows) >= HELD_ROWS]
    if not holds:
        return none("the input is never held")
    ends = [_ends(outputs[:, rows]) for rows in holds]
    changes = np.array([start - end for start, end in ends])
    size = np.abs(changes[:, 0])
    alike = np.flatnonzero(size >= ALIKE * size.max())
    # What the model misses the change by, and what chance would have it miss.
    wrong = np.sqrt(np.mean((changes[alike, 0] - changes[alike, 1]) ** 2))
    if not size.max() > SURE * wrong:
        return none("no hold shows a change that the model meets")
    times = []
    for k in alike:
        t, y, (start, end) = record.time[holds[k]], outputs[:, holds[k]], ends[k]
        with np.errstate(divide="ignore", invalid="ignore"):
            times.append(np.trapezoid(y - end[:, None], t, axis=1) / (start - end))
    longest = max(float(np.ptp(record.time[holds[k]])) for k in alike)
    basis = f"{_count(len(alike), 'hold')} of up to {longest:.3g} {record.time_unit}"
    return _mean("relaxation time", np.array(times), record.time_unit, basis)


def _holds(record: Record) -> list[np.ndarray]:
    """Rows of each stretch in which the input stays where it is: a smooth turn is slow, but moves on."""
    assert record.time is not None
    found, t = [], record.time
    span = float(np.ptp(record.input[record.mask])) if record.mask.any() else 0.0
    for _, where in record.sequences():
        u = record.input[where]
        if len(u) < HELD_ROWS:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(u, HELD_ROWS)
        moves, steps = np.abs(np.diff(u)), np.diff(t[where])
        # Along its path, so that rests do not slow it down.
        pace = float(np.sum(moves**2 / steps) / moves.sum()) if moves.any() else 0.0
        still = np.flatnonzero(np.ptp(windows, axis=1) <= HELD * span)
        for run in np.split(still, np.flatnonzero(np.diff(still) > 1) + 1):
            if not len(run):
                continue
            rows = np.arange(run[0], run[-1] + HELD_ROWS)
            # Where it arrives and leaves it still moves: from the first row at the level to the last.
            away = np.abs(u[rows] - np.median(u[rows]))
            at = np.flatnonzero(away <= max(SCATTER * np.median(away), LEVEL * span))
            rows = rows[at[0] : at[-1] + 1]
            moved = np.ptp(u[rows])
            if moved <= HELD * span and moved <= RESTS * pace * np.ptp(t[where][rows]):
                found.append(where.start + rows)
    return found


def _ends(y: Float[np.ndarray, "2 rows"]) -> tuple[np.ndarray, np.ndarray]:
    """Output at the beginning and at the end of a hold, a tenth of its rows for the end."""
    last = max(1, y.shape[1] // 10)
    return y[:, 0], y[:, -last:].mean(1)


def _mean(name: str, values: Float[np.ndarray, "cases 2"], unit: str, basis: str) -> Characteristic:
    """The model's mean, and how far it is from the readings' figure."""
    value, off = float(values[:, 0].mean()), values[:, 0] - values[:, 1]
    error = float(np.sqrt(np.mean(off**2)))
    if not np.isfinite([value, error]).all():
        return Characteristic(name, None, None, unit, "", "not a finite number")
    return Characteristic(name, value, error, unit, basis)


def _change(
    name: str, values: Float[np.ndarray, "cases 2"], unit: str, basis: str
) -> Characteristic:
    """The model's change from the first to the last, and by how much it differs from the readings'.

    Not between these two alone, which may agree by chance, but rms between any two.
    """
    value = float(values[-1, 0] - values[0, 0])
    error = float(np.sqrt(2) * np.std(values[:, 0] - values[:, 1], ddof=1))
    if not np.isfinite([value, error]).all():
        return Characteristic(name, None, None, unit, "", "not a finite number")
    return Characteristic(name, value, error, unit, basis)


def _between(full: Sequence[_Cycle], unit: str) -> str:
    low, high = np.mean([(c.low, c.high) for c in full], axis=0)
    return f" between {low:.3g} and {high:.3g}" + ("" if unit == "1" else f" {unit}")


def _count(n: int, what: str) -> str:
    return f"{n} {what}{'s' * (n != 1)}"


def _over(one: str, other: str) -> str:
    return one if other == "1" else f"{one} / {other}"


def _times(one: str, other: str) -> str:
    return one if other == "1" else other if one == "1" else f"{one} * {other}"
