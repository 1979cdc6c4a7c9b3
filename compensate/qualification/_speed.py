"""The time of a step, here and on the target, and whether it keeps up with a rate."""

import time
from typing import Any, NamedTuple

import jax
import numpy as np

from hysteresis import Note, Record

from .._contract import AbstractCompensator
from .._readings import readings_of


class Latency(NamedTuple):
    """Seconds of one compiled step, called from Python on this machine; `tail` is the 99.9 % quantile."""

    median: float
    tail: float
    steps: int


class Step(NamedTuple):
    """What one step takes on the target: its name, seconds in the mean and at most, NaN where they are not
    known, and operations in the mean and at most, as they were counted on readings."""

    target: str
    mean: float = float("nan")
    most: float = float("nan")
    operations: float | None = None
    most_operations: int | None = None


def latency(
    compensator: AbstractCompensator, record: Record, steps: int = 2000, seconds: float = 1.0
) -> Latency:
    """Time one compiled step after the other on a record's first rows, for so many steps or seconds."""
    step = jax.jit(lambda state, t, y: compensator.step(state, t, y))
    clock = np.zeros(len(record)) if record.time is None else record.time
    readings = readings_of(compensator, record)
    rows = np.arange(min(steps, int(np.append(record.starts[1:], len(record))[0])))
    state = compensator.init()
    for k in rows[[0, 0, 0]]:  # compiled twice: a first state may be weakly typed
        state, _ = jax.block_until_ready(step(state, clock[k], readings[k]))
    state, taken = compensator.init(), []
    end = time.perf_counter() + seconds
    for k in np.resize(rows, steps):
        begin = time.perf_counter()
        state, _ = jax.block_until_ready(step(state, clock[k], readings[k]))
        taken.append(time.perf_counter() - begin)
        if begin > end:
            break
    return Latency(float(np.median(taken)), float(np.quantile(taken, 0.999)), len(taken))


def speed(found: dict[str, Any]) -> tuple[str, Note] | None:
    """The level and the note of what is said of the rate that is needed."""
    if (rate := found["rate"]) is None:
        return None
    step = found["step"] or Step("JAX, called from Python here,", found["latency"].median)
    if step.operations is not None and not np.isfinite(step.mean):
        text = (
            f"A step in {step.target} takes {step.operations:,.0f} operations in the mean and"
            f" {step.most_operations:,} at most on the training's readings: {rate:g} Hz needs a processor"
            f" of {1e-6 * rate * step.most_operations:.3g} million operations a second."
        )
        return "PASS", Note("needs-processor", text)
    mean, most = (f"{1e6 * x:.3g} µs" for x in (step.mean, step.most))
    one = f"A step in {step.target} takes {mean}:"
    if step.mean > 1 / rate:
        return "FAIL", Note("too-slow", f"{one} too long for {rate:g} Hz.")
    if step.most > 1 / rate:
        text = f"Some steps in {step.target} take {most}: too long for {rate:g} Hz."
        return "CAUTION", Note("sometimes-slow", text)
    return "PASS", Note("fast-enough", f"{one} {rate:g} Hz can be kept up.")
