"""Output error: simulated motion against measured, with sensitivities, by Levenberg-Marquardt."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Float

from hysteresis import DuhemForce, GeneralizedPlays, Oscillator, Record, decimated, interpolated
from hysteresis.dynamics._oscillator import MOTION, before_first, law_of
from hysteresis.dynamics._recorder import clock
from hysteresis.running import Known, Numbers, numbers_of, place_of, run, tangents

from .._levels import HELD, LITTLE, ROUNDING, STEPS
from ._measured_motion import MeasuredMotion, even_clock, period_of

# A fitted oscillator and its recorder over new records: from rest, in steady state, or going on.


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


ALONE = 2.0
"""Numbers of the law for each unknown up to which derivatives are taken by the former."""

FAR = 100.0
"""A simulated motion beyond this many times the largest measured one has failed."""

TRIES = 10
"""So often the damping is raised tenfold before a step is given up."""

PATIENCE = 3
"""Steps in a row that gain next to nothing: those of a class that does not fit were a fifth of a search."""

BOUC_WEN = 3
"""Knots of Bouc-Wen's force."""

PLANT, STATE = 3, len(MOTION)
"""Mass, damping, stiffness; displacement, velocity and hysteretic force at first."""


@dataclass(frozen=True, eq=False)
class Setting:
    """How a motion is simulated: steps of a sample, filter of the recorder, periods before steady state.

    - `force`: the fine force.
    """

    motion: MeasuredMotion
    substeps: int
    stages: tuple[int, ...]
    warm: int
    force: Float[np.ndarray, " fine"]

    @classmethod
    def of(
        cls, motion: MeasuredMotion, substeps: int, stages: tuple[int, ...] = (), warm: int = 1
    ) -> "Setting":
        fine = interpolated(motion.force, substeps, "band-limited", motion.periodic)
        return cls(motion, substeps, stages, warm if motion.periodic else 0, fine)

    @cached_property
    def rows(self) -> tuple[np.ndarray, np.ndarray]:
        """The force of all periods, and its clock."""
        force = np.tile(self.force, 1 + self.warm)
        return force, clock(len(force), self.motion.dt / self.substeps)

    def simulated(
        self,
        family: "Family",
        q: np.ndarray,
        jacobian: bool = True,
        state: Float[np.ndarray, " state"] | None = None,
    ) -> Any:
        """Displacements at the samples, and their derivatives by q; NaN where the motion has no end.

        It begins in the `state`, or in that of q.
        """
        first = self.warm * len(self.force)
        kept = (first, self.substeps) if jacobian else None
        fine, by = family.moved(q, *self.rows, state, kept)
        limit = FAR * float(np.abs(self.motion.displacement).max())
        if not (-limit < fine.min() and fine.max() < limit):
            return np.full(len(self.motion.force), np.nan), None
        y = as_recorded(fine[first:], self.substeps, self.stages, self.motion.periodic)
        return y, by

    def steady_state(self, family: "Family", q: np.ndarray) -> Float[np.ndarray, " state"]:
        """The state where a period begins, after `warm` of them; its acceleration is to be found."""
        numbers = family.numbers(q)
        force, dt = self.rows
        after = run(numbers, np.append(force, force[0]), np.append(dt, dt[-1])).m
        return before_first(numbers._replace(m=after))

    def hysteretic_force(self, family: "Family", q: np.ndarray) -> Float[np.ndarray, " fine"]:
        """z over the fine steps: what the motion leaves of the force."""
        h = self.motion.dt / self.substeps
        y, _ = family.moved(q, *self.rows)
        y = y[-len(self.force) :]
        v = np.gradient(y, h)
        a = np.gradient(v, h)
        mass, damping, stiffness = (family.T @ q)[:PLANT]
        return (self.force - mass * a - damping * v - stiffness * y)[2:-2]


