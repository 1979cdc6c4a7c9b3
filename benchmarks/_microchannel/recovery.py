"""Random runs of the filter of two contacts behind sensors of another law: how many end in a lock-up.

The virtual sensors have friction in a power of the force and creep, which no model of ours contains, and
the filter is told that forces may be half as high again as in any press. Every run ends at rest. A run is
locked if the forces found in its last second are then off by more than half a newton.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import hysid
from compensate import Status
from compensate.internal import ChannelSensor, MotionFilter, MultiContactEstimator
from hysteresis import Record

from .._measure import Row, judged, noted

HIGH, BEYOND, DT, NOISE = 6.0, 1.5, 0.05, 0.01
"""N, of the presses; how much more the filter allows; s; V."""

SAMPLES, RESTS, LOCKED = 200, 60, 0.5
"""Of a run; of its end without a force; N."""

GUST = 20
"""Samples at rest that are looked at."""


class Law(NamedTuple):
    """v = (1 - g) s + g q,  s = (F / (1 + F / 20 N))^p (1 - a z (1 - exp(-F))),  z a stop of travel r."""

    power: float
    travel: float
    friction: float
    creep: float
    creep_s: float

    @classmethod
    def drawn(cls, random: np.random.Generator) -> "Law":
        """A sensor of the family."""
        ends = ((0.8, 1.3), (0.3, 1.0), (0.03, 0.15), (0.0, 0.1), (0.3, 3.0))
        return cls(*(random.uniform(*end) for end in ends))

    def follow(self, force: Float[np.ndarray, " samples"]) -> Float[np.ndarray, " samples"]:
        """The reading of one contact, V."""
        stop = crept = before = 0.0
        found = np.empty(len(force))
        for k, F in enumerate(force.tolist()):
            stop = min(max(stop + F - before, -self.travel), self.travel)
            before = F
            rubbed = self.friction * stop / self.travel * -np.expm1(-F)
            now = (F / (1 + 0.05 * F)) ** self.power * (1 - rubbed)
            crept -= np.expm1(-DT / self.creep_s) * (now - crept)
            found[k] = (1 - self.creep) * now + self.creep * crept
        return found


def path(random: np.random.Generator, samples: int) -> Float[np.ndarray, " samples"]:
    """Presses with peaks, rates and holds drawn anew, N."""
    force, now = [0.0], 0.0
    while len(force) < samples:
        if random.random() < 0.3:
            force += [now] * int(random.integers(1, 20))
        then = random.uniform(0, HIGH) if random.random() < 0.75 else 0.0
        steps = max(1, int(abs(then - now) / random.uniform(2, 20) / DT))
        force += np.linspace(now, then, steps + 1)[1:].tolist()
        now = then
    return np.array(force[:samples])


def recovery_rows(quick: bool) -> list[Row]:
    """1,000 runs behind 20 sensors; 100 behind 2 if `quick`."""
    sensors, runs = (2, 50) if quick else (20, 50)
    locked, silent, errors = 0, 0, []
    for seed in range(sensors):
        off, status = _runs(np.random.default_rng([24, seed]), runs)
        at_rest = np.sqrt((off[:, -GUST:] ** 2).mean((1, 2)))
        locked += int((at_rest > LOCKED).sum())
        silent += int(((at_rest > LOCKED) & (status[:, -1] == Status.OK)).sum())
        errors.append(np.sqrt((off[:, :-RESTS] ** 2).mean()))
    return [
        judged(
            f"two contacts, other laws: runs of {sensors * runs} that lock up", float(locked), 0.0
        ),
        judged("two contacts, other laws: such runs that end with status OK", float(silent), 0.0),
        noted("two contacts, other laws: error while pressed, N", float(np.median(errors))),
    ]


def _runs(random: np.random.Generator, runs: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors (runs, samples, 2) in N, and statuses."""
    laws = [Law.drawn(random) for _ in range(2)]
    models = []
    for law in laws:
        force = path(random, 800)
        force[-40:] = 0
        read = law.follow(force) + random.normal(0, NOISE / 2, len(force))
        record = Record.from_arrays(force, read, dt=DT, input_unit="N", output_unit="V")
        models.append(hysid.fit(record, "Preisach").model)
    gains = np.array([[1.0, random.uniform(0.3, 0.6)], [random.uniform(0.3, 0.6), 1.0]])
    motion = MotionFilter(high=BEYOND * HIGH)
    estimator = MultiContactEstimator(ChannelSensor(models, gains), [2 * NOISE] * 2, motion)
    truth = np.stack([[path(random, SAMPLES) for _ in laws] for _ in range(runs)])
    truth[:, :, -RESTS:] = 0
    clean = np.stack(
        [[law.follow(one) for law, one in zip(laws, run, strict=True)] for run in truth]
    )
    read = np.einsum("lk,rks->rsl", gains, clean)
    read += random.normal(0, NOISE, read.shape)
    t = DT * np.arange(SAMPLES)
    # One run after the other: side by side, every one of them would search all its range at every reading.
    found = jax.jit(lambda all_: jax.lax.map(lambda y: estimator.simulate(t, y), all_))(
        jnp.array(read)
    )
    return np.asarray(found.value) - truth.transpose(0, 2, 1), np.asarray(found.status)
