"""A dynamic record made ready: its clock, its period, the mean period and how well it is known."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from jaxtyping import Float
from numpy.typing import ArrayLike

from hysteresis import InputError, Note, Record
from hysteresis._format import quantity

from .._levels import CHANCE, FEW, HELD, LITTLE, MUCH

LEAST_ROWS = 64

BANDS = 10
"""White noise has the same power in each of so many bands."""


@dataclass(frozen=True, eq=False)
class MeasuredMotion:
    """Force and displacement on an even clock, one period of each where the force repeats itself.

    - `dt`: time between samples. `force`, `displacement`: (samples,).
    - `sigma`: standard deviation of the noise of each of these displacements.
    - `period`: rows in a period, 0 where there is none. `rows`: (first, end) of what was averaged.
    - `scatter`: variance of the mean period's spectrum in each line, by the scatter of the periods; None of
      a single one.
    - `color`: amplitude of the noise in each line over that of white noise; None where it is white, or no
      periods show it.
    """

    dt: float
    force: Float[np.ndarray, " samples"]
    displacement: Float[np.ndarray, " samples"]
    sigma: float
    period: int
    rows: tuple[int, int]
    scatter: Float[np.ndarray, " lines"] | None
    notes: tuple[Note, ...] = ()
    color: Float[np.ndarray, " lines"] | None = None

    def whitened(self, x: Float[np.ndarray, "samples *columns"]) -> Any:
        """Residuals, or columns of derivatives, through the filter that makes the noise white."""
        if self.color is None:
            return x
        over = self.color.reshape(-1, *(1,) * (x.ndim - 1))
        return np.fft.irfft(np.fft.rfft(x, axis=0) / over, len(x), axis=0)

    @property
    def periodic(self) -> bool:
        return self.period > 0

    @property
    def periods(self) -> int:
        """How many were averaged; 1 of a record without a period."""
        first, end = self.rows
        return (end - first) // self.period if self.periodic else 1

    @property
    def explained(self) -> float:
        """chi2 per row up to which noise explains what is left: more where its level is less certain."""
        unsure = 0.0 if self.scatter is not None else 10 / float(np.sqrt(len(self.force)))
        return MUCH + unsure

    @property
    def frequencies(self) -> Float[np.ndarray, " lines"]:
        """Of the discrete Fourier transform, in cycles a unit of time."""
        return np.fft.rfftfreq(len(self.force), self.dt)


def measured_motion(record: Record, period: int | None = None) -> MeasuredMotion:
    """The record of one sequence as a motion, averaged over its periods.

    **Arguments:** `period`: rows of a period; None to look for one, 0 for a force that does not repeat.

    Raises `InputError`: `no-time`, `several-sequences`, `uneven-clock`, `too-few-rows`, `not-periodic`,
    `constant-input`.
    """
    count = _uninterrupted(record)
    dt = even_clock(record.time, record.line, record.time_unit)
    u, y = (np.asarray(x, float)[:count] for x in (record.input, record.output))
    if len(u) < LEAST_ROWS:
        raise InputError(
            "too-few-rows",
            f"{len(u)} rows do not show an oscillation.",
            fix=f"measure at least {LEAST_ROWS} rows.",
        )
    if not np.ptp(u) > 0:
        raise InputError(
            "constant-input",
            "the force does not change.",
            fix="excite the oscillator with a multisine, a sweep or noise.",
        )
    period = period_of(u) if period is None else period
    if period:
        check_period(u, period)
    rows = period or len(u)  # a force that does not repeat itself is one part
    count = len(u) // rows
    parts = y[: count * rows].reshape(count, rows)
    first = int(count >= 3 and _is_transient(parts))
    parts = parts[first:]
    used = u[first * rows : count * rows].reshape(-1, rows).mean(0)
    mean, scatter, color = parts.mean(0), None, None
    if len(parts) > 1:
        sigma = float(np.sqrt(parts.var(0, ddof=1).mean() / len(parts)))
        scatter = np.var(np.fft.rfft(parts, axis=1), axis=0, ddof=1) / len(parts)
        color = noise_color(scatter, len(parts), rows)
    else:
        sigma = noise_level(mean, used, periodic=period > 0)
    # Of records without noise chi2 would tell the error of the integration.
    sigma = max(sigma, LITTLE * float(np.std(mean)))
    notes: list[Note] = []
    if period:
        text = f"The force repeats itself every {rows} rows; {len(parts)} periods are averaged."
        notes.append(Note("periods", text))
    if first:
        text = "The first period is still settling, so it is left out."
        notes.append(Note("transient-period", text))
    if color is not None:
        text = "The noise is coloured: what differs between the periods has up to"
        text += f" {float(color.max() / color.min()):.2g} times the amplitude in one band as in another."
        notes.append(Note("coloured-noise", f"{text} Residuals are whitened by it."))
    return MeasuredMotion(
        dt, used, mean, sigma, period, (first * rows, count * rows), scatter, tuple(notes), color
    )


def _uninterrupted(record: Record) -> int:
    """How many rows count: from the first row on, of one sequence and without a gap."""
    count, rows, several = int(record.mask.sum()), len(record), len(record.starts) > 1
    if record.mask[:count].all() and not several:
        return count
    row = record.starts[1] if several else np.argmin(record.mask)
    raise InputError(
        "several-sequences",
        f"{len(record.starts)} sequences; a fit of an oscillator takes one."
        if several
        else f"{rows - count} of {rows} rows are excluded, which cuts the motion.",
        place=f"line {int(record.line[row])}",
        fix="fit one uninterrupted run of rows from the beginning of the record (--where, --test-tail), or"
        " each sequence (--each).",
    )


def even_clock(time: ArrayLike | None, line: ArrayLike, unit: str) -> float:
    """The time between samples at these times, which stand in these lines of a file.

    Raises `InputError` `no-time` or `uneven-clock`.
    """
    if time is None:
        raise InputError(
            "no-time",
            "a motion needs the times of its samples.",
            fix="name the column of times (--time), or the time between samples (--dt).",
        )
    t = np.asarray(time, float)
    steps = np.diff(t)
    dt = float(t[-1] - t[0]) / max(len(steps), 1)
    median = float(np.median(steps))
    worst = int(np.argmax(np.abs(steps - median)))
    # Printed times may be coarse: a whole step is compared, and the drift from an even clock.
    gap = steps[worst] > 1.5 * median
    even = np.abs(t - t[0] - dt * np.arange(len(t))).max() < 0.5 * dt
    if gap or not even or abs(dt / median - 1) > 0.01:
        raise InputError(
            "uneven-clock",
            f"the time step is {quantity(float(steps[worst]), unit)} there, and"
            f" {quantity(median, unit)} as a rule.",
            place=f"line {int(np.asarray(line)[worst + 1])}",
            cause="samples were lost, or two records were joined.",
            fix="fit one uninterrupted part of the record (--where), or resample it to an even clock.",
        )
    return dt


def period_of(u: Float[np.ndarray, " samples"]) -> int:
    """The shortest lag at which a signal of two periods or more repeats itself; 0 where there is none."""
    n = len(u)
    x, lags = u - u.mean(), np.arange(n // 2 + 1)
    products = scipy.signal.correlate(x, x, method="fft")[n - 1 :][: len(lags)]
    squares = np.concatenate([[0.0], np.cumsum(x**2)])
    both = squares[n - lags] + squares[n] - squares[lags]
    apart = np.maximum(both - 2 * products, 0) / np.maximum(both, 1e-300)
    away = np.cumsum(apart > 0.5) > 0  # it has to leave itself before it can come back
    close = np.flatnonzero((apart < HELD**2) & away & (lags >= FEW))
    if not len(close):
        return 0
    # Of a run of neighbouring lags the closest one.
    run = close[: np.argmax(np.diff(close, append=n + 2) > 1) + 1]
    return int(run[np.argmin(apart[run])])


def check_period(u: np.ndarray, rows: int) -> None:
    if rows < FEW or rows > len(u):
        raise InputError(
            "bad-option",
            f"a period of {rows} rows; the record has {len(u)}.",
            fix=f"give a period from {FEW} to {len(u)} rows.",
        )
    if len(u) < 2 * rows:
        return
    apart = np.sqrt(np.mean((u[rows:] - u[:-rows]) ** 2)) / max(np.std(u), 1e-300)
    if apart > 5 * HELD:
        own = period_of(u)
        raise InputError(
            "not-periodic",
            f"the force is not the same {rows} rows later: it differs by {100 * apart:.0f} % rms.",
            cause="the period has another length, or the force does not repeat itself.",
            fix=f"leave out --period{f', or give --period {own}' if own else ''}.",
        )


def noise_color(
    scatter: Float[np.ndarray, " lines"], periods: int, rows: int
) -> Float[np.ndarray, " lines"] | None:
    """The amplitude of the noise in each line over that of white noise of the same power, from the scatter
    of some periods, averaged over neighbouring lines; None where it is white."""
    lines = scatter[1:-1]
    if len(lines) < 4 * BANDS or not lines.min() > 0:
        return None
    parts = np.array_split(lines, BANDS)
    means = np.array([part.mean() for part in parts])
    freedom = np.array([len(part) for part in parts]) * (periods - 1)
    logs = np.log(means) - np.average(np.log(means), weights=freedom)
    if np.sum(freedom * logs**2) < scipy.special.chdtri(BANDS - 1, CHANCE):
        return None
    reach = max(8, len(lines) // 64)
    smooth = scipy.ndimage.uniform_filter1d(lines, 2 * reach + 1, mode="mirror")
    power = np.concatenate([smooth[:1], smooth, smooth[-1:]])
    each = np.full(len(power), 2.0)
    each[0], each[-1] = 1.0, 1.0 if rows % 2 == 0 else 2.0
    # Less would tell of the integration.
    power = np.maximum(power * rows / np.sum(power * each), HELD**2)
    return np.sqrt(power * rows / np.sum(power * each))


def _is_transient(parts: np.ndarray) -> bool:
    """Whether the first period is farther from the mean of the others than those are from each other."""
    rest = parts[1:]
    noise = rest.var(0, ddof=1).mean()
    apart = np.mean((parts[0] - rest.mean(0)) ** 2)
    expected = noise * (1 + 1 / len(rest))
    return bool(apart > expected * (1 + 8 / np.sqrt(parts.shape[1])) and apart > 1.2 * expected)


def noise_level(
    y: Float[np.ndarray, " samples"], u: Float[np.ndarray, " samples"], periodic: bool = False
) -> float:
    """The standard deviation of white noise by the lines of the spectrum in which the force has nothing.

    The median of the power above 1.5 times the highest frequency of the force is taken, with the bias of a
    median of an exponential distribution; of the top tenth of the band at least.
    """
    n = len(y)
    window = np.ones(n) if periodic else np.hanning(n)
    power = np.abs(np.fft.rfft((y - y.mean()) * window)) ** 2 / np.sum(window**2)
    force = np.abs(np.fft.rfft((u - u.mean()) * window)) ** 2
    high = np.flatnonzero(force > 1e-6 * force.max())[-1]
    first = min(max(int(1.5 * high), n // 8), int(0.45 * n))
    return float(np.sqrt(max(float(np.median(power[first:-1])) / np.log(2), 1e-300)))