@dataclass(frozen=True, eq=False)
class Family:
    """A class of oscillators: knots and plays, and the unknowns q with theta = T q.

    - `rate`, `plays`: with any slopes and heights.
    - `groups`: unknowns that one prior each draws to zero, with its standard deviation at first.
    - `words`: what sets it apart from others of its class.
    """

    rate: DuhemForce | None
    plays: GeneralizedPlays
    T: Float[np.ndarray, "theta unknowns"]
    groups: tuple[tuple[np.ndarray, float], ...] = ()
    words: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def places(self) -> tuple[Known, np.ndarray, np.ndarray]:
        """The law's structure, its numbers without those that change, and where in them theta lies."""
        tree = law_of(list(jnp.zeros(PLANT)), self.rate, self.plays, 1)
        own = tree["parameters"]
        # What no unknown changes is constant.
        own |= {name: np.asarray(own[name]) for name in ("limit", "per", "radii", "low", "scale")}
        known, m = numbers_of(tree)
        state = [place_of(known, name) for name in MOTION]
        return known, np.asarray(m), np.array([*known.free[:PLANT], *state, *known.free[PLANT:]])

    def numbers(self, q: np.ndarray) -> Numbers:
        """The law with these unknowns."""
        known, m, places = self.places
        m = m.copy()
        m[places] = self.T @ q
        return Numbers(known, m)

    def moved(
        self,
        q: np.ndarray,
        force: Float[np.ndarray, " fine"],
        dt: Float[np.ndarray, " fine"],
        state: Float[np.ndarray, " state"] | None = None,
        kept: tuple[int, int] | None = None,
    ) -> tuple[Float[np.ndarray, " fine"], Any]:
        """Displacements of a force, dt after the row before, and the derivatives by q of those `kept`."""
        known, m = self.numbers(q)
        if state is not None:
            m[len(m) - known.states :] = state
        numbers = Numbers(known, m)
        if kept is None:
            return run(numbers, force, dt).value, None
        # A column for each number of the law takes half the time of one for each unknown.
        alone = len(self.T) < ALONE * len(q)
        dm = np.zeros((len(m), len(self.T) if alone else len(q)))
        dm[self.places[2]] = np.eye(len(self.T)) if alone else self.T
        found = tangents(numbers, dm, force, dt, kept=kept)
        return found.value, found.columns @ self.T if alone else found.columns

    def prior_root(self, deviations: Sequence[float]) -> Float[np.ndarray, " unknowns"]:
        """One over the standard deviation of each unknown's prior, 0 for none."""
        root = np.zeros(self.T.shape[1])
        for (group, _), deviation in zip(self.groups, deviations, strict=True):
            root[group] = 1 / deviation
        return root

    def unknowns_of(self, theta: Float[np.ndarray, " theta"]) -> Float[np.ndarray, " unknowns"]:
        """The nearest unknowns to these parameters, each row in its own size."""
        size = np.maximum(np.abs(theta), np.abs(theta).max() * 1e-9)
        return np.linalg.lstsq(self.T / size[:, None], theta / size, rcond=None)[0]


def hats(
    x: Float[np.ndarray, " places"], reach: float, knots: int
) -> Float[np.ndarray, "places knots"]:
    """What values at even knots from -reach to reach count for at x: straight between, and on beyond."""
    at = np.linspace(-reach, reach, knots)
    return scipy.interpolate.make_interp_spline(at, np.eye(knots), k=1)(x)


class Place(NamedTuple):
    """Residuals over the noise's deviation at some unknowns, and their derivatives."""

    left: Float[np.ndarray, " rows"]
    jacobian: Float[np.ndarray, "rows unknowns"]


class Optimum(NamedTuple):
    """Where a search ended.

    - `q`: unknowns. `chi`: mean squared residual over the noise's variance, no prior in it.
    - `normal`: equations, prior included, in units of the noise; `deviations` of the priors.
    - `effective`: how many unknowns the data determine. `converged`: whether steps had become small.
    - `setting`: how motions were simulated.
    """

    setting: Setting
    family: Family
    q: Float[np.ndarray, " unknowns"]
    chi: float
    normal: Float[np.ndarray, "unknowns unknowns"]
    deviations: tuple[float, ...]
    effective: float
    converged: bool
    rows: int

    @property
    def bic(self) -> float:
        """Bayesian information criterion: rows log chi + effective parameters log rows."""
        return self.rows * float(np.log(self.chi)) + self.effective * float(np.log(self.rows))

    @property
    def name(self) -> str:
        """The class."""
        if self.family.rate is None:
            return "GeneralizedPlays"
        return "BoucWen" if self.family.words["knots"] == BOUC_WEN else "Duhem"

    @property
    def title(self) -> str:
        """The class with what sets it apart from others of its kind, such as how many knots it has."""
        own = self.family.words
        if self.name == "BoucWen":
            return self.name
        said = f"{self.name}, {own['knots']} knots"
        return said if own.get("symmetric", True) else f"{said}, not symmetric"

    @property
    def words(self) -> dict[str, Any]:
        """Plain data for a file."""
        figures = {"chi2": self.chi, "effective_parameters": self.effective, "bic": self.bic}
        own = {k: v for k, v in self.family.words.items() if k != "first"}
        return {"class": self.name, **figures, "deviations": list(self.deviations), **own}


