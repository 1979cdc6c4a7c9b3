"""A fitted oscillator and its recorder over new records: from rest, in steady state, or going on."""

from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from hysteresis import Oscillator, Record, decimated, interpolated

from ._measured_motion import EVEN, REPEATED, even_clock, period_of

MOST_PERIODS = 40
SETTLED = 1e-9
"""Part of the largest displacement by which two periods may still differ in steady state."""


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """An oscillator with what lies between its motion and a file.

    - `model`: the oscillator. `dt`: time between samples that it was fitted to; `substeps` to a sample.
    - `stages`: of the recorder's decimation in the fitted record; () for plain sampling.
    - `period`: rows of the fitted record's period; 0 where it had none.
    - `initial`: displacement, velocity and hysteretic force before the fitted record, of one without a
      period. `force`: of the fitted rows.

    **Example:**

        >>> t = np.arange(400) / 750
        >>> pulse = hysteresis.Record.from_arrays(np.sin(60 * t) * np.exp(-9 * t), 0 * t, t)
        >>> spring = hysteresis.BoucWenForce(alpha=5e4, beta_gamma=800.0)
        >>> plant = hysteresis.Oscillator(2.0, 10.0, 5e4, spring)
        >>> motion = identify.RecordedMotion(plant, 1 / 750, 20, (), 0, (0.0, 0.0, 0.0), pulse.input)
        >>> float(motion.from_rest(pulse).max().round(7))
        1.13e-05
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
        for _, rows in record.sequences():
            part = np.asarray(record.input, float)[rows]
            substeps, dt = self._steps(record, rows)
            stages = (substeps,) if self.stages and substeps > 1 else ()
            fine = self._moved(part, substeps, dt, False)[0]
            found[rows] = self._kept(fine, substeps, stages, False)
        return found

    def steady(self, record: Record) -> Float[np.ndarray, " samples"]:
        """The displacements in steady state: of a force whose period is in the record, or is the record."""
        found = np.empty(len(record.input))
        for _, rows in record.sequences():
            part = np.asarray(record.input, float)[rows]
            substeps, dt = self._steps(record, rows)
            period = period_of(part) or len(part)
            once = self._period(part[:period], substeps, dt)
            found[rows] = np.resize(once, len(part))
        return found

    def as_fitted(self, record: Record) -> Float[np.ndarray, " samples"]:
        """The fitted record itself: in steady state, or from the fitted motion before its first sample."""
        part = np.asarray(record.input, float)
        if self.period:
            return np.resize(self._period(part[: self.period], self.substeps, self.dt), len(part))
        fine = self._moved(part, self.substeps, self.dt, True)[0]
        return self._kept(fine, self.substeps, self.stages, False)

    def going_on(self, record: Record) -> Float[np.ndarray, " samples"] | None:
        """A record that follows the fitted one: its phase of the period, or the motion that goes on; None
        where its force is no part of the period."""
        part = np.asarray(record.input, float)
        if not self.period:
            whole = np.concatenate([self.force, part])
            fine = self._moved(whole, self.substeps, self.dt, True)[0]
            return self._kept(fine, self.substeps, self.stages, False)[len(self.force) :]
        once = self.force[: self.period]
        shifts = np.arange(self.period)
        some = part[: min(len(part), self.period)]
        spectrum = np.fft.rfft(once) * np.conj(np.fft.rfft(some, self.period))
        shift = int(shifts[np.argmax(np.fft.irfft(spectrum, self.period))])
        wanted = np.resize(np.roll(once, -shift), len(part))
        if np.std(wanted - part) > 5 * REPEATED * np.std(once):
            return None
        found = self._period(once, self.substeps, self.dt)
        return np.resize(np.roll(found, -shift), len(part))

    def _steps(self, record: Record, rows: slice) -> tuple[int, float]:
        """Steps and time of a sample; of another clock steps about as long as the fitted ones."""
        time = None if record.time is None else record.time[rows]
        dt = even_clock(time, record.line[rows], record.time_unit)
        if abs(dt / self.dt - 1) < EVEN:
            return self.substeps, self.dt
        return max(1, round(self.substeps * dt / self.dt)), dt

    def _period(self, once: np.ndarray, substeps: int, dt: float) -> np.ndarray:
        """One period in steady state: the motion is run until it repeats itself."""
        fine = interpolated(once, substeps, "band-limited", True)
        found, state = self._run(fine, dt / substeps, None, periodic=True)
        for _ in range(MOST_PERIODS):
            state = state._replace(t=jnp.zeros_like(state.t))
            new, state = self._run(fine, dt / substeps, state, periodic=True)
            apart = float(np.abs(new - found).max())
            found = new
            if not apart > SETTLED * float(np.abs(found).max()):
                break
        return self._kept(found, substeps, self.stages, True)

    def _moved(
        self, force: np.ndarray, substeps: int, dt: float, as_fitted: bool
    ) -> tuple[np.ndarray, Any]:
        fine = interpolated(force, substeps, "band-limited")
        start = None
        if as_fitted and any(self.initial):
            start = self.model.moving(*self.initial)
        return self._run(fine, dt / substeps, start)

    def _run(
        self, fine: np.ndarray, h: float, state: Any = None, periodic: bool = False
    ) -> tuple[np.ndarray, Any]:
        """Displacements of the fine force from a state or from rest, and the state after them; of a period
        that at its end, where the next one begins."""
        count = len(fine)
        fine = np.append(fine, fine[0]) if periodic else fine
        model = replace(self.model, substeps=1, between="linear")
        after, found = model.stream(h * np.arange(len(fine)), fine, state)
        return np.asarray(found)[:count], after

    @staticmethod
    def _kept(
        fine: np.ndarray, substeps: int, stages: tuple[int, ...], periodic: bool
    ) -> np.ndarray:
        if stages and int(np.prod(stages)) == substeps:
            return decimated(fine, stages, periodic)
        if stages and substeps > 1:
            return decimated(fine, (substeps,), periodic)
        return fine[::substeps]
