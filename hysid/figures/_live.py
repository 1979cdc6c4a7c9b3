"""Figures as numbers: what `plots.js` needs to draw them again on a page where scripts run."""

import math
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from hysteresis._escape import visible

PIXELS = 96 / 72
"""Of a point."""


def live(figure: Figure) -> dict[str, Any] | None:
    """Curves, labels and limits of a figure; None where it is more than lines and ranges over two axes."""
    axes = figure.axes[0]
    ranges = [part for part in axes.collections if isinstance(part, PolyCollection)]
    others = [*axes.patches, *axes.images, *axes.texts, *figure.axes[1:], *axes.child_axes]
    if others or not axes.lines or len(ranges) < len(axes.collections):
        return None
    scales = {"x": axes.get_xscale(), "y": axes.get_yscale()}
    limits = {"x": np.array(axes.get_xlim()), "y": np.array(axes.get_ylim())}
    curves = []
    for part in ranges:
        colour: Any = part.get_facecolor()
        look = {"colour": to_hex(colour[0], keep_alpha=True), "filled": True}
        curves.append((part, np.asarray(part.get_paths()[0].vertices), look))
    for line in axes.lines:
        points = np.array(line.get_xydata(), float)
        for k, name in enumerate("xy"):  # a mark from end to end of an axis is told in shares of it
            if line.get_transform().contains_branch_seperately(axes.transData)[k]:
                continue
            points[:, k] = limits[name][0] + points[:, k] * np.ptp(limits[name])
        dots = line.get_linestyle() == "None"
        size = float(line.get_markersize() if dots else line.get_linewidth())
        look = {"colour": to_hex(line.get_color()), "width": size * PIXELS, "dots": dots}
        if line.get_linestyle() in ("--", ":", "-."):
            look["dash"] = [5, 3] if line.get_linestyle() == "--" else [2, 3]
        curves.append((line, points, look))
    return {
        "x": visible(axes.get_xlabel()), "y": visible(axes.get_ylabel()),
        "logarithmic": "".join(name for name, scale in scales.items() if scale == "log"),
        "limits": {name: ends.tolist() for name, ends in limits.items()},
        "curves": [
            {"name": "" if name.startswith("_") else visible(name), **_numbers(points), **look}
            for part, points, look in curves
            for name in (str(part.get_label()),)
        ],
    }  # fmt: skip


def _numbers(points: np.ndarray) -> dict[str, list[float | None]]:
    """Columns with as many digits as a far zoom shows."""
    found = {}
    for name, column in zip("xy", points.T, strict=True):
        known = column[np.isfinite(column)]
        most, span = np.abs(known).max(initial=0), float(np.ptp(known)) if len(known) else 0.0
        digits = 5 + (max(math.ceil(math.log10(most / span)), 0) if span else 12)
        found[name] = [float(f"{x:.{digits}g}") if np.isfinite(x) else None for x in column]
    return found
