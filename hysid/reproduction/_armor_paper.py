"""Tsuji et al. (2014): sponge, 76 points of surface 1, 45 points of the body."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ._armor import (
    METHODS,
    OURS,
    WORN,
    Rig,
    body_errors,
    changed,
    linear_range,
    nonlinearity,
    surface_errors,
)
from ._frame import Measure, Paper, Say, compared

STRONGLY = 1.5
"""Times the nonlinearity of the others from which that of a thin sponge is seen in a figure."""
MIDDLE = np.array([10, 29, 48, 67]) - 1
"""Rows of the 76 points that lie in the middle of the surface."""


def _sponge(read: Any) -> Measure:
    return lambda rig, _: float(read(rig.fresh.statistics()))


def _body(method: str) -> Measure:
    return lambda rig, ours: float(np.mean(body_errors(rig, METHODS[OURS if ours else method])))


def _surface(name: str) -> Measure:
    return lambda rig, ours: float(np.mean(surface_errors(rig, OURS if ours else name)))


def _largest(rig: Rig, ours: bool) -> float:
    return max(float(np.max(surface_errors(rig, k))) for k in ((OURS,) if ours else "123"))


PAPER = Paper("tsuji2014", {
    "mean_gap": _sponge(lambda s: s.mean_gap),
    "largest_gap": _sponge(lambda s: s.largest_gap),
    "largest_gap_force": _sponge(lambda s: s.largest_gap_force),
    "largest_gap_test": _sponge(lambda s: s.largest_gap_cycle),
    "linear_limit": lambda rig, _: linear_range(rig.to_40),
    "aged_K": lambda rig, _: rig.aged.statistics().both.K,
    "aged_b": lambda rig, _: rig.aged.statistics().both.b,
    **{f"error_{k}": _surface(k) for k in "123"},
    "error_largest": _largest,
    **{f"body_{k}": _body(k) for k in "abc"},
})  # fmt: skip


def carry_out(rigs: int, *, seed: int, ours: bool, say: Say, **_: Any) -> dict[str, Any]:
    """Every number over all rigs, with spread."""
    made = [Rig(seed + n) for n in range(rigs)]
    if ours:
        say("each is also calibrated by twenty presses (--no-ours leaves that out)")

    def progress(done: int) -> None:
        if done % 10 == 0 or done == rigs:
            say(f"rig {done} of {rigs}")

    return {
        "rig": PAPER.said["rig"],
        "rows": compared(PAPER.published, made, ours, progress),
        "findings": _findings(made),
    }


def _findings(rigs: Sequence[Rig]) -> list[dict[str, Any]]:
    """What the paper says in words, and whether the sentence is true of every or the mean rig."""
    count = len(rigs)
    changes = [changed(rig.fresh, rig.aged) for rig in rigs]
    seen = sum(change.p < 0.05 for change in changes)
    told = sum(changed(rig.fresh, rig.worn).p < 0.05 for rig in rigs)
    K, b = (2 * float(np.mean([getattr(c, f) for c in changes])) for f in ("K_error", "b_error"))
    bent = {h: nonlinearity(rigs[0].of_thickness(h, noise=False)) for h in (50.0, 30.0, 10.0)}
    errors = [[float(np.mean(surface_errors(rig, k))) for k in "123"] for rig in rigs]
    first, averages = [np.argmin(row) == 0 for row in errors], np.mean(errors, axis=0)
    around = np.array([surface_errors(rig, "1") for rig in rigs])
    middle, rest = around[:, MIDDLE].mean(1), np.delete(around, MIDDLE, axis=1).mean(1)
    more = middle - rest
    chance = float(np.std(more, ddof=1) / np.sqrt(count)) if count > 1 else np.inf
    largest = np.array([_largest(rig, False) for rig in rigs])
    part = {
        k: 100 * float(np.mean([body_errors(rig, METHODS[k]) for rig in rigs])) / rigs[0].width(METHODS[k])
        for k in "abc"
    }  # fmt: skip
    true = {
        "aging": seen <= 0.05 * count + 2 * np.sqrt(0.05 * 0.95 * count) and told == count,
        "thickness": bent[10.0] > STRONGLY * max(bent[50.0], bent[30.0]),
        "approximation": all(first),
        "middle": more.mean() > 2 * chance,
        "largest": np.max(averages) < 5 and largest.mean() <= 10,
        "relative": abs(part["b"] - part["c"]) < 0.25 * (part["a"] - part["c"]),
    }
    return PAPER.findings(
        true, False, count=count, seen=seen, told=told, lost=100 * WORN, K=K, b_mm=b,
        by_chance=0.05 * count,
        bent=", ".join(f"{x:.2f} % at {h:g} mm" for h, x in bent.items()), strongly=STRONGLY,
        first=sum(first), middle=middle.mean(), rest=rest.mean(), more=more.mean(), chance=chance,
        averages=", ".join(f"{x:.1f}" for x in averages), below=sum(max(row) < 5 for row in errors),
        largest=largest.mean(), up_to_10=sum(largest <= 10), **part,
    )  # fmt: skip
