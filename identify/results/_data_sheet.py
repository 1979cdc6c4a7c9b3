"""The data sheet of a sensor: its static and slow errors, by the terms of IEC 61298-2 and ISO 376."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hysteresis import InputError, Record
from hysteresis._drawing import html_of, plot_of
from hysteresis._format import number_of, plain, quantity, with_error
from hysteresis._quantities import conversion
from hysteresis._show import aligned
from hysteresis.records._abstract_record import over
from hysteresis.records._loop_cut import Pair, largest_row, step_of, student
from hysteresis.records._loop_figures import Loops

from .._levels import FEWEST, PART, REPEATS, SEAM, WHOLE
from ._characteristics import holds_of

RESOLUTIONS = 500
"""Errors of the reading are told from the first of ten even steps of the range on, and from so many
resolutions on. Below, they would be those of noise."""

UPPER, LOWER = 0.5, PART
"""Of the range: a hold above the one tells creep, one below the other behind a load its recovery."""

DEFINITIONS = {
    "full-scale output": "Output at the upper end of the range less output at its lower end.",
    "sensitivity": "Full-scale output over the range of inputs.",
    "zero": "Output at the lower end of the range.",
    "non-linearity, terminal":
        "Largest deviation of the mean curve, up and down, from the line through its ends.",
    "non-linearity, best line":
        "The same from the line for which the largest deviation is least (independent linearity).",
    "hysteresis":
        "Largest difference between the mean downscale and the mean upscale reading at one input.",
    "reversibility error":
        "Downscale less upscale reading, of the upscale reading (ISO 376), from 10 % of the range and 500"
        " resolutions on.",
    "repeatability":
        "Largest spread of the readings at one input, approached from one side, within a run; it holds"
        " their noise.",
    "repeatability error":
        "Spread of the upscale readings at one input, of the reading (ISO 376), from that limit on, noise"
        " included.",
    "reproducibility":
        "Largest spread at one input, from one side, between the means of the runs, noise included.",
    "zero return": "Reading at the lower end after a loop less that before it, the mean of all loops.",
    "zero error": "The largest of these, without regard to sign (ISO 376), noise included.",
    "drift of the zero":
        "Rate at which the reading at the lower end changes within the runs, from their second loop on.",
    "creep": "Change of the output while the input is held in the upper half of its range; the largest.",
    "creep recovery": "The same while the input is held at the lower end after a load.",
    "resolution": "The larger of the converter's step and two standard deviations of the noise.",
    "settling":
        "Time from the stop of the input until the output stays within 1 % of the full scale, or within"
        " three times the noise where that is more.",
}  # fmt: skip
"""What each line means."""


class SheetRow(NamedTuple):
    """A line of a data sheet: `value` and standard `error` in `unit`, or the `reason` why there is none.

    - `definition`: what it means. `basis`: what it is told from.
    """

    name: str
    value: float | None
    error: float | None
    unit: str
    definition: str
    basis: str = ""
    reason: str = ""


@dataclass(frozen=True, eq=False)
class DataSheet:
    """The data sheet of a sensor, see `data_sheet`.

    - `record`: what was measured. `rows`: a `SheetRow` each. `low`, `high`: the range of inputs.
      `zero`, `scale`: output at `low`, and how far it goes to `high`.
    - `inputs`: (levels,) at which branches were compared; `rising`, `falling`: (loops, levels) outputs.
    - `holds`: times and outputs of each hold above half of the range.
    """

    record: Record
    rows: tuple[SheetRow, ...]
    low: float
    high: float
    zero: float
    scale: float
    inputs: np.ndarray
    rising: np.ndarray
    falling: np.ndarray
    holds: tuple[tuple[np.ndarray, np.ndarray], ...]

    def __getitem__(self, name: str) -> SheetRow:
        """A line by name. Raises `InputError` `no-column`."""
        for row in self.rows:
            if row.name == name:
                return row
        names = ", ".join(row.name for row in self.rows)
        raise InputError("no-column", f"No line {name!r}; have {names}.")

    def document(self) -> dict[str, Any]:
        """All lines, as data that JSON can hold."""
        rows = [row._asdict() for row in self.rows]
        return plain({"low": self.low, "high": self.high, "scale": self.scale, "rows": rows})

    def plot(self) -> Any:
        """The sheet on one page, a matplotlib `Figure`: lines, definitions, and four pictures."""
        return plot_of(self)

    def __str__(self) -> str:
        return "\n".join(aligned([("line", "value", "unit", ""), *map(_cells, self.rows)]))

    def _repr_html_(self) -> str | None:
        return html_of(self)


def _cells(row: SheetRow) -> tuple[str, ...]:
    if row.value is None:
        return row.name, "-", "", row.reason
    value = f"{row.value:.4g}" if row.error is None else with_error(row.value, row.error)
    return row.name, value, row.unit.replace("percent", "%"), row.basis


@np.errstate(all="ignore")
def data_sheet(record: Record) -> DataSheet:
    """The data sheet of a sensor whose output was read while its input went up and down.

    The full scale is what the output goes through over the range of inputs that the full loops pass. Per
    cent are of it, unless a line says otherwise. Holds tell creep and settling, a clock drift, and a
    condition of the record, such as a temperature, its coefficients.

    **Arguments:**

    - `record`: the runs, each a sequence.

    **Returns:** a `DataSheet`. What the runs do not tell is empty, with a reason.

    **Raises:** `InputError` `too-few-cycles` where the input never goes up and down, `not-comparable` where
    the runs have other ranges, `zero-range`.

    **Example:**

        >>> sheet = identify.data_sheet(record)
        >>> sheet["hysteresis"].unit
        'percent'
    """
    loops = Loops.full(record)
    if not loops.size:
        raise InputError(
            "too-few-cycles", "The input never goes up and down.", place=record.source,
            fix="Load and unload the sensor over its range, at least once.",
        )  # fmt: skip
    low, high = (float(end[0]) for end in loops.common)
    if high - low < WHOLE * float((loops.high - loops.low).max()):
        raise InputError(
            "not-comparable", "The runs go over different ranges of the input.", place=record.source,
            fix="Give runs over one range, or a data sheet of each.",
        )  # fmt: skip
    ends = []
    for side in (-1, 1):
        # In the first leg: a loop's last row is the first of the next.
        at = largest_row(side * loops.u, loops.cut.first, loops.cut.turn)
        rows, off = loops.tip(loops.u, at)
        ends.append((loops.value(loops.u, rows, both=True), loops.value(loops.y, rows, off)))
    (begin, bottom), (end, top) = ends
    low, high = float(begin[0].mean()), float(end[0].mean())
    scale = float(np.mean(top[0] - bottom[0]))
    if not abs(scale) > 0:
        raise InputError(
            "zero-range", "The output is the same at both ends of the input's range.",
            place=record.source, fix="Give the column of the reading (--output COL).",
        )  # fmt: skip
    # Where the input has no noise, both columns are read at the same row.
    span = 0.0 if loops.quiet_u else float(np.linalg.norm([begin[1], end[1]]) / loops.size)
    sheet = _Sheet(record, loops, low, high, span, bottom, top, scale, _holds(record))
    rows = (
        *sheet.static(),
        *sheet.scatter(),
        *sheet.of_zero(),
        *sheet.slow(),
        *sheet.coefficients(),
    )
    held = tuple((t, y) for level, t, y in sheet.held if level >= low + UPPER * (high - low))
    branches = loops.branches[:, 0], loops.branches[:, 1]
    zero = float(bottom[0].mean())
    return DataSheet(record, rows, low, high, zero, scale, sheet.inputs, *branches, held)


class _Sheet(NamedTuple):
    """What the lines are made of: outputs at both ends of each loop, holds as level, times and outputs."""

    record: Record
    loops: Loops
    low: float
    high: float
    span_error: float
    bottom: Pair
    top: Pair
    scale: float
    held: list[tuple[float, np.ndarray, np.ndarray]]

    @property
    def inputs(self) -> np.ndarray:
        (low, *_), (high, *_) = self.loops.common
        return low + (high - low) * self.loops.place

    @property
    def resolution(self) -> float:
        """The larger of the converter's step and two standard deviations of the noise."""
        record, noise = self.record, float(np.median(self.loops.cut.noise[1].sigma))
        steps = [step_of(record.output[s][record.mask[s]]) for _, s in record.sequences()]
        return max(2 * noise, float(np.median(steps)))

    def row(
        self, name: str, value: Any, error: Any, basis: str = "", unit: str = "", of: Any = None
    ) -> SheetRow:
        """A line; without a unit in per cent of the full scale, or of another number."""
        by = 1.0 if unit else 100 / abs(self.scale if of is None else of)
        basis = basis or number_of(self.loops.size, "loop")
        wrong = None if error is None else float(by * error)
        return SheetRow(name, float(by * value), wrong, unit or "percent", DEFINITIONS[name], basis)

    def none(self, name: str, reason: str, unit: str = "percent") -> SheetRow:
        """A line without a value."""
        return SheetRow(name, None, None, unit, DEFINITIONS[name], reason=reason)

    def static(self) -> Iterator[SheetRow]:
        """Ends of the mean curve, and how straight it is."""
        record, loops, span = self.record, self.loops, self.high - self.low
        errors = [float(np.linalg.norm(one[1]) / loops.size) for one in (self.bottom, self.top)]
        error, zero = float(np.linalg.norm(errors)), float(self.bottom[0].mean())
        slope = over(record.output_unit, record.input_unit)
        yield self.row("full-scale output", self.scale, error, unit=record.output_unit)
        both = np.hypot(error, self.scale / span * self.span_error)
        yield self.row("sensitivity", self.scale / span, both / span, unit=slope)
        yield self.row("zero", zero, errors[0], unit=record.output_unit)
        x = np.concatenate([[0.0], (self.inputs - self.low) / span, [1.0]])
        y = np.concatenate([[0.0], loops.branches.mean((0, 1)) - zero, [self.scale]])
        error = float(np.linalg.norm(loops.branch_errors, axis=(0, 1)).max() / 2 / loops.size)
        yield self.row("non-linearity, terminal", np.abs(y - self.scale * x).max(), error)
        # The best line is parallel to the line through two of the points.
        first, second = np.triu_indices(len(x), 1)
        slopes = (y[second] - y[first]) / (x[second] - x[first])
        yield self.row(
            "non-linearity, best line", np.ptp(y - slopes[:, None] * x, axis=1).min() / 2, error
        )

    def scatter(self) -> Iterator[SheetRow]:
        """How far branches, loops and runs are apart."""
        loops = self.loops
        each, run = loops.branches, loops.cut.sequence
        rising, falling = each.mean(0)
        error = np.linalg.norm(loops.branch_errors, axis=(0, 1)) / loops.size
        at = int(np.abs(falling - rising).argmax())
        unit = self.record.input_unit
        where = f"{number_of(loops.size, 'loop')}, at {quantity(float(self.inputs[at]), unit, 3)}"
        yield self.row("hysteresis", abs(falling - rising)[at], error[at], where)
        reading = rising - self.bottom[0].mean()
        judged = self.inputs >= self.low + PART * (self.high - self.low)
        far = np.flatnonzero(judged & (np.abs(reading) >= RESOLUTIONS * self.resolution))

        def relative(name: str, apart: np.ndarray, wrong: np.ndarray, count: int) -> SheetRow:
            if not len(far):
                return self.none(name, "no reading is above 10 % of the range and 500 resolutions")
            at = far[np.abs(apart / reading)[far].argmax()]
            limit = quantity(float(self.inputs[far[0]]), unit, 3)
            basis = f"{number_of(count, 'loop')}, of the reading, from {limit} on"
            return self.row(name, abs(apart[at]), wrong[at], basis, of=reading[at])

        yield relative("reversibility error", falling - rising, error, loops.size)
        # Within each run: between runs the sensor was mounted anew, or has another temperature.
        runs = [each[run == k] for k in np.unique(run)]
        noise = np.sqrt(2) * loops.branch_errors.mean(0)
        most = max(map(len, runs))
        if most < 2:
            yield from (
                self.none(n, "there is one loop a run")
                for n in ("repeatability", "repeatability error")
            )
        else:
            spread = np.max([np.ptp(one, axis=0) for one in runs], axis=0)
            side = np.unravel_index(int(spread.argmax()), spread.shape)
            count = sum(len(one) for one in runs if len(one) > 1)
            yield self.row("repeatability", spread[side], noise[side], number_of(count, "loop"))
            yield relative("repeatability error", spread[0], noise[0], count)
        if len(runs) > 1:
            spread = np.ptp([one.mean(0) for one in runs], axis=0)
            side = np.unravel_index(int(spread.argmax()), spread.shape)
            yield self.row(
                "reproducibility", spread[side], noise[side] / np.sqrt(most), f"{len(runs)} runs"
            )
        else:
            yield self.none("reproducibility", "there is one run")

    def of_zero(self) -> Iterator[SheetRow]:
        """What becomes of the reading at the lower end."""
        loops, unit = self.loops, self.record.time_unit
        (before, error0), (after, error1) = loops.tips[0][1], loops.returned()
        up = loops.rising & loops.cut.closed
        if not up.any():
            yield from (
                self.none(n, "no loop begins at the lower end")
                for n in ("zero return", "zero error")
            )
        else:
            back, error = (after - before)[up], np.hypot(error0, error1)[up]
            at = int(np.abs(back).argmax())
            told = number_of(len(back), "loop")
            # A reading between two loops is after the one and before the other.
            rows = np.concatenate([loops.cut.first[up], loops.cut.last[up]])
            _, one, which = np.unique(rows, return_index=True, return_inverse=True)
            share = np.bincount(which, np.repeat([-1.0, 1.0], len(back))) / len(back)
            wrong = np.linalg.norm(share * np.concatenate([error0[up], error1[up]])[one])
            yield self.row("zero return", back.mean(), wrong, told)
            yield self.row("zero error", abs(back[at]), error[at], told)
        hours = conversion(unit, "h")
        rate = "percent / h" if hours else f"percent / {unit}"
        if loops.t is None:
            yield self.none("drift of the zero", "the record has no clock", rate)
            return
        later = loops.cut.number > 1  # a first loop differs from the others
        found = _slope(
            loops.t[loops.cut.first][later], self.bottom[0][later], loops.cut.sequence[later]
        )
        if found is None:
            yield self.none("drift of the zero", "fewer than three later loops in a run", rate)
            return
        by = 100 / abs(self.scale) / (hours or 1.0)
        told = number_of(int(later.sum()), "later loop")
        yield self.row("drift of the zero", by * found[0], by * found[1], told, rate)

    def slow(self) -> Iterator[SheetRow]:
        """What holds and noise tell."""
        record, span = self.record, self.high - self.low
        noise = float(np.median(self.loops.cut.noise[1].sigma))
        why = "the record has no clock" if record.time is None else "the input is never held there"
        for name, own in (
            ("creep", [one for one in self.held if one[0] >= self.low + UPPER * span]),
            ("creep recovery", [one for one in self.held if one[0] <= self.low + LOWER * span]),
        ):
            if not own:
                yield self.none(name, why)
                continue
            changes = [_end(y) - y[0] for _, _, y in own]
            at = int(np.abs(changes).argmax())
            length = quantity(float(np.ptp(own[at][1])), record.time_unit, 3)
            yield self.row(
                name, changes[at], noise, f"{number_of(len(own), 'hold')}, over {length}"
            )
        of_input = quantity(self.resolution * span / abs(self.scale), record.input_unit, 3)
        yield self.row("resolution", self.resolution, None, f"the input moved by {of_input}")
        if not self.held:
            yield self.none("settling", why, record.time_unit)
            return
        times, band = [], max(SEAM * abs(self.scale), 3 * noise)
        for _, t, y in self.held:
            away = np.flatnonzero(np.abs(y - _end(y)) > band)
            times.append(t[min(away[-1] + 1, len(t) - 1)] - t[0] if len(away) else 0.0)
        decides = "3 times the noise" if band == 3 * noise else f"{100 * SEAM:g} %"
        within = quantity(band, record.output_unit, 3)
        basis = f"{number_of(len(times), 'hold')}, within {within} ({decides})"
        step = np.median(np.diff(self.held[0][1]))
        yield self.row("settling", max(times), step, basis, record.time_unit)

    def coefficients(self) -> Iterator[SheetRow]:
        """How zero and sensitivity depend on each condition."""
        size, record = self.loops.size, self.record
        for name, unit in (record.conditions or {"temperature": "1"}).items():
            plain_name = name.removesuffix(f"({unit})").strip()
            rate = "percent" if unit == "1" else f"percent / {unit}"
            x = (
                record.columns[name][self.loops.turning_rows]
                if record.conditions
                else np.zeros(size)
            )
            why = (
                "it does not change"
                if record.conditions
                else "no condition is given (--condition COL)"
            )
            why = why if not np.ptp(x) > 0 else "fewer than three loops"
            for what, y in (
                ("zero", self.bottom[0]),
                ("sensitivity", self.top[0] - self.bottom[0]),
            ):
                found = _slope(x, y, np.zeros(size, int))
                said = (
                    f"Change of the {what} with it, by a line through the loops, of the full scale."
                )
                row = SheetRow(f"{what} over {plain_name}", None, None, rate, said, reason=why)
                if found is not None:
                    value, error = (100 / abs(self.scale) * one for one in found)
                    row = row._replace(
                        value=value, error=error, basis=number_of(size, "loop"), reason=""
                    )
                yield row


def _slope(x: np.ndarray, y: np.ndarray, group: np.ndarray) -> tuple[float, float] | None:
    """One slope of several groups with their own levels, and its error; None of too few."""
    count = np.bincount(group)
    x, y = (z - (np.bincount(group, z) / count)[group] for z in (x, y))
    free = len(x) - int(np.sum(count > 0)) - 1
    if free < 1 or len(x) < REPEATS or not x @ x > 0:
        return None
    slope = float(x @ y / (x @ x))
    left = y - slope * x
    return slope, student(free) * float(np.sqrt(left @ left / free / (x @ x)))


def _holds(record: Record) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Level, times and outputs of each stretch in which the input is held."""
    if record.time is None:
        return []
    counted = record.mask & np.isfinite(record.output)
    found = [rows[counted[rows]] for rows in holds_of(record)]
    return [
        (float(record.input[rows].mean()), record.time[rows], record.output[rows])
        for rows in found
        if len(rows) >= FEWEST
    ]


def _end(y: np.ndarray) -> float:
    """The output at the end of a hold: the mean of its last tenth."""
    return float(y[-max(1, len(y) // 10) :].mean())
