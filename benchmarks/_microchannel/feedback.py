"""What a force loop can be closed over: a soft sensor's reading as a force, in five ways."""

import itertools
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
import scipy.optimize
import scipy.signal

import hysid
from compensate import export_runtime, invert
from compensate.internal import ChannelSensor, ForceEstimator, MotionFilter, MultiContactEstimator
from compensate.runtime import load
from hysid.reproduction._skin import FORCE, off_of, train_staircase
from hysteresis import AbstractModel, GeneralizedKelvinVoigt, Record, Series
from hysteresis.internal import StaircaseNetwork
from hysteresis.rigs import MicrochannelRig

from .force_loop import ChannelStream

DT, HIGH_N, HELD_N = 0.001, 9.0, 7.8
CALIBRATED_S, EVERY = 120.0, 20
"""Length of the calibration, and which of its readings a model learns from."""

SMOOTH_S = 0.005
"""Of the first-order filter that every reading passes, and the reference it is compared with."""

READING = {"thresholds": (0.1, 0.4, 1.0), "lags": (0.3, 3.0)}
CREEP_S, ROUNDS = (0.1, 0.5, 2.0, 8.0), 4
EPOCHS = 600
MOTION = {"acceleration": 10.0, "turn": 20.0, "turns": 2.0, "ways": 4}
SIGMA_V = 0.01
"""All chosen on the sensors of seeds 50 and 51; those reported are others."""

Samples = np.ndarray
Feedback = Callable[[float], float]
"""From a smoothed reading to a force in N, with a memory of its own."""


class Calibration(NamedTuple):
    """A record at 1 kHz: time in s, force in N and reading in V, both smoothed alike."""

    time: Samples
    force: Samples
    reading: Samples


def calibration(
    rig: MicrochannelRig, seconds: float = CALIBRATED_S, session: int = 0
) -> Calibration:
    """A machine goes to random forces of 0 to 7.8 N at 2 to 60 N/s; every other time it waits there."""
    random = np.random.default_rng([rig.seed, 11, session])
    times, forces = [0.0], [0.0]
    while times[-1] < seconds:
        level = 0.0 if random.random() < 0.12 else random.uniform(0.0, HELD_N)
        rate = np.exp(random.uniform(*np.log((2.0, 60.0))))
        times.append(times[-1] + abs(level - forces[-1]) / rate + DT)
        forces.append(level)
        if random.random() < 0.5:
            times.append(times[-1] + random.uniform(0.3, 3.0))
            forces.append(level)
    t = DT * np.arange(1, round(seconds / DT) + 1)
    force = np.interp(t, times, forces)
    sensor = ChannelStream(rig, dt=DT, session=session)
    reading = np.array([sensor.step(F)[0] for F in force.tolist()])
    # The readout's own low-pass, known from its parts, delays a reading too.
    return Calibration(t, smoothed(smoothed(force, rig.readout.low_pass_s)), smoothed(reading))


def smoothed(values: Samples, tau: float = SMOOTH_S) -> Samples:
    """tau y' + y = values, from 0."""
    kept = np.exp(-DT / tau)
    return np.asarray(scipy.signal.lfilter([1 - kept], [1, -kept], values))


# What is fed back


def by_line(taught: Calibration) -> Callable[[], Feedback]:
    """F = a z + b, by least squares."""
    a, b = np.polyfit(taught.reading, taught.force, 1).tolist()
    return lambda: lambda z: a * z + b


def by_curve(taught: Calibration) -> Callable[[], Feedback]:
    """A polygon that never falls, without memory."""
    z = taught.reading[::EVERY]
    nodes = np.linspace(0.0, z.max(), 25)
    rises = [np.clip((z - a) / (b - a), 0, 1) for a, b in itertools.pairwise(nodes)]
    found, _ = scipy.optimize.nnls(np.column_stack(rises), taught.force[::EVERY])
    forces = np.append(0.0, np.cumsum(found))
    return lambda: lambda z: float(np.interp(z, nodes, forces))


