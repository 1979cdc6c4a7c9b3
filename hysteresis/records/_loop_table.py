"""The table of a record's loops: a row a loop, each figure with error and unit, or why it is empty."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy

from .._errors import InputError
from .._format import number_of, plain, with_error
from .._show import aligned, at_most
from ._abstract_record import AbstractRecord, kind_of_units, over, times
from ._loop_cut import Pair, loop_rows, student
from ._loop_fields import area, field_figures, field_unit, given_back, middle_slope, slopes
from ._loop_figures import FULL, Loops

KINDS = ("mechanical", "magnetic", "ferroelectric", "plain")

PACE = 1.25
"""Times the shortest of these loops that the longest may take: at another rate, or after another rest,
creep moves stiffness and zero as well."""

FEW_ROWS, NO_OVERLAP, OPEN = (
    "too few of its rows count", "its branches pass no input alike", "it does not return to its first input"
)  # fmt: skip
SHORT, FIRST, OTHER = (
    "too few rows there", "no loop before it", "the loop before it differs in range, rate or rest"
)  # fmt: skip
NO_LOOP = "No loop: the input does not go and come back."
THIN = "the loop is no wider than its error"
AGAINST = "energy lost and secant stiffness have opposite signs"
SURE = 3.0
"""Standard errors from which on a loop has an area whose halves can be compared."""

CHANCE = 0.01
"""So seldom noise alone makes loops differ by more than they may."""

SHOWN = 12
"""Loops that are printed."""


class LoopFigure(NamedTuple):
    """One figure of every loop: `value` and standard `error` (k,), NaN where `reason` (k,) says why."""

    name: str
    value: np.ndarray
    error: np.ndarray
    unit: str
    reason: np.ndarray


class LoopSummary(NamedTuple):
    """A figure over the full loops, both branches of which pass 95 % of the widest loop's inputs:

    - `value`, `error`: mean, and its standard error: from the noise, or Student's from the scatter where
      loops differ by more. `scatter`: standard deviation from loop to loop, None of one.
    - `loops`: how many. `first`, `later`: of each run's first full loop, and of the later ones, where runs
      have both. `reason`: why there is no value.
    """

    name: str
    value: float | None
    error: float | None
    scatter: float | None
    unit: str
    loops: int
    first: float | None
    later: float | None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class LoopTable:
    """Loops of a record, a row each; see `Record.loops`.

    - `kind`: "mechanical", "magnetic", "ferroelectric" or "plain".
    - `run`, `cycle`: (k,) sequence and number in it. `first`, `last`: (k,) lines. `full`: (k,) whether its
      branches both pass 95 % of the widest range that two do.
    - `figures`: a `LoopFigure` each. `model`: the same loops as a fitted model has them, or None.
    """

    kind: str
    run: np.ndarray
    cycle: np.ndarray
    first: np.ndarray
    last: np.ndarray
    full: np.ndarray
    figures: tuple[LoopFigure, ...]
    model: "LoopTable | None" = None

    def __len__(self) -> int:
        return len(self.run)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the figures."""
        return tuple(one.name for one in self.figures)

    def __getitem__(self, name: str) -> LoopFigure:
        """A figure by name. Raises `InputError` `no-column`."""
        for one in self.figures:
            if one.name == name:
                return one
        raise InputError("no-column", f"No figure {name!r}; have {', '.join(self.names)}.")

    @property
    def summary(self) -> tuple[LoopSummary, ...]:
        """Each figure over the full loops, a `LoopSummary` each."""
        return tuple(self._summary(one) for one in self.figures)

    def _summary(self, one: LoopFigure) -> LoopSummary:
        told = self.full & np.isfinite(one.value)
        none = LoopSummary(one.name, None, None, None, one.unit, 0, None, None)
        if not told.any():
            why = one.reason[self.full] if self.full.any() else one.reason
            return none._replace(reason=str(why[0]) if len(why) else "no loop")
        x, n = one.value[told], int(told.sum())
        scatter = float(np.std(x, ddof=1)) if n > 1 else None
        # A run that begins in the middle of its range has an open loop first.
        starts = np.unique(self.run[self.full], return_index=True)[1]
        begins = np.isin(np.flatnonzero(told), np.flatnonzero(self.full)[starts])
        both = begins.any() and not begins.all()
        first, later = (float(x[w].mean()) if both else None for w in (begins, ~begins))
        square = float(np.mean(one.error[told] ** 2))
        error = float(np.sqrt(square / n))
        if scatter and scatter**2 * (n - 1) > square * scipy.special.chdtri(n - 1, CHANCE):
            error = student(n - 1) * scatter / float(np.sqrt(n))
        return LoopSummary(one.name, float(x.mean()), error, scatter, one.unit, n, first, later)

    def columns(self) -> dict[str, np.ndarray]:
        """The table as columns (k,) for a data frame: names carry units, and errors follow values."""
        found = {
            "run": self.run,
            "cycle": self.cycle,
            "first line": self.first,
            "last line": self.last,
        }
        for one in self.figures:
            unit = "" if one.unit == "1" else f" ({one.unit})"
            found |= {f"{one.name}{unit}": one.value, f"error of {one.name}{unit}": one.error}
        if self.model is not None:
            found |= {f"model's {name}": x for name, x in [*self.model.columns().items()][4::2]}
        return found

    def document(self) -> dict[str, Any]:
        """All of it, as data that JSON can hold."""
        rows: list[dict[str, Any]] = [
            {name: getattr(self, name)[k] for name in ("run", "cycle", "first", "last", "full")}
            for k in range(len(self))
        ]
        for k, row in enumerate(rows):
            row["figures"] = {
                one.name: {
                    "value": one.value[k], "error": one.error[k], "unit": one.unit, "reason": one.reason[k],
                }
                for one in self.figures
            }  # fmt: skip
            for one in () if self.model is None else self.model.figures:
                row["figures"][one.name]["model"] = one.value[k]
        summary = [one._asdict() for one in self.summary]
        return plain({"kind": self.kind, "summary": summary, "loops": rows})

    def cells(self) -> list[tuple[str, ...]]:
        """The summary in words, its header first, and with the model's means where there are any."""
        rows: list[tuple[str, ...]] = [
            ("figure", "mean", "model", "scatter", "first", "later", "unit", "why not")
        ]
        models = self.summary if self.model is None else self.model.summary
        for one, model in zip(self.summary, models, strict=True):
            more = one.scatter, one.first, one.later
            told = ("" if x is None else f"{x:.4g}" for x in (model.value, *more))
            mean = (
                "-" if one.value is None or one.error is None else with_error(one.value, one.error)
            )
            unit = "" if one.unit == "1" else one.unit
            rows.append((one.name, mean, *told, unit, one.reason))
        return rows if self.model is not None else [(*row[:2], *row[3:]) for row in rows]

    def lines(self) -> Iterator[str]:
        """The summary, and the main figures of the first loops, as lines."""
        if not len(self):
            yield NO_LOOP
            return
        full, size = int(self.full.sum()), number_of(len(self), "loop")
        yield f"{size}, {full} full ({self.kind}); mean ± error, scatter from loop to loop"
        if full < len(self):
            yield left_out(len(self) - full)
        yield from aligned([(f"  {name}", *more) for name, *more in self.cells()])
        main = [self[name] for name in MAIN if name in self.names]
        main = [one for one in main if np.isfinite(one.value).any()]
        heads = [f"{one.name}{'' if one.unit == '1' else f' ({one.unit})'}" for one in main]
        rows = [("  run", "cycle", "lines", *heads)]
        for k in range(min(len(self), SHOWN)):
            told = [
                "-" if np.isnan(one.value[k]) else with_error(one.value[k], one.error[k])
                for one in main
            ]
            lines = f"{self.first[k]}-{self.last[k]}"
            rows.append((f"  {self.run[k]}", str(self.cycle[k]), lines, *told))
        yield from ("", *aligned(rows))
        if len(self) > SHOWN:
            yield f"  ... and {len(self) - SHOWN} more loops (--csv FILE, or columns(), has all)"

    def __str__(self) -> str:
        return "\n".join(at_most([*self.lines()], 80))


