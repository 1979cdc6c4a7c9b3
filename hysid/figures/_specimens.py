"""Figures of many specimens: small loops as SVG paths on one scale, each parameter over the specimens."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ._base import BLUE, SKY, VERMILLION, shared_legend, small, styled
from ._format import label, number, pretty

BOX = (200, 150)
LEFT, RIGHT, TOP, BOTTOM = 30, 192, 10, 130
"""Of a small chart's plane, in the box."""


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


class Plane:
    """The common scale of small charts: from readings to the box, its grid and its ticks."""

    def __init__(self, xs: Sequence[np.ndarray], ys: Sequence[np.ndarray]):
        self._x, self._y = _nice(xs), _nice(ys)
        across, up = self._across(self._x), self._up(self._y)
        lines = [f"M{x:.4g} {TOP}V{BOTTOM}" for x in across]
        self.grid = "".join(lines + [f"M{LEFT} {y:.4g}H{RIGHT}" for y in up])
        ends = [(LEFT, self._x[0]), (RIGHT, self._x[-1])]
        self.ticks = [(float(x), BOTTOM + 15.0, "middle", _short(v)) for x, v in ends]
        ends = [(BOTTOM, self._y[0]), (TOP, self._y[-1])]
        self.ticks += [(LEFT - 5.0, y + 4.0, "end", _short(v)) for y, v in ends]

    def path(self, x: np.ndarray, y: np.ndarray) -> str:
        """A curve with gaps where it is NaN."""
        words, pen = [], "M"
        for a, b in zip(self._across(x), self._up(y), strict=True):
            if np.isfinite(a) and np.isfinite(b):
                words.append(f"{pen}{a:.1f} {b:.1f}")
                pen = "L"
            else:
                pen = "M"
        return "".join(words)

    def _across(self, x: np.ndarray) -> np.ndarray:
        return LEFT + (x - self._x[0]) / (self._x[-1] - self._x[0]) * (RIGHT - LEFT)

    def _up(self, y: np.ndarray) -> np.ndarray:
        return BOTTOM - (y - self._y[0]) / (self._y[-1] - self._y[0]) * (BOTTOM - TOP)


def _nice(values: Sequence[np.ndarray]) -> np.ndarray:
    joined = np.concatenate([v[np.isfinite(v)] for v in values])
    low, high = (joined.min(), joined.max()) if len(joined) else (0.0, 1.0)
    return np.asarray(MaxNLocator(4, min_n_ticks=2).tick_values(low, high))


def _short(x: float) -> str:
    return f"{x:.4g}".replace("-", "−") if x == 0 or 1e-3 <= abs(x) < 1e5 else number(x)


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