def by_network(taught: Calibration) -> Callable[[], Feedback]:
    """`ForceEstimator` with the network of the reading's memory, compiled."""
    model, off = _learnt(taught.time, taught.reading, taught.force, 2e-3, **READING)
    estimator = ForceEstimator(model, off, HIGH_N)
    return _compiled(estimator, lambda z: z, lambda found: found.value)


def by_filter(taught: Calibration) -> Callable[[], Feedback]:
    """`MultiContactEstimator` of one contact through the network of the force's memory, compiled."""
    model, _ = _learnt(taught.time, taught.force, taught.reading, 3e-3, **FORCE)
    estimator = MultiContactEstimator(
        ChannelSensor([model]), SIGMA_V, MotionFilter(HIGH_N, **MOTION)
    )
    return _compiled(estimator, lambda z: z[None], lambda found: found.value[0])


def by_chain(taught: Calibration) -> Callable[[], Feedback]:
    """Relays and then creep, run backwards in plain Python, without JAX."""
    t, force, reading = (part[EVERY - 1 :: EVERY] for part in taught)
    model = relays_and_creep(t, force, reading)
    with tempfile.TemporaryDirectory() as folder:
        file = export_runtime(model, Path(folder) / "sensor.json", reading, times=t).path
        compensator = load(file)

    def start() -> Feedback:
        compensator.reset()
        return lambda z: compensator.step(DT, z).value

    return start


def relays_and_creep(t: Samples, force: Samples, reading: Samples) -> Series:
    """z = c_0 u + sum of c_k q_k, tau_k q_k' + q_k = u, u = a `Preisach` model of F: fitted in turns.

    The creep of given times is linear in u, and u in the relays' weights; its inverse takes one division,
    that of the relays one search: microseconds, where a sum of both would have to be searched as a whole.
    """
    kept = [np.exp(-(t[1] - t[0]) / tau) for tau in CREEP_S]
    relays, creep = _relays(t, force, reading), None
    for _ in range(ROUNDS):
        u = np.asarray(relays.simulate(t, force))
        delayed = [scipy.signal.lfilter([1 - k], [1, -k], u) for k in kept]
        share, _ = scipy.optimize.nnls(np.column_stack([u, *delayed]), reading)
        share = np.maximum(share / share.sum(), 1e-4)
        creep = GeneralizedKelvinVoigt(1 / share[0], 1 / share[1:], np.array(CREEP_S) / share[1:])
        relays = _relays(t, force, np.asarray(invert(creep).simulate(t, reading).value))
    return Series([relays, creep])


def _relays(t: Samples, force: Samples, reading: Samples) -> AbstractModel:
    rows = len(t)
    record = Record(
        force, reading, t, np.array([0]), ("calibration",), np.ones(rows, bool), np.arange(rows),
        input_unit="N", output_unit="V", time_unit="s",
    )  # fmt: skip
    found = hysid.fit(record, model="Preisach", initial="negative", conditioning="keep")
    return found.model


def _learnt(
    t: Samples, inputs: Samples, outputs: Samples, rate: float, **sees: Any
) -> tuple[StaircaseNetwork, float]:
    """A network that has seen the memory at 1 kHz, taught by every twentieth reading."""
    found = train_staircase([t], [inputs], [outputs], epochs=EPOCHS, rate=rate, every=EVERY, **sees)
    return found.module, off_of(found)


def _compiled(
    estimator: Any, reads: Callable[[Any], Any], tells: Callable[[Any], Any]
) -> Callable[[], Feedback]:
    """One step under `jit`, called from Python with the time."""

    @jax.jit
    def step(state: Any, t: Any, z: Any) -> tuple[Any, Any]:
        state, found = estimator.step(state, t, reads(z))
        return state, tells(found)

    def start() -> Feedback:
        state, n = estimator.init(), 0

        def feedback(z: float) -> float:
            nonlocal state, n
            n += 1
            state, force = step(state, np.float64(DT * n), np.float64(z))
            return float(force)

        return feedback

    return start
