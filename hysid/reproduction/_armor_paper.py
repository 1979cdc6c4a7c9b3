"""Tsuji et al. (2014): sponge, 76 points of surface 1, 45 points of the body."""

from typing import Any

import numpy as np

from hysteresis._atomic_file import write_figure

from . import _armor_figures as figures
from ._armor import DISPLACEMENTS, METHODS, OURS, Rig, surface_errors
from ._armor_rows import PUBLISHED, findings
from ._armor_touches import write_touches
from ._frame import Asked, Paper
from ._published import compared

RIG = (
    "All rigs are virtual: every number beside a published one is computed from synthetic records, none "
    "from a measurement. The foam is a stack of layers with friction and flow (its air moves it by some "
    "micrometres at these rates), the frame sags in many modes, and the sensor is made of strain gauges. "
    "None of them is one of our models as a whole; the friction inside foam and gauges is Bouc-Wen's with "
    "n = 1 and gamma = 0, which is one."
)


def carry_out(asked: Asked) -> dict[str, Any]:
    """Every number over all rigs, with spread; pictures of the first."""
    rigs = [Rig(asked.seed + n) for n in range(asked.rigs)]
    if asked.with_ours:
        asked.say("each is also calibrated by twenty presses (--no-ours leaves that out)")

    def progress(done: int) -> None:
        if done % 10 == 0 or done == asked.rigs:
            asked.say(f"rig {done} of {asked.rigs}")

    document = {
        "rig": RIG,
        "rows": compared(PUBLISHED, rigs, asked.with_ours, progress),
        "findings": findings(rigs),
        "points": _points(rigs, asked.with_ours),
    }
    asked.say("drawing")
    drawn = _draw(rigs, asked)
    document["touches"] = write_touches(rigs[0], asked.out, asked.with_ours)
    return document | {"files": {"touches": "touches.json", **drawn}}


def _points(rigs: list[Rig], with_ours: bool) -> dict[str, Any]:
    """Errors in z at the 76 points, mm: mean and standard deviation over the rigs."""
    names = _some(DISPLACEMENTS, with_ours)
    errors = {name: np.array([surface_errors(rig, name) for rig in rigs]) for name in names}
    return {name: {"mean": e.mean(0), "sd": e.std(0, ddof=1)} for name, e in errors.items()}


def _some(table: dict[str, Any], with_ours: bool) -> list[str]:
    return [name for name in table if with_ours or name != OURS]


def _draw(rigs: list[Rig], asked: Asked) -> dict[str, str]:
    one = rigs[0]
    blocks = {h: one.of_thickness(h) for h in (50.0, 30.0, 10.0)}
    drawn = {
        "fig6": figures.loops(one.fresh, one.lines),
        "fig7": figures.force_range(one.to_40),
        "fig9": figures.aging(one.fresh, one.aged),
        "fig10": figures.thickness(blocks),
        "fig12": figures.surface_1(rigs, _some(DISPLACEMENTS, asked.with_ours)),
        "fig14": figures.body(rigs, _some(METHODS, asked.with_ours)),
    }
    for name, figure in drawn.items():
        write_figure(figure, asked.out / f"{name}.png", dpi=160)
    return {name: f"{name}.png" for name in drawn}


PAPER = Paper(
    "Tsuji et al. (2014) on virtual rigs",
    60,
    6,
    "seconds each, by our methods some twenty",
    carry_out,
)