MAIN = (
    "energy lost", "loop area", "width at mid-range", "stiffness", "slope", "damping ratio", "closure",
    "coercive field", "remanence", "saturation", "squareness",
)  # fmt: skip
"""Figures that are printed for each loop."""


def left_out(loops: int) -> str:
    """What a summary says of loops that are not full."""
    why = f"a branch below {100 * FULL:.0f} % of the widest loop's inputs, or too few rows"
    return f"Means are over the full loops and leave out {number_of(loops, 'loop')} ({why})."


def kind_of_loops(record: AbstractRecord) -> str:
    """What the loops are of, by the units of input and output, or by their names where they have none."""
    if kind_of_units(record) is not None:
        return "mechanical"
    units = record.input_unit, record.output_unit
    names = record.input_name.lower(), record.output_name.lower()
    if "1" not in units and all(field_unit(u, "magnetic", k) for k, u in enumerate(units)):
        return "magnetic"
    if re.search(r"magneti[sz]|moment", names[1]) and re.search(r"field|^[bh]\b", names[0]):
        return "magnetic"
    if "1" not in units and all(field_unit(u, "ferroelectric", k) for k, u in enumerate(units)):
        return "ferroelectric"
    if re.search(r"polari[sz]", names[1]) and re.search(r"field|volt|^[ev]\b", names[0]):
        return "ferroelectric"
    return "plain"


