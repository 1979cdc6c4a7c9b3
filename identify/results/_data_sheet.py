"""The data sheet of a sensor: its static and slow errors, by the terms of IEC 61298-2 and ISO 376."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from hysteresis import InputError, Record, html_of, plot_of
from hysteresis._format import plain, quantity
from hysteresis._show import aligned
from hysteresis.records._loop_cut import loop_rows, step_of
from hysteresis.records._loop_figures import Loops

from ._characteristics import HELD_ROWS, holds_of

LEAST = 0.1
"""Of the range: ISO 376 relates to the reading from here on; below, a small zero error would be large."""

BAND = 0.01
"""Of the full scale: so close to the end of a hold an output has settled."""

UPPER, LOWER = 0.5, 0.1
"""Of the range: a hold above the one tells creep, one below the other behind a load its recovery."""

TOLD = 3
"""Loops that a drift or a coefficient needs."""


class SheetRow(NamedTuple):
    """A line of a data sheet: `value` and standard `error` in `unit`, or why there is none.

    - `basis`: what it is told from. `definition`: what it means.
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
    error = "" if row.error is None else f" ± {row.error:.2g}"
    return row.name, f"{row.value:.4g}{error}", row.unit.replace("percent", "%"), row.basis


@np.errstate(all="ignore")
def data_sheet(record: Record) -> DataSheet:
    """The data sheet of a sensor whose output was read while its input went up and down.

    The full scale is what the output goes through over the range of inputs that the full loops pass. Per
    cent are of it, unless a line says otherwise. Holds tell creep and settling, a clock drift, and a
    condition of the record, such as a temperature, its coefficients.

    **Arguments:**

    - `record`: the runs, each a sequence.

    **Returns:** a `DataSheet`. What the runs do not tell is empty, with a reason.

    **Raises:** `InputError` `too-few-cycles` where the input never goes up and down, `zero-range`.

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
    ends = []
    for largest in (False, True):
        rows, off, (level, _) = loops.peak(loops.u, largest)
        value, error = loops.value(loops.y, rows, off)
        ends.append((level.mean(), value, float(np.sqrt(np.sum(error**2)) / loops.size)))
    (low, bottom, error0), (high, top, error1) = ends
    zero, scale = float(bottom.mean()), float(top.mean() - bottom.mean())
    if not abs(scale) > 0:
        raise InputError(
            "zero-range", "The output is the same at both ends of the input's range.",
            place=record.source, fix="Give the column of the reading (--output COL).",
        )  # fmt: skip
    inputs = loops.common[0][0] + (loops.common[1][0] - loops.common[0][0]) * loops.place
    rising, falling = loops.branches[:, 0], loops.branches[:, 1]
    held = _holds(record)
    upper = tuple(one for one in held if one[0] >= low + UPPER * (high - low))
    found = _Sheet(record, loops, float(low), float(high), zero, scale, inputs, held)
    rows = (
        SheetRow("full-scale output", scale, float(np.hypot(error0, error1)), record.output_unit,
                 "Output at the upper end of the range less output at its lower end."),
        SheetRow("sensitivity", scale / (high - low), float(np.hypot(error0, error1)) / (high - low),
                 _over(record), "Full-scale output over the range of inputs."),
        SheetRow("zero", zero, error0, record.output_unit, "Output at the lower end of the range."),
        *found.linearity(), *found.scatter(), *found.zero_lines(bottom), *found.slow(),
        *found.coefficients(bottom, top),
    )  # fmt: skip
    return DataSheet(
        record, rows, float(low), float(high), zero, scale, inputs, rising, falling,
        tuple(one[1:] for one in upper),
    )  # fmt: skip


@dataclass(frozen=True)
class _Sheet:
    """What the lines are made of: `curves`, `error` (2, levels) of the mean rising and falling branch."""

    record: Record
    loops: Loops
    low: float
    high: float
    zero: float
    scale: float
    inputs: np.ndarray
    held: list[tuple[float, np.ndarray, np.ndarray]]

    @cached_property
    def share(self) -> np.ndarray:
        return (self.inputs - self.low) / (self.high - self.low)

    @cached_property
    def curves(self) -> np.ndarray:
        return self.loops.branches.mean(0)

    @cached_property
    def error(self) -> np.ndarray:
        return np.sqrt(np.sum(self.loops.branch_errors**2, axis=0)) / self.loops.size

    @property
    def basis(self) -> str:
        return f"{self.loops.size} loop{'s' * (self.loops.size != 1)}"

    def percent(
        self, name: str, value: float, error: float | None, definition: str, basis: str = ""
    ) -> SheetRow:
        """A line in per cent of the full scale."""
        by = 100 / abs(self.scale)
        wrong = None if error is None else by * error
        return SheetRow(name, by * value, wrong, "percent", definition, basis or self.basis)

    def linearity(self) -> Iterator[SheetRow]:
        mean, error = self.curves.mean(0), float(np.hypot(*self.error).max() / 2)
        x = np.concatenate([[0.0], self.share, [1.0]])
        y = np.concatenate([[self.zero], mean, [self.zero + self.scale]])
        off = float(np.abs(y - self.zero - self.scale * x).max())
        yield self.percent(
            "non-linearity, terminal", off, error,
            "Largest deviation of the mean curve, up and down, from the line through its ends.",
        )  # fmt: skip
        first, second = np.triu_indices(len(x), 1)
        slopes = (y[second] - y[first]) / (x[second] - x[first])
        left = y - slopes[:, None] * x
        best = float(np.ptp(left, axis=1).min() / 2)
        yield self.percent(
            "non-linearity, best line", best, error,
            "The same from the line for which the largest deviation is least (independent linearity).",
        )  # fmt: skip

    def scatter(self) -> Iterator[SheetRow]:
        rising, falling = self.curves
        gap = falling - rising
        at = int(np.abs(gap).argmax())
        yield self.percent(
            "hysteresis", float(abs(gap[at])), float(np.hypot(*self.error[:, at])),
            "Largest difference between the mean downscale and the mean upscale reading at one input.",
            f"{self.basis}, at {quantity(float(self.inputs[at]), self.record.input_unit, 3)}",
        )  # fmt: skip
        far = self.share >= LEAST
        reading = self.curves[0] - self.zero
        back = 100 * np.abs(gap / reading)[far]
        yield SheetRow(
            "reversibility error", float(back.max()),
            float(100 * np.abs(np.hypot(*self.error) / reading)[far][back.argmax()]), "percent",
            "Downscale less upscale reading, of the upscale reading, from 10 % of the range on (ISO 376).",
            f"{self.basis}, of the reading",
        )  # fmt: skip
        # Within each run: between runs the sensor was mounted anew, or has another temperature.
        run, branches = self.loops.cut.sequence, self.loops.branches
        own = [branches[run == k] for k in np.unique(run)]
        noise = np.sqrt(2) * self.loops.branch_errors.mean(0)
        once = "Largest spread of the readings at one input, approached from one side, "
        relative = (
            "Spread of the upscale readings at one input, of the reading, from 10 % on (ISO 376)."
        )
        if max(map(len, own)) < 2:
            for name, said in (
                ("repeatability", f"{once}within a run."),
                ("repeatability error", relative),
            ):
                yield SheetRow(name, None, None, "percent", said, reason="there is one loop a run")
        else:
            spread = np.max([np.ptp(one, axis=0) for one in own], axis=0)
            at = np.unravel_index(int(spread.argmax()), spread.shape)
            yield self.percent(
                "repeatability", float(spread[at]), float(noise[at]), f"{once}within a run."
            )
            part, wrong = (100 * np.abs(x[0] / reading)[far] for x in (spread, noise))
            yield SheetRow(
                "repeatability error", float(part.max()), float(wrong[part.argmax()]), "percent",
                relative, f"{self.basis}, of the reading",
            )  # fmt: skip
        if len(own) > 1:
            spread = np.ptp([one.mean(0) for one in own], axis=0)
            at = np.unravel_index(int(spread.argmax()), spread.shape)
            yield self.percent(
                "reproducibility", float(spread[at]), float(noise[at] / np.sqrt(max(map(len, own)))),
                f"{once}between the means of the runs.", f"{len(own)} runs",
            )  # fmt: skip

    def zero_lines(self, bottom: np.ndarray) -> Iterator[SheetRow]:
        loops = self.loops
        definition = (
            "Reading at the lower end after a loop less that before it, the mean of all loops."
        )
        largest = "The largest of these, without regard to sign (zero error of ISO 376)."
        (_, (before, error0)), _, (_, (after, error1)) = loops.tips
        up = loops.rising & loops.cut.closed
        if not up.any():
            for name in ("zero return", "zero error"):
                yield SheetRow(
                    name,
                    None,
                    None,
                    "percent",
                    definition,
                    reason="no loop begins at the lower end",
                )
        else:
            back, error = (after - before)[up], np.hypot(error0, error1)[up]
            n = int(up.sum())
            yield self.percent(
                "zero return", float(back.mean()), float(np.sqrt(np.sum(error**2)) / n), definition
            )
            at = int(np.abs(back).argmax())
            yield self.percent("zero error", float(abs(back[at])), float(error[at]), largest)
        definition = (
            "Rate at which the reading at the lower end changes from loop to loop within the runs."
        )
        unit = self.record.time_unit
        name, rate = "drift of the zero", "percent / h" if unit in HOURS else f"percent / {unit}"
        if loops.t is None:
            yield SheetRow(
                name, None, None, "percent / h", definition, reason="the record has no clock"
            )
            return
        t = loops.t[loops.cut.first]
        found = _slope(t, bottom, loops.cut.sequence)
        if found is None:
            yield SheetRow(
                name, None, None, rate, definition, reason="fewer than three loops in a run"
            )
            return
        by = 100 / abs(self.scale) * HOURS.get(unit, 1.0)
        yield SheetRow(name, by * found[0], by * found[1], rate, definition, self.basis)

    def slow(self) -> Iterator[SheetRow]:
        record, size = self.record, self.high - self.low
        creep = "Change of the output while the input is held in the upper half of its range; the largest."
        recovery = "The same while it is held at the lower end after a load."
        settling = (
            "Time from the stop of the input until the output stays within 1 % of the full scale."
        )
        noise = float(np.median(self.loops.sy))
        held = [(level, t - t[0], y) for level, t, y in self.held]
        for name, own, definition in (
            ("creep", [one for one in held if one[0] >= self.low + UPPER * size], creep),
            (
                "creep recovery",
                [one for one in held if one[0] <= self.low + LOWER * size],
                recovery,
            ),
        ):
            if not own:
                why = (
                    "the record has no clock"
                    if record.time is None
                    else "the input is never held there"
                )
                yield SheetRow(name, None, None, "percent", definition, reason=why)
                continue
            changes = np.array([_end(y) - y[0] for _, _, y in own])
            at = int(np.abs(changes).argmax())
            basis = f"{len(own)} hold{'s' * (len(own) != 1)}, over {own[at][1][-1]:.3g} {record.time_unit}"
            yield self.percent(name, float(changes[at]), noise * np.sqrt(1.1), definition, basis)
        noise, step = _readings(record)
        least = max(2 * noise, step)
        yield self.percent(
            "resolution", least, None,
            "The larger of the converter's step and two standard deviations of the noise.",
            quantity(least * size / abs(self.scale), record.input_unit, 3) + " of the input",
        )  # fmt: skip
        if not held:
            why = "the record has no clock" if record.time is None else "the input is never held"
            yield SheetRow("settling", None, None, record.time_unit, settling, reason=why)
            return
        times = []
        for _, t, y in held:
            away = np.flatnonzero(np.abs(y - _end(y)) > max(BAND * abs(self.scale), 3 * noise))
            times.append(float(t[min(away[-1] + 1, len(t) - 1)]) if len(away) else 0.0)
        step = float(np.median(np.diff(held[0][1])))
        yield SheetRow(
            "settling", max(times), step, record.time_unit, settling, f"{len(held)} holds"
        )

    def coefficients(self, bottom: np.ndarray, top: np.ndarray) -> Iterator[SheetRow]:
        loops = self.loops
        definition = (
            "Change of the {} with the {}, by a line through the loops; of the full scale a unit."
        )
        conditions = self.record.conditions or {"temperature": ""}
        for name, unit in conditions.items():
            plain_name = name.removesuffix(f"({unit})").strip()
            unit = "percent" if not unit or unit == "1" else f"percent / {unit}"
            if name in self.record.columns:
                found = self.record.columns[name][loops.turning_rows]
                why = "" if np.ptp(found) > 0 else "it does not change"
            else:
                found, why = np.zeros(loops.size), "no condition is given (--condition COL)"
            for what, values in (("zero", bottom), ("sensitivity", top - bottom)):
                said = definition.format(what, plain_name)
                fit = None if why else _slope(found, values, np.zeros(loops.size, int))
                label = f"{what} over {plain_name}"
                if fit is None:
                    reason = why or "fewer than three loops"
                    yield SheetRow(label, None, None, unit, said, reason=reason)
                    continue
                by = 100 / abs(self.scale)
                yield SheetRow(label, by * fit[0], by * fit[1], unit, said, self.basis)


HOURS = {"s": 3600.0, "ms": 3.6e6, "min": 60.0, "h": 1.0}
"""Of a clock's unit in an hour."""


