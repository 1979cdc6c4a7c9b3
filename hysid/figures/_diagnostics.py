"""Figures of the diagnostics of a fit: results of `identify` in, a matplotlib Figure out."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from identify.diagnostics._profile_likelihood import Profile
from identify.diagnostics._whiteness import Whiteness
from identify.posterior._predictive import Bands
from identify.results._fit_result import Starts

from . import _base as f
from ._base import BLUE, DIM, EDGE, GREEN, GREY, INK, SIZE, SKY, VERMILLION, WIDE, log_ticks, styled
from ._format import label, pretty


@styled
def residual_correlation(found: Whiteness) -> Figure:
    """Correlation of residuals with themselves, the input and its speed, with the band in which 99 of 100
    lags of white residuals lie, and, dotted, the one that holds all lags as often.

    **Example:**

        >>> figure = hysid.plots.residual_correlation(identify.whiteness(fit))
        >>> len(figure.axes)
        3
    """
    charts = {"autocorrelation": found.itself, "with the input": found.input}
    if found.speed is not None:
        charts["with the input's speed"] = found.speed
    figure = Figure(figsize=(WIDE, 2.9), layout="constrained")
    grid = figure.subplots(1, len(charts), sharey=True, squeeze=False)[0]
    most = max(np.abs(c.values).max() for c in charts.values())
    for axes, (title, c) in zip(grid, charts.items(), strict=True):
        axes.axhspan(-c.band, c.band, color=SKY, alpha=0.35, lw=0, label="99 % band of one lag")
        for side in (-1, 1):
            name = "99 % band of all lags" if side > 0 else None
            axes.axhline(side * c.family, color=EDGE, lw=0.8, ls=":", label=name)
        beyond = np.abs(c.values) > c.family
        wide = len(c.lags) <= 60
        axes.vlines(c.lags, 0, c.values, color=BLUE, lw=2 if wide else 0.9)
        axes.vlines(c.lags[beyond], 0, c.values[beyond], color=VERMILLION, lw=2 if wide else 0.9,
                    label="significant")  # fmt: skip
        axes.axhline(0, color=EDGE, lw=0.8)
        axes.set(xlabel="rows before", title=title)
        axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
        axes.set_ylim(-1.15 * max(most, c.family), 1.15 * max(most, c.family))
    grid[0].set_ylabel("correlation")
    f.shared_legend(figure, [grid[0]], 3)
    return figure


@styled
def waterfall(starts: Starts, *, refined: int = 0, unit: str = "1") -> Figure:
    """The error of every start, the best first, and how far from the best its parameters ended.

    Distances are in the unconstrained space: 1 is a factor of e for a positive parameter. The first
    `refined` starts were optimised to convergence.

    **Example:**

        >>> figure = hysid.plots.waterfall(fit.starts, refined=4)
        >>> len(figure.axes)
        2
    """
    errors = np.sqrt(starts.objective)
    rank, same = np.arange(1, len(errors) + 1), errors <= 1.01 * errors[0]
    figure = Figure(figsize=(SIZE[0], 4.2), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1))
    for axes, y in ((above, errors), (below, np.maximum(starts.distance, 1e-6))):
        axes.plot(rank, y, color=DIM, lw=1, zorder=1)
        for which, colour, mark, name in (
            (same, GREEN, "o", "at the lowest error"), (~same, GREY, "s", "other minimum")
        ):  # fmt: skip
            ended = which & (rank <= refined)
            axes.plot(rank[which], y[which], mark, mec=colour, mfc="white", ms=5, label=name)
            axes.plot(rank[ended], y[ended], mark, color=colour, ms=5)
        axes.set_yscale("log")
        finite = y[np.isfinite(y) & (y > 0)]
        if len(finite) and finite.max() < 3 * finite.min():
            axes.set_ylim(0.5 * finite.min(), 3 * finite.max())
        log_ticks(axes.yaxis)
    above.set_ylabel(label("rms error", unit))
    below.set(
        xlabel="start, best first" + (" (filled: optimised to convergence)" if refined else "")
    )
    below.set_ylabel("distance")
    below.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    f.shared_legend(figure, [above], 2)
    return figure


@styled
def profiles(found: Sequence[Profile], errors: Sequence[float | None] = ()) -> Figure:
    """Profile likelihoods: the drop of the log-likelihood as one parameter moves and all others make up
    for it.

    The line is the drop at the interval's ends; dashed, the parabola of the standard error, where there
    is one.

    **Example:**

        >>> figure = hysid.plots.profiles([identify.profile(fit, "K")])
        >>> len(figure.axes)
        1
    """
    figure, grid = f.small(len(found), 1.95, 3 if len(found) in (5, 6) else 4)
    for k, (axes, p) in enumerate(zip(grid, found, strict=True)):
        top = 1.6 * p.bound
        _axis(axes, np.append(p.values[p.drop < 1.3 * p.bound], p.best), p.name, p.unit)
        if k < len(errors) and (error := errors[k]):
            x = np.linspace(p.best - 3 * error, p.best + 3 * error, 121)
            axes.plot(x, ((x - p.best) / error) ** 2 / 2, color=GREY, lw=1, ls="--",
                      label="standard error", scalex=False)  # fmt: skip
        axes.plot(p.values, p.drop, color=BLUE, lw=1.6, marker=".", ms=3, label="profile")
        axes.axhline(p.bound, color=VERMILLION, lw=0.9, label=f"{100 * p.level:.0f} %")
        axes.plot(p.best, 0, "o", color=INK, ms=4)
        for end in (p.low, p.high):
            if end is not None:
                axes.plot([end, end], [0, p.bound], color=VERMILLION, lw=0.8, ls=":")
        for other in p.others:
            axes.plot(other, np.interp(other, p.values, p.drop), "o", mec=INK, mfc="white", ms=4)
        axes.set_ylim(top, -0.08 * top)
    figure.supylabel("drop of the log-likelihood", fontsize=9.5)
    f.shared_legend(figure, grid)
    return figure


@styled
def bands(
    found: Bands,
    x: Float[np.ndarray, " rows"] | None = None,
    *,
    x_label: str = "row",
    y_label: str = "output",
    about: bool = False,
    gaps: Sequence[int] | np.ndarray = (),
) -> Figure:
    """Measured rows over the 50, 90 and 99 % predictive bands.

    **Arguments:** `x` of the rows, their numbers unless given; `about`: with the median taken away, so
    that the bands' widths can be seen; `gaps`: rows before which nothing is connected.

    **Example:**

        >>> found = identify.predictive(fit)
        >>> figure = hysid.plots.bands(found, fit.test.time[found.rows], y_label="x (mm)")
        >>> figure.axes[0].get_ylabel()
        'x (mm)'
    """
    x = found.rows.astype(float) if x is None else x
    take = found.middle if about else np.zeros_like(found.middle)

    def gapped(y: np.ndarray) -> np.ndarray:
        return np.insert(y, gaps, np.nan)

    figure, axes = f.single()
    across = gapped(x)
    for k, name in reversed([*enumerate(("50 %", "90 %", "99 %"))]):
        pale = tuple(1 - (1 - c) * (0.85, 0.5, 0.22)[k] for c in to_rgb(SKY))
        low, high = (gapped(end[k] - take) for end in (found.low, found.high))
        axes.fill_between(across, low, high, color=pale, lw=0, label=name)
    few = len(x) < 300
    axes.plot(across, gapped(found.measured - take), color=INK, lw=0 if about and few else 0.8,
              marker="o" if few else "", ms=2.5, mew=0, label="measured")  # fmt: skip
    if about:
        axes.axhline(0, color=EDGE, lw=0.8)
    axes.set(xlabel=x_label, ylabel=y_label)
    handles, names = axes.get_legend_handles_labels()
    figure.legend(handles[::-1], names[::-1], loc="outside upper left", ncols=4, handlelength=1.4)
    return figure


def _axis(axes: Any, seen: np.ndarray, name: str, unit: str) -> None:
    """The range of a parameter's axis; logarithmic where it spans decades."""
    low, high = float(seen.min()), float(seen.max())
    if low > 0 and high > 30 * low:
        axes.set_xscale("log")
        axes.set_xlim(low / 1.2, high * 1.2)
        log_ticks(axes.xaxis)
    else:
        margin = 0.08 * (high - low) or abs(high) or 1.0
        axes.set_xlim(low - margin, high + margin)
        axes.xaxis.set_major_locator(MaxNLocator(3))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:.5g}".replace("-", "−")))
    axes.set_xlabel(label(name, pretty(unit)))
