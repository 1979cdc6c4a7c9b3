"""What a step of the exported compensator takes on the target that has to keep up."""

import tempfile
import time
from pathlib import Path

import numpy as np

import identify
from compensate.export._export import Program
from compensate.qualification._qualify import Step
from compensate.runtime import load
from hysteresis import InputError

from ._export import readings_of_training

STEPS = 2000
"""Steps that are timed, at most."""


def step_of(fitted: identify.FitResult, target: str, mhz: float | None) -> Step | None:
    """Over the training's readings: "c" by counted operations, a cycle of `mhz` each; "python" timed here.

    None where the compensator cannot be exported.
    """
    readings, times = readings_of_training(fitted)
    try:
        program = Program(fitted.model, readings, times=times, trained=fitted.trained)
    except InputError:
        return None
    if target == "python":
        return Step("plain Python here", _seconds(program, readings, times))
    mean, most, _ = program.operations
    cycle = float("nan") if mhz is None else 1e-6 / mhz
    return Step("C", cycle * mean, cycle * most, mean, most)


def _seconds(program: Program, readings: np.ndarray, times: np.ndarray | None) -> float:
    """The median time of a step."""
    with tempfile.TemporaryDirectory() as place:
        sensor = load(program.write_runtime(Path(place) / "it.json").path)
    clock = np.zeros(len(readings)) if times is None else times
    samples = np.column_stack([np.diff(clock, prepend=clock[0]), readings])[:STEPS].tolist()
    taken = []
    for sample in samples:
        begin = time.perf_counter()
        sensor.step(*sample)
        taken.append(time.perf_counter() - begin)
    return float(np.median(taken))
