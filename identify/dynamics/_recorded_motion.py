"""A fitted oscillator and its recorder over new records: from rest, in steady state, or going on."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hysteresis import Oscillator, Record, decimated, interpolated
from hysteresis.dynamics._oscillator import MOTION, before_first
from hysteresis.dynamics._recorder import clock
from hysteresis.running import Numbers, numbers_of, run

from .._levels import HELD, LITTLE, ROUNDING, STEPS
from ._measured_motion import even_clock, period_of


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """An oscillator with what lies between its motion and a file.

    - `model`: the oscillator. `dt`: time between samples that it was fitted to; `substeps` to a sample.
    - `stages`: of the recorder's decimation in the fitted record; () for plain sampling.
    - `period`: rows of the fitted record's period; 0 where it had none.
    - `initial`: displacement, velocity and hysteretic force before the fitted record, of one without a
      period. `force`: of the fitted rows.
    """

    model: Oscillator
    dt: float
    substeps: int
    stages: tuple[int, ...]
    period: int
    initial: tuple[float, float, float]
    force: Float[np.ndarray, " samples"]

    def from_rest(self, record: Record) -> Float[np.ndarray, " samples"]:
        """The displacements of a record that starts at rest, as a recorder keeps them that low-passes in
        one stage."""
        found = np.empty(len(record.input))
        for rows, part, substeps, dt in self._sequences(record):
            found[rows] = self._moving(part, substeps, dt, self.stages and (substeps,))
        return found

    def steady(self, record: Record) -> Float[np.ndarray, " samples"]:
        """The displacements in steady state: of a force whose period is in the record, or is the record."""
        found = np.empty(len(record.input))
        for rows, part, substeps, dt in self._sequences(record):
            period = period_of(part) or len(part)
            found[rows] = np.resize(self._period(part[:period], substeps, dt), len(part))
        return found

    def as_fitted(self, force: Float[np.ndarray, " samples"]) -> Float[np.ndarray, " samples"]:
        """The fitted record itself: in steady state, or from the fitted motion before its first sample."""
        if self.period:
            once = self._period(force[: self.period], self.substeps, self.dt)
            return np.resize(once, len(force))
        return self._moving(force, self.substeps, self.dt, self.stages, self.initial)

    def going_on(self, record: Record) -> Float[np.ndarray, " samples"] | None:
        """A record that follows the fitted one: its phase of the period, or the motion that goes on; None
        where its force is no part of the period."""
        part = np.asarray(record.input, float)
        if not self.period:
            return self.as_fitted(np.append(self.force, part))[len(self.force) :]
        once = self.force[: self.period]
        some = part[: min(len(part), self.period)]
        spectrum = np.fft.rfft(once) * np.conj(np.fft.rfft(some, self.period))
        shift = int(np.argmax(np.fft.irfft(spectrum, self.period)))
        wanted = np.resize(np.roll(once, -shift), len(part))
        if np.std(wanted - part) > 5 * HELD * np.std(once):
            return None
        return np.resize(np.roll(self.as_fitted(once), -shift), len(part))

    def _sequences(self, record: Record) -> Iterator[tuple[slice, np.ndarray, int, float]]:
        """Rows and force of each sequence, the steps and the time of a sample: of another clock steps about
        as long as the fitted ones."""
        for _, rows in record.sequences():
            time = None if record.time is None else record.time[rows]
            dt = even_clock(time, record.line[rows], record.time_unit)
            own = abs(dt / self.dt - 1) < LITTLE
            steps = self.substeps if own else max(1, round(self.substeps * dt / self.dt))
            yield rows, np.asarray(record.input, float)[rows], steps, self.dt if own else dt

    def _period(self, once: np.ndarray, substeps: int, dt: float) -> np.ndarray:
        """One period in steady state: the motion is run until it repeats itself."""
        fine = interpolated(once, substeps, "band-limited", True)
        fine = np.append(fine, fine[0])  # where the next period begins
        numbers, times = self._numbers, clock(len(fine), dt / substeps)
        found = run(numbers, fine, times)
        for _ in range(STEPS):
            before = found.value
            found = run(numbers._replace(m=found.m), fine, times)
            if not np.abs(found.value - before).max() > ROUNDING * np.abs(found.value).max():
                break
        return as_recorded(found.value[:-1], substeps, self.stages, True)

    def _moving(
        self,
        force: np.ndarray,
        substeps: int,
        dt: float,
        stages: tuple[int, ...],
        initial: tuple[float, ...] = (0.0,) * len(MOTION),
    ) -> np.ndarray:
        """The displacements from a first motion on."""
        numbers = self._numbers.with_state(before_first(self._numbers, initial))
        fine = interpolated(force, substeps)
        moved = run(numbers, fine, clock(len(fine), dt / substeps)).value
        return as_recorded(moved, substeps, stages)

    @property
    def _numbers(self) -> Numbers:
        """Of the law at rest."""
        return numbers_of(replace(self.model, substeps=1).tree())


def as_recorded(
    fine: np.ndarray, substeps: int, stages: tuple[int, ...], periodic: bool = False
) -> np.ndarray:
    """What a recorder keeps: in one stage where those of the fitted clock do not fit."""
    if not stages or substeps == 1:
        return fine[::substeps]
    return decimated(fine, stages if np.prod(stages) == substeps else (substeps,), periodic)