def covariance_of(
    normal: Float[np.ndarray, "unknowns unknowns"],
) -> Float[np.ndarray, "unknowns unknowns"]:
    """The inverse of normal equations, each unknown in its own size.

    The information on a displacement at first and that on a stiffness are many decades apart; unscaled, the
    smaller one would count as rounding. One of which nothing is known stays 0.
    """
    size = np.sqrt(np.diag(normal))
    size[size == 0] = 1.0
    both = np.outer(size, size)
    return np.linalg.pinv(normal / both, rcond=1e-15, hermitian=True) / both


def levenberg_marquardt(
    setting: Setting,
    family: Family,
    q: Float[np.ndarray, " unknowns"],
    *,
    deviations: Sequence[float] = (),
    rounds: int = 1,
    steps: int = 25,
    tolerance: float = 1e-3,
    damping: float = 1e-2,
    here: Place | None = None,
) -> Optimum:
    """Least squares of the displacement from q, whose place may be known, with a prior of each group: in
    rounds, after each of which its deviation is where the evidence is greatest (MacKay 1992).

    Each unknown is damped in its own size. The search has converged where an undamped step would gain less
    than `tolerance` of the sum of squares, or where `PATIENCE` steps in a row have gained no more. The loop
    of `parametric` is compiled for each number of unknowns, of which a search has eight: that takes 0.8 to
    1.3 s each where the whole search takes 26.
    """
    deviations = tuple(deviations) or tuple(d for _, d in family.groups)
    y, sigma = setting.motion.displacement, setting.motion.sigma
    root, count = family.prior_root(deviations), len(q)

    def look(at: np.ndarray) -> Place | None:
        with np.errstate(over="ignore", invalid="ignore"):  # such slopes are none
            found, jacobian = setting.simulated(family, at)
            if jacobian is None or not np.isfinite(np.linalg.norm(jacobian)):
                return None
        return Place(*(setting.motion.whitened(x) / sigma for x in (y - found, jacobian)))

    def cost_of(place: Place | None, at: np.ndarray) -> float:
        if place is None:
            return np.inf
        return float(place.left @ place.left + np.sum((root * at) ** 2))

    here = here or look(q)
    if here is None:
        return Optimum(setting, family, q, np.inf, np.eye(count), deviations, count, False, len(y))
    cost, still, converged = cost_of(here, q), 0, False
    for step_number in range(steps + 1):
        normal = here.jacobian.T @ here.jacobian + np.diag(root**2)
        right = here.jacobian.T @ here.left - root**2 * q
        size = np.sqrt(np.diag(normal)) + 1e-300
        scaled, right = normal / np.outer(size, size), right / size
        gain = right @ np.linalg.solve(scaled + 1e-12 * np.eye(count), right)
        converged = converged or bool(gain < tolerance * cost) or still == PATIENCE
        if converged or step_number == steps:
            break
        least = damping
        for _ in range(TRIES + 1):
            new = q + np.linalg.solve(scaled + damping * np.eye(count), right) / size
            there = look(new)
            if cost_of(there, new) < cost:
                break
            damping = max(damping, 1e-8) * 10
        if there is None or not cost_of(there, new) < cost:
            converged = True  # rounding: no step is better
            break
        before, cost = cost, cost_of(there, new)
        still = still + 1 if before - cost < tolerance * before else 0
        q, here = new, there
        damping = max(damping * (1.0 if damping > least else 0.1), 1e-12)
    variances, new = np.diag(covariance_of(normal)), []
    if rounds == 1 or not family.groups:
        effective, chi = count - float(variances @ root**2), float(here.left @ here.left) / len(y)
        return Optimum(setting, family, q, chi, normal, deviations, effective, converged, len(y))
    for (group, least), deviation in zip(family.groups, deviations, strict=True):
        gamma = len(group) - float(np.sum(variances[group])) / deviation**2
        size = float(np.sum(q[group] ** 2))
        new.append(float(np.clip(np.sqrt(size / max(gamma, 0.5)), 1e-6 * least, 1e3 * least)))
    return levenberg_marquardt(
        setting, family, q, deviations=new, rounds=rounds - 1, steps=steps, tolerance=tolerance,
        damping=1e-3, here=here,
    )  # fmt: skip
