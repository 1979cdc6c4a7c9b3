"""Kim and Park (2018): force, place, several places, and several forces, from a skin's few readings."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hysteresis._atomic_file import write_figure

from . import _skin_figures as figures
from ._frame import Asked, Paper
from ._published import compared
from ._skin import Skin
from ._skin_pair import OURS_FOR_ONE, SkinPair, of_pair
from ._skin_rows import PUBLISHED, Laboratory, findings

EPOCHS, PAIRS = 1000, 3
"""Of the network of (A), a tenth of them of those of (D); sensors of which (D) is made."""

QUICK_EPOCHS, QUICK_PAIRS, QUICK_SENSORS = 60, 1, 2
"""The same in five minutes on two cores."""

RIG = (
    "All sensors are virtual: every number beside a published one is computed from synthetic records, "
    "none from a measurement."
)

TRAINED = (
    "The networks of (A) are trained for {0:,} epochs, those of the paper for 1,000; in (D) the paper's "
    "recurrent ones for {1:,} at most, of which it prints no number, and ours for {2:,}."
)


def carry_out(asked: Asked) -> dict[str, Any]:
    """(A) to (C) over all sensors, (D) over three; tables and pictures of the first."""
    epochs = asked.epochs or (QUICK_EPOCHS if asked.quick else EPOCHS)
    pairs = QUICK_PAIRS if asked.quick else PAIRS
    of_two = max(1, epochs // 10)
    seeds = range(asked.seed, asked.seed + asked.rigs)
    laboratories = [
        Laboratory(Skin(seed, epochs), SkinPair(seed, of_two) if n < pairs else None)
        for n, seed in enumerate(seeds)
    ]

    def progress(done: int) -> None:
        two = " with two contacts" if done <= pairs else ""
        asked.say(f"sensor {done} of {asked.rigs}{two}")

    document = {
        "rig": f"{RIG} {TRAINED.format(epochs, of_two, OURS_FOR_ONE * of_two)}",
        "epochs": epochs,
        "rows": compared(PUBLISHED, laboratories, asked.with_ours, progress),
        "findings": findings(laboratories, asked.with_ours),
    }
    asked.say("drawing")
    one, pair = laboratories[0].skin, laboratories[0].pair
    assert pair is not None  # the first always is
    document["peaks"] = {
        name: [peak._asdict() for peak in of_pair(pair.together, ours)]
        for name, ours in (("paper", False), ("ours", True))
        if asked.with_ours or not ours
    }
    document["tables"] = _tables(one, document["peaks"], asked.with_ours)
    drawn = {
        "fig6": figures.loops(one, asked.with_ours),
        "fig7": figures.places(one),
        "fig8": figures.together(pair, asked.with_ours),
    }
    return document | {"files": {name: _save(f, asked.out / name) for name, f in drawn.items()}}


def _save(figure: Figure, path: Path) -> str:
    write_figure(figure, path.with_suffix(".png"), dpi=160)
    return f"{path.name}.png"


def _tables(skin: Skin, found: dict[str, Any], with_ours: bool) -> dict[str, str]:
    first = f"sensor {skin.seed}"
    tables = {
        "Table I. Levels of each combination": str(skin.logic),
        f"Table II. Five nearest neighbours, {first}": str(skin.votes),
    }
    if with_ours:
        tables[f"Table II by ours, {first}"] = str(skin.likeliest)
    tables[f"Table III. Three presses of each combination, {first}"] = _logic(skin)
    for name, peaks in found.items():
        tables[f"Peaks of fig 8, {name}, {first}"] = _peaks(peaks)
    return tables


def _logic(skin: Skin) -> str:
    named = {places: "+".join(sorted(map(str, places))) for places in skin.logic.combinations}
    lines = [
        f"{'found, of 3':12}{'all fingers':>15}{'unequal forces':>18}{'the same, by':>18}",
        f"{'':12}{'press with 4 N':>15}{'of 1.5 to 8 N':>18}{'published ranks':>18}",
    ]
    for places, name in named.items():
        right = [
            sum(found == places for pressed, found in every if pressed == places)
            for every in (skin.decisions, skin.unequal, skin.by_ranks)
        ]
        lines.append(f"{name:12}{right[0]:15d}{right[1]:18d}{right[2]:18d}")
    return "\n".join(lines)


def _peaks(peaks: list[dict[str, Any]]) -> str:
    lines = [f"{'place':6}{'time, s':>9}{'force, N':>10}{'found, N':>10}{'late, ms':>10}"]
    for one in peaks:
        line = f"{one['location']:6}{one['time']:9.2f}{one['force']:10.2f}"
        missed = np.isnan(one["found"])
        lines.append(
            line + (f"{'none':>10}" if missed else f"{one['found']:10.2f}{1e3 * one['late']:10.0f}")
        )
    return "\n".join(lines)


PAPER = Paper(
    "Kim and Park (2018) on virtual sensors", 20, QUICK_SENSORS,
    "a minute each, and minutes more for two contacts on the first, or the first three", carry_out,
    (("sklearn", "microchannel"),),
)  # fmt: skip
