"""Pictures of a soft sensor's training: arrays in, a matplotlib Figure out."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from hysteresis.numerics._normal import NORMAL_95

from ..figures import _base as f
from ..figures._format import label

MOST_SHOWN = 600
"""Rows of a stream in the picture of the force: more cannot be told apart."""


@f.styled
def learning(curves: Sequence[tuple[Any, Any]], unit: str) -> Figure:
    """Root mean square error over the epochs of every training: learnt from, and held out."""
    figure, axes = f.single((6.4, 3.8))
    for k, (seen, held) in enumerate(curves):
        at = np.arange(1, len(seen) + 1)
        axes.plot(at, np.sqrt(seen), color=f.SKY, lw=0.9, label="" if k else "learnt from")
        if np.isfinite(held).any():
            axes.plot(at, np.sqrt(held), color=f.VERMILLION, lw=0.9, label="" if k else "held out")
            best = int(np.nanargmin(held))
            axes.plot(at[best], np.sqrt(held[best]), "o", color=f.INK, ms=3.5,
                      label="" if k else "kept")  # fmt: skip
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    # 2 and 5 of each decade.
    sparse = FuncFormatter(lambda x, _: f"{x:g}" if f"{x:e}"[0] in "25" else "")
    axes.yaxis.set_minor_formatter(sparse)
    axes.set(xlabel="epoch", ylabel=label("RMSE", unit))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    figure.legend(loc="outside upper left", ncols=3)
    return figure


@f.styled
def force(
    time: Float[np.ndarray, " rows"], measured: Float[np.ndarray, " rows"],
    found: Float[np.ndarray, " rows"], deviation: Float[np.ndarray, " rows"], starts: np.ndarray,
    names: tuple[str, str], units: tuple[str, str],
) -> Figure:  # fmt: skip
    """A force measured and estimated over the first rows, its error with the 90 % band below; and all
    rows against each other. `starts`: where streams begin."""
    figure = Figure(figsize=(9.4, 4.6), layout="constrained")
    sides: Any = figure.subfigures(1, 2, width_ratios=(1.8, 1))
    left, right = sides
    above, below = left.subplots(2, 1, sharex=True, height_ratios=(1.6, 1))
    shown, begin = slice(0, MOST_SHOWN), starts[starts < min(MOST_SHOWN, len(time))]
    t, error = time[shown], (found - measured)[shown]
    every = np.ones(len(t), bool)
    above.plot(*f.trace(t, measured[shown], every, begin), color=f.GREY, lw=2.4, label="measured")
    above.plot(*f.trace(t, found[shown], every, begin), color=f.BLUE, lw=1.1, label="estimated")
    above.set(ylabel=label(names[1], units[1]))
    for a, b in zip(begin, [*begin[1:], len(t)], strict=True):
        half = NORMAL_95 * deviation[a:b]
        below.fill_between(t[a:b], -half, half, color=f.SKY, alpha=0.35, lw=0,
                           label="" if a else "90 % band")  # fmt: skip
    below.plot(*f.trace(t, error, every, begin), color=f.BLUE, lw=0.9)
    below.set(xlabel=label(names[0], units[0]), ylabel=label("error", units[1]))
    axes = right.subplots()
    few = f.thin(4000, measured, found)
    axes.plot(measured[few], found[few], ls="", marker="o", ms=2, mew=0, color=f.BLUE, alpha=0.5)
    ends = [float(np.nanmin(measured)), float(np.nanmax(measured))]
    axes.plot(ends, ends, color=f.EDGE, lw=0.9, ls="--", label="exact")
    axes.set(xlabel=label("measured", units[1]), ylabel=label("estimated", units[1]))
    handles = [h for one in (above, below) for h in one.get_legend_handles_labels()[0]]
    left.legend(handles=handles, loc="outside upper left", ncols=3)
    right.legend(loc="outside upper left")
    return figure


@f.styled
def places(table: dict[str, Any], title: str) -> Figure:
    """A confusion table, each row shaded by the part of its presses."""
    counts = np.array(table["counts"], float)
    size = 0.55 * np.array(counts.shape[::-1]) + (2.2, 1.6)
    figure, axes = f.single(tuple(np.maximum(size, (4.2, 3.2))))
    share = counts / np.maximum(counts.sum(1, keepdims=True), 1)
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1)
    for row, column in np.argwhere(counts):
        axes.text(column, row, f"{counts[row, column]:.0f}", ha="center", va="center",
                  color="white" if share[row, column] > 0.55 else f.INK)  # fmt: skip
    axes.set_xticks(range(counts.shape[1]), [f.short(name, 12) for name in table["estimates"]])
    axes.set_yticks(range(counts.shape[0]), [f.short(name, 12) for name in table["places"]])
    axes.grid(False)
    axes.set(xlabel="estimated place", ylabel="pressed place", title=title)
    return figure


@f.styled
def positions(
    truth: Float[np.ndarray, "rows coordinates"], found: Float[np.ndarray, "rows coordinates"],
    names: Sequence[str], units: Sequence[str],
) -> Figure:  # fmt: skip
    """Where the sensor was pressed, and from there to where it said; of one coordinate both as axes."""
    few = np.linspace(0, len(truth) - 1, min(len(truth), 1200)).astype(int)
    truth, found = truth[few], found[few]
    if truth.shape[1] == 1:
        pairs = [f.Curve("", truth[:, 0], found[:, 0], f.BLUE, "dots")]
        return f.chart(
            pairs, label("pressed", units[0]), label("estimated", units[0]), diagonal=True
        )
    figure, axes = f.single((5.4, 4.8))
    path = np.stack([truth[:, :2], found[:, :2], np.full((len(truth), 2), np.nan)], 1)
    axes.plot(*path.reshape(-1, 2).T, color=f.VERMILLION, lw=0.8, label="off by")
    axes.plot(*truth[:, :2].T, ls="", marker="o", ms=2.4, mew=0, color=f.INK, label="pressed")
    axes.set(xlabel=label(names[0], units[0]), ylabel=label(names[1], units[1]))
    axes.set_aspect("equal", "datalim")
    figure.legend(loc="outside upper left", ncols=2)
    return figure
