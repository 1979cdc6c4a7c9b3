"""The floors of a virtual sensor: what an estimator that knows its law errs by."""

import numpy as np

from hysid.reproduction._skin import Records, rms
from hysid.reproduction._skin_paper import DT, PAIR, Pressed
from hysteresis.rigs import MicrochannelRig

from .inside import DELAY

MACHINE_FORCE, RATES_N_PER_S, TURNS_PER_S = 7.8, (2.0, 20.0), 1.5
"""How the machine moves."""


def floor(rig: MicrochannelRig, loops: Records, particles: int = 16_000) -> tuple[float, float]:
    """RMSE of the mean of all forces that could have made the readings, as they come and late.

    A particle filter that knows the rig's own law and how the machine moves; no estimator of the same
    readings can do better but by chance.
    """
    random = np.random.default_rng([rig.seed, 7])
    now, late = [], []
    for t, F, z in zip(*loops, strict=True):
        mean, then = _particles(rig, float(t[1] - t[0]), z, particles, random)
        now.append(mean - F)
        late.append(then[DELAY:] - F[:-DELAY])
    return rms(now), rms(late)


def _particles(
    rig: MicrochannelRig, dt: float, z: np.ndarray, count: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Mean force at every reading, and of `DELAY` readings before it."""
    gain = float(rig.readout.scale * rig.gains[0, 0])
    r, share = np.array(rig.stop_travel_n)[:, None], np.array(rig.stop_share)[:, None]
    creep, kept = np.array(rig.creep), np.exp(-dt / np.array(rig.creep_s))[:, None]
    through = float(np.exp(-dt / rig.readout.low_pass_s))
    F, rate, read = np.zeros((3, count))
    slow, fast = np.log(RATES_N_PER_S)
    s, q = np.zeros((len(r), count)), np.zeros((len(creep), count))
    past, mean, then = np.zeros((DELAY + 1, count)), [], []
    for k, reading in enumerate(z):
        turns = (random.random(count) < TURNS_PER_S * dt) | (k == 0)
        fresh = -np.where(rate == 0, -1.0, np.sign(rate))
        fresh *= np.exp(random.uniform(slow, fast, count))
        when = random.random(count)  # of the step, before the turn
        moved = F + dt * np.where(turns, when * rate + (1 - when) * fresh, rate)
        rate = np.where(turns, fresh, rate)
        rate = np.where((moved < 0) | (moved > MACHINE_FORCE), -rate, rate)
        moved = np.clip(moved, 0.0, MACHINE_FORCE)
        s, F = np.clip(s + moved - F, -r, r), moved
        rub = rig.friction * -np.expm1(-F / rig.friction_onset_n) * (share * s / r).sum(0)
        u = F / (1 - F / rig.closing_force_n) * (1 - rub)
        q = kept * q + (1 - kept) * u
        v = (1 - creep.sum()) * u + creep @ q
        read = through * read + (1 - through) * gain * v
        past = np.vstack([F[None], past[:-1]])
        log = -0.5 * ((reading - read) / rig.readout.noise) ** 2
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        mean.append(weight @ F)
        then.append(weight @ past[-1])
        at = np.searchsorted(np.cumsum(weight), (random.random() + np.arange(count)) / count)
        at = np.minimum(at, count - 1)
        F, rate, read, s, q, past = F[at], rate[at], read[at], s[:, at], q[:, at], past[:, at]
    return np.array(mean), np.array(then)


def placement_floor(rig: MicrochannelRig, pressed: Pressed) -> float:
    """RMSE of two fingers' forces where the law and the past are known and the placements are not.

    The channels' signals v = G^-1 reading are off by what the placements do to the layers; the forces by
    that times dF/dv, about F/v, and 1 near no force.
    """
    truth = pressed.truth
    v = rig._closing(pressed.record.force, DT)[:, PAIR]
    seen = np.linalg.solve(rig.readout.scale * rig.gains[:, PAIR], pressed.record.reading.T).T
    slope = np.where(v > 0.3, truth / np.maximum(v, 0.3), 1.0)
    return rms([np.maximum(truth + (np.maximum(seen, 0.0) - v) * slope, 0.0) - truth])
