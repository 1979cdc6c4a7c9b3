"""Force estimators as files: equal to JAX, and how long a reading takes in plain Python."""

import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np

from compensate.internal import ForceEstimator
from compensate.microchannel import export_force
from compensate.runtime import load
from hysteresis import AbstractModel
from hysteresis.internal import StaircaseNetwork
from hysteresis.rigs import MicrochannelRig

from .._measure import Row, judged, noted
from .everett_network import EverettNetwork

READING = {"thresholds": (0.1, 0.2, 0.4, 0.8), "lags": (0.03, 0.06, 0.12, 0.25, 1.0, 5.0)}
"""What a network sees, as `benchmarks._microchannel.forces` has it: eleven inputs."""
HIGH_N = 8.5

BAR_US, BLOCK = 30.0, 500
SAMPLES, FEW = 20_000, 5_000
MEMBERS, WIDE = 5, (64, 32)
"""Of the mean of networks that `hysid microchannel train` makes."""


def runtime_rows(quick: bool) -> list[Row]:
    """Time of one reading, and the largest difference to JAX over the same readings.

    A network takes the same operations whatever its weights are; the readings are those of the virtual
    sensor under a machine, at 50 a second.
    """
    record = MicrochannelRig(seed=0).cnc_loops(FEW if quick else SAMPLES)
    t, F, z = record.time, record.force[:, 0], record.reading[:, 0]

    def network(seed: int, **options: Any) -> StaircaseNetwork:
        return StaircaseNetwork.random([z], [F], [t], jax.random.key(seed), **READING, **options)

    everett = EverettNetwork.random(jax.random.key(0), high=float(z.max()), force=HIGH_N)
    paper, wide = (
        network(0),
        StaircaseNetwork.mean([network(k, hidden=WIDE) for k in range(MEMBERS)]),
    )
    stream = "(A) stream, one sample in the runtime"
    figures = [_timed(model, t, z) for model in (paper, everett.model, wide)]
    return [
        judged(f"{stream}, (i) network, us", figures[0][0], BAR_US),
        judged(f"{stream}, (ii) Everett network, us", figures[1][0], BAR_US),
        noted(f"    mean of {MEMBERS} networks of {WIDE[0]} and {WIDE[1]}, us", figures[2][0]),
        judged(
            "(A) runtime against JAX, of the largest force", max(off for _, off in figures), 1e-9
        ),
    ]


def _timed(model: AbstractModel, t: np.ndarray, z: np.ndarray) -> tuple[float, float]:
    """Median microseconds of blocks of readings, and how far off."""
    estimator = ForceEstimator(model, 0.05, HIGH_N)
    with tempfile.TemporaryDirectory() as folder:
        runtime = load(export_force(estimator, Path(folder) / "force.json", z, times=t))
    rows = list(zip(z.tolist(), np.diff(t, prepend=t[0]).tolist(), strict=True))
    found, taken = [], []
    for first in range(0, len(rows), BLOCK):
        begin = time.perf_counter_ns()
        found += [runtime.step(dt, reading) for reading, dt in rows[first : first + BLOCK]]
        taken.append((time.perf_counter_ns() - begin) / len(rows[first : first + BLOCK]))
    value = np.array([one.value for one in found])
    off = np.abs(value - np.asarray(estimator.simulate(t, z).value)).max() / HIGH_N
    return statistics.median(taken) / 1e3, float(off)
