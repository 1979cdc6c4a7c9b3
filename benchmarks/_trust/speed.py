"""The time of one plain Python step of the demo's compensator, over its own record."""

import tempfile
import time
from pathlib import Path

import numpy as np

import identify
from compensate.runtime import load
from compensate.runtime._compensator import Compensator
from hysid.commands._asked import Demo, Export

from .._measure import Row, judged

ROUNDS = 5


def rows(quick: bool) -> list[Row]:
    """Processor time, so that what else the computer does counts little: the least of a few rounds."""
    with tempfile.TemporaryDirectory() as place:
        out, file = Path(place) / "demo", Path(place) / "demo.json"
        Demo(out=out, as_json=True).run()
        Export(folder=out, runtime=file).run()
        record, sensor = identify.load(out).train, load(file)
    assert isinstance(sensor, Compensator)
    assert record.time is not None
    dt = np.diff(record.time, prepend=record.time[0]).tolist()
    samples = list(zip(dt, record.output.tolist(), strict=True))
    taken = min(_microseconds(sensor, samples) for _ in range(2 if quick else ROUNDS))
    return [judged("plain Python step of the demo's compensator (us)", taken, 150.0)]


def _microseconds(sensor: Compensator, samples: list[tuple[float, float]]) -> float:
    sensor.reset()
    begin = time.process_time_ns()
    for dt, reading in samples:
        sensor.step(dt, reading)
    return (time.process_time_ns() - begin) / 1e3 / len(samples)