def _slope(x: np.ndarray, y: np.ndarray, group: np.ndarray) -> tuple[float, float] | None:
    """One slope of several groups with their own levels, and its error; None of too few."""
    count = np.bincount(group)
    own = count > 0
    x, y = (z - (np.bincount(group, z) / count)[group] for z in (x, y))
    free = len(x) - int(own.sum()) - 1
    if free < 1 or len(x) < TOLD or not (x @ x) > 0:
        return None
    slope = float(x @ y / (x @ x))
    left = y - slope * x
    return slope, float(np.sqrt(left @ left / free / (x @ x)))


def _holds(record: Record) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Level, times and outputs of each stretch in which the input is held."""
    if record.time is None:
        return []
    counted = record.mask & np.isfinite(record.output)
    found = [rows[counted[rows]] for rows in holds_of(record)]
    return [
        (float(record.input[rows].mean()), record.time[rows], record.output[rows])
        for rows in found
        if len(rows) >= HELD_ROWS
    ]


def _end(y: np.ndarray) -> float:
    """The output at the end of a hold: the mean of its last tenth."""
    return float(y[-max(1, len(y) // 10) :].mean())


def _readings(record: Record) -> tuple[float, float]:
    """Standard deviation of the readings, and the converter's step, of the usual run."""
    cut = loop_rows(record)
    steps = [step_of(record.output[where][record.mask[where]]) for _, where in record.sequences()]
    return float(np.median(cut.noise[1])), float(np.median(steps))


def _over(record: Record) -> str:
    return (
        record.output_unit
        if record.input_unit == "1"
        else f"{record.output_unit} / {record.input_unit}"
    )
