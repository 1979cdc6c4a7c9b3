"""Figures of many specimens: small loops on one scale, each parameter over the specimens."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ._base import BLUE, SKY, VERMILLION, WIDE, pale, shared_legend, short, small, styled
from ._format import label, pretty

Measured = tuple[np.ndarray, np.ndarray]


class Spread(NamedTuple):
    """One parameter over the specimens: values, the ends of their 90 % intervals (NaN for none), which of
    them stand out, and the 90 % interval of a new specimen, if known."""

    name: str
    unit: str
    value: Float[np.ndarray, " specimens"]
    low: Float[np.ndarray, " specimens"]
    high: Float[np.ndarray, " specimens"]
    out: list[bool]
    new: tuple[float, float] | None


@styled
def loops(drawn: Sequence[tuple[str, Measured, Measured]], x_label: str, y_label: str) -> Figure:
    """A small chart for each specimen, all on one scale: broad what was measured, thin the model."""
    figure, grid = small(len(drawn), 1.5, 6, WIDE, sharex=True, sharey=True)
    for axes, (name, measured, model) in zip(grid, drawn, strict=True):
        axes.plot(*measured, lw=3, color=pale(BLUE))
        axes.plot(*model, lw=1, color=VERMILLION)
        axes.set_title(short(name, 24), fontsize=8.5)
        axes.locator_params(nbins=4)
    figure.supxlabel(x_label, fontsize=9.5)
    figure.supylabel(y_label, fontsize=9.5)
    return figure


@styled
def spreads(found: Sequence[Spread]) -> Figure:
    """Parameters over the specimens, in the order of the table, with their intervals; vermillion, those
    that stand out; pale, where nine of ten new specimens lie."""
    figure, grid = small(len(found), 2.2, 3)
    for axes, s in zip(grid, found, strict=True):
        at, out = np.arange(1, len(s.value) + 1), np.array(s.out)
        if s.new is not None:
            axes.axhspan(*s.new, color=SKY, alpha=0.28, lw=0, label="new specimen, 90 %")
        for which, colour, mark, word in (
            (~out, BLUE, "o", "specimen, 90 %"), (out, VERMILLION, "s", "outlier")
        ):  # fmt: skip
            if which.any():
                axes.vlines(at[which], s.low[which], s.high[which], color=colour, lw=1.2)
                axes.plot(at[which], s.value[which], mark, color=colour, ms=3.5, label=word)
        axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
        axes.yaxis.set_major_locator(MaxNLocator(4))
        axes.set(xlabel="specimen, row of the table", title=label(s.name, pretty(s.unit) or "1"))
    shared_legend(figure, grid, 3)
    return figure
