"""Tsuji et al. (2014): sponge, 76 points of surface 1, 45 points of the body."""

from collections.abc import Callable
from typing import Any

import numpy as np

from hysteresis._atomic_file import write_figure

from . import _armor_figures as figures
from ._armor import (
    DISPLACEMENTS,
    METHODS,
    OURS,
    STEPS,
    Rig,
    body_errors,
    step_errors,
    surface_errors,
)
from ._armor_rows import BETTER, PUBLISHED, findings
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


SPLIT, SPLIT_TITLE = 6, "Split of the gain: what each addition to the published method brings"
"""Rigs of either physics for the split."""


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
        "rows": compared(PUBLISHED, BETTER if asked.with_ours else {}, rigs, progress),
        "findings": findings(rigs),
        "methods": {name: _method(rigs, name) for name in _some(METHODS, asked.with_ours)},
        "points": _points(rigs, asked.with_ours),
    }
    if asked.with_ours:
        document["split"] = split(rigs[: 2 if asked.quick else SPLIT], asked.say)
        document["tables"] = {SPLIT_TITLE: split_text(document["split"])}
    asked.say("drawing")
    drawn = _draw(rigs, asked)
    document["touches"] = write_touches(rigs[0], asked.out, asked.with_ours)
    return document | {"files": {"touches": "touches.json", **drawn}}


def split(rigs: list[Rig], say: Callable[[str], None]) -> dict[str, Any]:
    """Mean error in mm at the 45 points after each of `STEPS`, on the given rigs and on such `inside`."""
    say(f"splitting the gain, on {len(rigs)} rigs of either physics")
    found = {}
    for where, labs in (
        ("outside", rigs),
        ("inside", [Rig(rig.seed, inside=True) for rig in rigs]),
    ):
        each = [step_errors(lab) for lab in labs]
        for step in STEPS:
            errors = np.array([one[step] for one in each])
            sd = float(errors.std(ddof=1)) if len(errors) > 1 else 0.0
            row = found.setdefault(step, {"rigs": len(rigs)})
            row |= {where: float(errors.mean()), f"{where}_sd": sd}
    first, last = (found[list(STEPS)[k]] for k in (0, -1))
    for row in found.values():
        for where in ("outside", "inside"):
            gain = (first[where] - row[where]) / (first[where] - last[where])
            row[f"{where}_gain_percent"] = 100 * gain
    return found


def split_text(found: dict[str, Any]) -> str:
    """The table of `split`."""
    width = max(map(len, found))
    lines = [
        f"{'':{width}}{'physics outside':>24}{'physics close':>24}",
        f"{'mean error of 45 points':{width}}"
        f"{'our models, mm':>17}{'gain':>7}{'to them, mm':>17}{'gain':>7}",
    ]
    for step, row in found.items():
        line = f"{step:{width}}"
        for where in ("outside", "inside"):
            error = f"{row[where]:.2f} ± {row[f'{where}_sd']:.2f}"
            line += f"{error:>17}{row[f'{where}_gain_percent']:6.0f}%"
        lines.append(line)
    return "\n".join(lines)


def _method(rigs: list[Rig], name: str) -> dict[str, Any]:
    """The mean error of each rig, in mm, and what they have in common."""
    means = np.array([body_errors(rig, name).mean() for rig in rigs])
    method = METHODS[name]
    return {
        "label": method.label,
        "published": method.published,
        "mean": means.mean(),
        "sd": means.std(ddof=1),
        "each": means,
    }


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
        "fig6": figures.loops(one.fresh, one.lines, "Fig 6. Five tests, three approximations"),
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
