"""Cycles, instructions and memory of steps on simulated boards."""

import re
import tempfile
from pathlib import Path

import numpy as np

from compensate import adaptive
from compensate.export._export import Program
from compensate.export.targets._export_to import write_to
from hysteresis import (
    AbstractModel,
    Burgers,
    LinearSponge,
    MonotoneCurve,
    PrandtlIshlinskii,
    Record,
    StandardLinearSolid,
    Sum,
)
from tests.boards import OnBoard, on_avr, on_cortex_m4
from tests.judges import JUDGES
from tests.problems import random_histories
from tests.targets import grid
from tests.test_compensate.test_targets import integers

from .._measure import Row, judged, noted

STEP = 0.02
WEIGHTS, IN_TIME = 16, 4200
"""Of an update; instructions in 25 microseconds at 168 MHz."""

ELEMENTS: dict[str, tuple[AbstractModel, bool]] = {
    "line": (LinearSponge(2.0, 1.0), False),
    "standard linear solid": (StandardLinearSolid(1.0, 2.0, 5.0), True),
    "Burgers": (Burgers(2.0, 40.0, 1.0, 5.0), True),
    "4 plays": (
        PrandtlIshlinskii(np.array([0.1, 0.2, 0.4, 0.7]), np.array([0.4, 0.3, 0.2, 0.1]), 0.5), False
    ),
}  # fmt: skip


def _on(
    board: str, model: AbstractModel, rated: bool, real: str, rows: int
) -> tuple[OnBoard, float]:
    """A board's run over a random history, and the largest error in parts of the range."""
    u = random_histories(np.random.default_rng(3), 0.0, 1.0, (1, rows))[0]
    t = STEP * np.arange(rows)
    y = np.asarray(model.simulate(t, u))
    program = Program(model, y, times=t, trained=(0.0, 1.0))
    with tempfile.TemporaryDirectory() as place:
        out = write_to("arduino", program, Path(place) / "sensor", real).path
        header = out / "src" / "sensor.h"
        dt = STEP if rated else 0.0
        run = on_avr if board == "ATmega328" else on_cortex_m4
        if real == "fixed":
            given, number = integers(header, y)
            done = run(header, given, dt)
            value = number(done.words.astype(np.uint32).view(np.int32))
        else:
            done = run(header, y.astype(np.float32), dt)
            value = done.value
    return done, float(np.abs(value - u).max())


def _update() -> Row:
    """Instructions in which a compensator of 16 weights learns from a reference, at most."""
    line = MonotoneCurve(np.array([0.0, 1.0]), np.array([0.1]))
    plays = [PrandtlIshlinskii(np.array([0.05 * k]), np.array([0.3]), 0.1) for k in range(1, 8)]
    model = Sum(line, line, *plays)
    u = random_histories(np.random.default_rng(3), 0.0, 1.0, (1, 400))[0]
    y = np.asarray(model.simulate(None, u)) + 1e-3 * np.random.default_rng(4).normal(size=len(u))
    own = adaptive(model, Record.from_arrays(u, y))
    assert len(own.parts) == WEIGHTS
    program = Program(model, y, adaptive=own)
    with tempfile.TemporaryDirectory() as place:
        out = write_to("arduino", program, Path(place) / "sensor", "float").path
        header = out / "src" / "sensor.h"
        numbers = re.findall(r"sensor_adaptive_parameters sensor_(\d+)", header.read_text())
        done = on_cortex_m4(header, y[:20].astype(np.float32), learner=int(numbers[0]))
    what = f"Cortex-M4: instructions of an update of {WEIGHTS} weights, at most"
    return judged(what, int(done.cycles.max()), IN_TIME)


def boards(quick: bool) -> list[Row]:
    """An ATmega328 in simavr, a Cortex-M4 in QEMU."""
    rows, found = 200 if quick else 1500, []
    if JUDGES["simavr"].missing:
        found.append(noted("ATmega328", float("nan"), reason="no simavr here"))
    else:
        done, error = _on("ATmega328", grid(20), False, "fixed", rows)
        what = "20x20 grid in fixed point: cycles of a step, at most"
        found += [
            judged(f"ATmega328, {what}", int(done.cycles.max()), 3000),
            judged("... RAM with 64 stored reversals, bytes", done.ram, 1200),
            judged("... largest error in parts of the range", error, 2e-4),
        ]  # fmt: skip
        done, _ = _on("ATmega328", grid(20), False, "float", rows // 4)
        found.append(
            noted("... the same in float: cycles of a step, at most", int(done.cycles.max()))
        )
        found.append(noted("... RAM, bytes", done.ram))
    if JUDGES["QEMU"].missing:
        return [*found, noted("Cortex-M4", float("nan"), reason="no qemu-system-arm here")]
    for name, (model, rated) in ELEMENTS.items():
        done, _ = _on("Cortex-M4", model, rated, "float", 100)
        # The first step of an even clock tabulates its exponentials.
        steady = int(done.cycles[2:].max())
        found.append(judged(f"Cortex-M4, {name}: instructions of a step, at most", steady, 250))
    found.append(_update())
    for real in ("float", "fixed"):
        done, _ = _on("Cortex-M4", grid(20), False, real, 100)
        what = f"Cortex-M4, 20x20 grid in {real}: instructions of a step, at most"
        found.append(noted(what, int(done.cycles.max())))
    return found
