"""Force control at 1 kHz with a soft sensor's estimate fed back: what compensation is worth there.

A machine whose position is commanded presses a virtual sensor. The same controller gets, in turn, the force
by a line, by a curve without memory, by estimators with memory, and the true one.
"""

import time
from collections.abc import Callable
from math import exp
from typing import NamedTuple

import numpy as np

from hysteresis.rigs import MicrochannelRig

from .._measure import Row, judged, means, noted
from .feedback import (
    DT,
    SMOOTH_S,
    Feedback,
    Samples,
    by_chain,
    by_curve,
    by_filter,
    by_line,
    by_network,
    calibration,
)
from .force_loop import ForceLoopRig

KP, KI, WINDUP_N = 0.5, 60.0, 4.0
"""Of the controller: 1, 1/s and N. Chosen with the true force fed back."""

TRUE = "the true force"
KINDS = {
    "a line": by_line,
    "a curve without memory": by_curve,
    "(i) the network, compiled": by_network,
    "(ii) relays and creep run backwards, plain Python": by_chain,
    "(iii) the filter of one contact, compiled": by_filter,
}
PLAIN, COMPENSATED = list(KINDS)[:2], list(KINDS)[2:]
SETTLE = round(0.5 / DT)
"""Steps at the start that are not judged."""


class Run(NamedTuple):
    """The true force and the estimate, at every step."""

    force: Samples
    estimate: Samples


def references(seed: int, seconds: float) -> dict[str, Samples]:
    """What is to be followed, N: steps that are held, three sines, a random staircase."""
    random = np.random.default_rng([seed, 12])
    t = np.arange(0, seconds, DT)
    held = round(seconds / 2)
    found = {"steps": _stairs([2.0, 6.0, 1.0, 5.0, 2.0, 7.0, 3.0][:held], 2.0)}
    for hz in (0.5, 1.0, 2.0):
        sine = 3.5 + 3.0 * np.sin(2 * np.pi * hz * t)
        found[f"sine of {hz:g} Hz"] = np.concatenate([_stairs([3.5], 1.0), sine])
    found["staircase"] = _stairs(random.uniform(0.0, 7.0, round(seconds / 0.8)).tolist(), 0.8)
    return found


def _stairs(levels: list[float], hold: float, rise: float = 0.15) -> Samples:
    """From level to level within `rise` seconds, as half a cosine goes."""
    way = (1 - np.cos(np.pi * np.clip(np.arange(0, hold, DT) / rise, 0, 1))) / 2
    from_to = zip([0.0, *levels[:-1]], levels, strict=True)
    return np.concatenate([a + (b - a) * way for a, b in from_to])


def follow(
    rig: ForceLoopRig, reference: Samples, feedback: Feedback | None, session: int = 0
) -> Run:
    """The loop: command = (r + Kp e + Ki int e dt)/k, e = r behind the readings' low-pass - estimate.

    `feedback`: None for the true force, which is not low-passed.
    """
    loop, kept = rig.start(session), exp(-DT / SMOOTH_S)
    behind = z = integral = estimate = 0.0
    forces, estimates = [], []
    for r in reference.tolist():
        behind = kept * behind + (1 - kept) * r
        e = (r if feedback is None else behind) - estimate
        integral = min(max(integral + KI * DT * e, -WINDUP_N), WINDUP_N)
        pressed = loop.step((r + KP * e + integral) / rig.stiffness)
        z = kept * z + (1 - kept) * pressed.reading[0]
        estimate = pressed.force if feedback is None else feedback(z)
        forces.append(pressed.force)
        estimates.append(estimate)
    return Run(np.array(forces), np.array(estimates))


def control_rows(quick: bool) -> list[Row]:
    """Tracking errors of the true force, what compensation gains, and what a control step takes."""
    found = [_one(seed, quick) for seed in (range(1) if quick else range(3))]
    names = [TRUE, *KINDS]
    over = list(found[0][TRUE])
    mean = {name: means([one[name] for one in found]) for name in names}
    rows = []
    for name in names:
        all_ = float(np.sqrt(np.mean([mean[name][k] ** 2 for k in over[:-1]])))
        mean[name]["all"] = all_
        rows.append(noted(f"(A) force loop, fed back {name}, RMSE, N", all_))
        rows += [noted(f"    {k}, N", mean[name][k]) for k in over[:-1]]
    plain = min(mean[name]["all"] for name in PLAIN)
    gains = {name: plain / mean[name]["all"] for name in COMPENSATED}
    what = "(A) force loop, best without memory to best with it"
    rows.append(judged(what, max(gains.values()), 2.0, at_least=True))
    for name, gain in gains.items():
        rows.append(noted(f"    to {name}", gain))
        rows.append(judged("        its control step, us", mean[name]["us"], 1e6 * DT))
    return rows


def _one(seed: int, quick: bool) -> dict[str, dict[str, float]]:
    """RMSE in N over every reference, and the microseconds of a step, for every kind of feedback."""
    sensor = MicrochannelRig(seed=seed)
    taught = calibration(sensor)
    rig = ForceLoopRig(sensor=sensor)
    wanted = references(seed, 4.0 if quick else 12.0)
    kinds: dict[str, Callable[[], Feedback | None]] = {TRUE: lambda: None}
    kinds |= {name: learn(taught) for name, learn in KINDS.items()}
    figures: dict[str, dict[str, float]] = {}
    for name, start in kinds.items():
        figures[name] = {}
        for session, (what, reference) in enumerate(wanted.items()):
            off = follow(rig, reference, start(), session).force - reference
            figures[name][what] = float(np.sqrt(np.mean(off[SETTLE:] ** 2)))
        figures[name]["us"] = _step_us(start, taught.reading[:3000].tolist())
    return figures


def _step_us(start: Callable[[], Feedback | None], readings: list[float]) -> float:
    """Microseconds of a step: of the estimate, and the few of the controller's own arithmetic."""
    feedback = start()
    if feedback is None:
        return float("nan")
    least, kept, z = float("inf"), exp(-DT / SMOOTH_S), 0.0
    for k in range(0, len(readings), 300):
        begin = time.perf_counter()
        integral = 0.0
        for reading in readings[k : k + 300]:
            z = kept * z + (1 - kept) * reading
            e = 1.0 - feedback(z)
            integral = min(max(integral + KI * DT * e, -WINDUP_N), WINDUP_N)
        least = min(least, (time.perf_counter() - begin) / 300)
    return 1e6 * least