@np.errstate(all="ignore")  # a figure that is not a number is empty
def loop_table(
    record: AbstractRecord, kind: str | None = None, model: np.ndarray | None = None
) -> LoopTable:
    """The loops of a record, and those of a `model`'s output (n,) beside. See `Record.loops`."""
    if kind is None:
        kind = kind_of_loops(record)
    if kind not in KINDS:
        raise InputError("bad-option", f"kind={kind!r}.", fix=f"{', '.join(KINDS)}.")
    cut = loop_rows(record)
    size, usable, chosen = len(cut.first), cut.counted, cut.only(cut.counted)
    t = cut.rows if record.time is None else record.time[cut.rows]

    def whole(x: np.ndarray, empty: Any = np.nan) -> np.ndarray:
        found = np.full(size, empty, dtype=object if isinstance(empty, str) else float)
        found[usable] = x
        return found

    def of_block(loops: Loops) -> Iterator[tuple[Any, ...]]:
        """Name, unit, and of each loop value, error and reason; the range of inputs first."""
        both = loops.common[1] - loops.common[0]
        overlaps = both > 0
        yield "", "", np.where(overlaps, both, np.nan), overlaps, overlaps
        for name, (value, error), unit, why in _figures(record, kind, loops):
            why = np.where(overlaps, why, NO_OVERLAP).astype(object)
            empty = (why != "") | ~np.isfinite(value) | ~np.isfinite(error)
            why[empty & (why == "")] = SHORT
            yield name, unit, *(np.where(empty, np.nan, x) for x in (value, error)), why

    def table(y: np.ndarray | None) -> LoopTable:
        blocks = [[*of_block(Loops(record, part, y))] for part in chosen.blocks()]
        found = []
        for parts in zip(*blocks, strict=True):
            value, error, why = (np.concatenate([part[k] for part in parts]) for k in (2, 3, 4))
            if not (name := parts[0][0]):
                span = whole(value)
                full = span >= FULL * max(span[np.isfinite(span)], default=0.0)
                continue
            found.append(
                LoopFigure(name, whole(value), whole(error), parts[0][1], whole(why, FEW_ROWS))
            )
        if kind in ("mechanical", "plain"):
            seconds = whole(t[chosen.last] - t[chosen.first])
            found.append(_softening(record, cut.sequence, full, seconds, found))
        labels = np.array(record.labels, object)[cut.sequence]
        first, last = record.line[cut.ends].T
        return LoopTable(kind, labels, cut.number, first, last, full, tuple(found))

    return replace(table(None), model=None if model is None else table(model))


def _softening(
    record: AbstractRecord, run: np.ndarray, full: np.ndarray, seconds: np.ndarray,
    found: list[LoopFigure],
) -> LoopFigure:  # fmt: skip
    """Loss of stiffness from the loop before, in per cent."""
    stiff = next(one for one in found if one.name in ("stiffness", "slope"))
    x, error = stiff.value, stiff.error
    x0, error0, full0, seconds0 = (np.append(y[:1], y[:-1]) for y in (x, error, full, seconds))
    new = np.append(True, run[1:] != run[:-1])[: len(x)]
    longer = np.maximum(seconds, seconds0) > PACE * np.minimum(seconds, seconds0)
    held = f"{', '.join(record.conditions)} may change between loops" if record.conditions else ""
    why = np.where(~full | ~full0 | longer, OTHER, held).astype(object)
    why[new] = FIRST
    why[stiff.reason != ""] = stiff.reason[stiff.reason != ""]
    value, wrong = 100 * (1 - x / x0), 100 / np.abs(x0) * np.hypot(error, x / x0 * error0)
    why[(why == "") & ~np.isfinite(value)] = SHORT
    value, wrong = (np.where(why == "", y, np.nan) for y in (value, wrong))
    return LoopFigure("softening", value, wrong, "percent", why)


Peak = tuple[np.ndarray, np.ndarray, Pair]
Told = tuple[str, Pair, str, "np.ndarray | str"]


def _figures(record: AbstractRecord, kind: str, loops: Loops) -> Iterator[Told]:
    """Name, value with error, unit and reason of each figure of all loops."""
    cut, unit_u, unit_y = loops.cut, record.input_unit, record.output_unit
    u, y, (nu, ny) = loops.u, loops.y, loops.noise
    if loops.t is not None:
        step = np.full(loops.size, cut.clock / np.sqrt(6))
        past = cut.clock * (loops.past(cut.first) + loops.past(cut.last))
        lasted = loops.t[cut.last] - loops.t[cut.first] + past
        yield "duration", (lasted, step), record.time_unit, ""
    peaks: dict[Any, Peak] = {}
    for name, x, unit in (("input", u, unit_u), ("output", y, unit_y)):
        for which in ("lowest", "highest"):
            peaks[name, which] = loops.peak(x, which == "highest")
            yield f"{which} {name}", peaks[name, which][2], unit, ""
    rows, off, _ = peaks["input", "lowest"]
    yield "output at lowest input", loops.value(y, rows, off), unit_y, ""
    opened = np.where(cut.closed, "", OPEN)
    yield "closure", less(loops.returned(), loops.tips[0][1]), unit_y, opened
    around = area(loops, u, y, nu, ny)
    size = less(peaks["input", "highest"][2], peaks["input", "lowest"][2])
    mean = np.abs(around[0]) / size[0]
    yield "loop width", (mean, np.hypot(around[1], mean * size[1]) / size[0]), unit_y, opened
    yield "width at mid-range", loops.width_at_middle(), unit_y, ""
    yield "largest width", loops.largest_width(), unit_y, ""
    if kind in ("magnetic", "ferroelectric"):
        yield from field_figures(record, kind, loops, around, opened)
        return
    yield from _of_stiffness(record, loops)
    yield from _of_energy(record, kind, loops, around, opened, peaks)


def _of_stiffness(record: AbstractRecord, loops: Loops) -> Iterator[Told]:
    """Slopes of the loop and of its branches: load over deformation where the units tell them apart."""
    creep = kind_of_units(record) == "creep"
    units = record.output_unit, record.input_unit
    unit = over(*units[::-1] if creep else units)
    name = "slope" if kind_of_units(record) is None else "stiffness"

    def turned(pair: Pair) -> Pair:
        return (1 / pair[0], pair[1] / pair[0] ** 2) if creep else pair

    yield name, turned(middle_slope(loops)), unit, ""
    ends = pairwise(loops.tips)
    chords = [_ratio(less(y1, y0), less(u1, u0)) for (u0, y0), (u1, y1) in ends]
    values, errors = (loops.by_way(np.stack(x, axis=1)) for x in zip(*chords, strict=True))
    secants = [(values[:, k], errors[:, k]) for k in (0, 1)]
    for what, pairs in (
        ("secant", secants),
        ("tangent", slopes(loops, initial=False)),
        ("initial", slopes(loops, initial=True)),
    ):  # fmt: skip
        for way, pair in zip(("loading", "unloading"), pairs, strict=True):
            yield f"{what} {name}, {way}", turned(pair), unit, ""


def _of_energy(
    record: AbstractRecord,
    kind: str,
    loops: Loops,
    around: Pair,
    opened: np.ndarray,
    peaks: dict[Any, Peak],
) -> Iterator[Told]:
    """Work done on the specimen, what it gives back and loses, and the damping that is worth."""
    creep = kind_of_units(record) == "creep"
    load, x, (nx, nl) = loops.y, loops.u, loops.noise
    way, units = "input", (record.output_unit, record.input_unit)
    if creep:
        load, x, nl, nx, way, units = x, load, nx, nl, "output", units[::-1]
    # A polygon's area over the other axis has the other sign.
    whole = -around[0] if creep else around[0]
    unit, error = times(*units), around[1]
    lost = np.abs(whole) if kind == "plain" else whole
    if kind == "plain":
        yield "loop area", (lost, error), unit, opened
    else:
        given, wrong = given_back(loops, x, load)
        # Each has the noise of its part of the way.
        share = np.clip(given / (lost + 2 * given), 0.0, 1.0)
        out, into = (np.hypot(wrong, error * np.sqrt(part)) for part in (share, 1 - share))
        yield "energy lost", (lost, error), unit, opened
        yield "energy in", (lost + given, into), unit, opened
        yield "energy out", (given, out), unit, opened
    most, least = peaks[way, "highest"], peaks[way, "lowest"]
    size = less(most[2], least[2])
    rise = less(*(loops.value(load, rows, off) for rows, off, _ in (most, least)))
    if kind == "plain":
        rise = np.abs(rise[0]), rise[1]
    ratio, off = _ratio(_ratio((2 / np.pi * lost, 2 / np.pi * error), size), rise)
    # As of half a loop of a damper, whose load falls from end to end.
    against = np.where((opened == "") & (ratio < -3 * off), AGAINST, opened)
    yield "damping ratio", (ratio, off), "1", against
    yield "loss factor", (2 * ratio, 2 * off), "1", against
    middle = (most[2][0] + least[2][0]) / 2
    above = np.empty_like(x)
    rows = loops.legs.at
    above[rows] = np.maximum(x[rows] - middle[loops.legs.branch // 2], 0.0)
    # Both halves err by as much; where they part errs by the error of the middle.
    uneven = 2 * area(loops, above, load, nx, nl)[0] / whole - 1
    parted = loops.width_at_middle()[0] * size[1]
    wrong = np.hypot(error * np.hypot(1, uneven), parted) / np.abs(whole)
    thin = np.where(np.abs(whole) > SURE * error, opened, THIN)
    yield "energy asymmetry", (uneven, wrong), "1", thin


def less(one: Pair, other: Pair) -> Pair:
    """The difference of two figures."""
    return one[0] - other[0], np.hypot(one[1], other[1])


def _ratio(one: Pair, other: Pair) -> Pair:
    ratio = one[0] / other[0]
    return ratio, np.hypot(one[1], ratio * other[1]) / np.abs(other[0])
