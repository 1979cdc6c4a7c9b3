"""Figures of a report: arrays in, a matplotlib Figure out; nothing global is touched.

Colours are Okabe and Ito's, which the colour-blind can tell apart.
"""

import base64
import io
import math
import warnings
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, Literal, NamedTuple, TypeVar

import matplotlib
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import ListedColormap, to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.path import Path
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from hysteresis._escape import visible

from ._format import power_of_ten

BLUE, GREEN, VERMILLION, ORANGE, SKY = "#0072B2", "#009E73", "#D55E00", "#E69F00", "#56B4E9"
GREY, DIM, INK, EDGE = "#8c8c8c", "#b5b5b5", "#222222", "#666666"
MOST = 4000
"""Points of a curve, at most."""
PIXELS = 96 / 72
"""Of a point."""

STYLE: dict[str, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": EDGE,
    "axes.labelcolor": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.7,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "hatch.color": "#9a9a9a",
    "hatch.linewidth": 0.5,
    "text.parse_math": False,  # a column may be called anything
    "text.usetex": False,
}
SIZE, SQUARE, WIDE = (4.8, 3.5), (4.8, 4.1), 9.8

Made = TypeVar("Made", bound=Callable[..., Any])


def styled(function: Made) -> Made:
    """`function` under this module's style alone, whatever the user's own is."""

    @wraps(function)
    def inside(*arguments: Any, **named: Any) -> Any:
        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            settings: Any = matplotlib.rcParams
            settings.update(STYLE)
            return function(*arguments, **named)

    return inside  # type: ignore[return-value]


@styled
def png(figure: Figure) -> tuple[str, int, int]:
    """A figure as base64 PNG at double density, with its width and height on the page."""
    from PIL import Image

    raw, packed = io.BytesIO(), io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # of a column's name: shown as a box
        figure.savefig(raw, format="png", dpi=192, pil_kwargs={"compress_level": 0})
    image = Image.open(raw).convert("RGB")
    # A palette is a third of the size, and a chart has few colours.
    image.quantize(128, dither=Image.Dither.NONE).save(packed, "png", optimize=True)
    return base64.b64encode(packed.getvalue()).decode(), image.width // 2, image.height // 2


def live(figure: Figure) -> dict[str, Any] | None:
    """Curves, labels and limits of a figure, by which `plots.js` draws it again where scripts run.

    None where it is more than lines and ranges over two axes.
    """
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


class Curve(NamedTuple):
    """One curve of a chart: a line, a broad pale one to lie under it, pale dots, or a line of `LINES`."""

    label: str
    x: np.ndarray
    y: np.ndarray
    colour: str
    kind: Literal["line", "under", "dots", "bold", "thin", "dashed"] = "line"


class Band(NamedTuple):
    """A range around a curve."""

    label: str
    x: np.ndarray
    low: np.ndarray
    high: np.ndarray


LINES = {"line": (1.1, "-"), "bold": (2.2, "-"), "thin": (0.6, "-"), "dashed": (0.9, "--")}
"""Width and style."""


def thin(most: int, *series: np.ndarray) -> np.ndarray:
    """About `most` of the indices of some series, with the extremes of each among them."""
    n = len(series[0])
    if n <= most:
        return np.arange(n)
    width = -(-n // max(most // (2 * len(series)), 1))
    begins = np.arange(0, n, width)
    found = [[0, n - 1]]
    for x in series:
        cut = np.append(x, np.full(len(begins) * width - n, np.nan)).reshape(-1, width)
        low, high = (np.where(np.isnan(cut), end, cut) for end in (np.inf, -np.inf))
        found += [begins + low.argmin(1), begins + high.argmax(1)]
    return np.unique(np.concatenate(found).astype(np.int64))


def trace(
    x: np.ndarray, y: np.ndarray, keep: np.ndarray, starts: np.ndarray, most: int = MOST
) -> tuple[np.ndarray, np.ndarray]:
    """The kept rows as a path with gaps (NaN) where rows or sequences end, thinned."""
    keep = keep & np.isfinite(y)
    cut = np.append(True, keep[1:] != keep[:-1])
    cut[starts] = True
    pieces = [p for p in np.split(np.arange(len(x)), np.flatnonzero(cut)[1:]) if keep[p[0]]]
    share = most / max(int(keep.sum()), 1)
    xs, ys = [], []
    for rows in pieces:
        rows = rows[thin(max(int(share * len(rows)), 4), x[rows], y[rows])]
        xs += [x[rows], [np.nan]]
        ys += [y[rows], [np.nan]]
    return (np.concatenate(xs), np.concatenate(ys)) if xs else (np.empty(0), np.empty(0))


@styled
def chart(
    curves: Sequence[Curve],
    x_label: str,
    y_label: str,
    *,
    limits: tuple[np.ndarray, np.ndarray] | None = None,
    zero: bool = False,
    diagonal: bool = False,
    breaks: Sequence[float] | np.ndarray = (),
    band: Band | None = None,
    end: float | None = None,
    log: str = "",
) -> Figure:
    """Curves over one pair of axes that hold all of `limits` (x, y); `breaks` are ends of sequences, and
    `end` that of what was fitted, dashed. `log` names the logarithmic axes: "", "x", "y" or "xy"."""
    figure, axes = single()
    if band is not None:
        axes.fill_between(band.x, band.low, band.high, color=SKY, alpha=0.6, lw=0, label=band.label)
    if end is not None:
        axes.axvline(end, color=EDGE, lw=0.8, ls="--")
    if zero:
        axes.axhline(0, color=EDGE, lw=0.8)
    for where in breaks:
        axes.axvline(where, color="#cccccc", lw=0.8, ls=":")
    for label, x, y, colour, kind in curves:
        if kind == "dots":
            axes.plot(x, y, ls="", marker="o", ms=1.8 if len(x) > 300 else 4, mew=0,
                      color=pale(colour), label=label)  # fmt: skip
        elif kind == "under":
            few = np.isfinite(y).sum() < 300
            axes.plot(x, y, lw=3, color=pale(colour), label=label,
                      marker="o" if few else "", ms=5.5, mew=0)  # fmt: skip
        else:
            width, style = LINES[kind]
            axes.plot(x, y, lw=width, ls=style, color=colour, label=label)
    logarithmic(axes, log)
    if diagonal:
        low, high = zip(axes.get_xlim(), axes.get_ylim(), strict=True)
        ends = min(low), max(high)
        axes.plot(ends, ends, color=EDGE, lw=0.8, ls="--", label="exact")
    if limits is not None:
        axes.set_xlim(*widened(limits[0]))
        axes.set_ylim(*widened(limits[1]))
    axes.set(xlabel=short(x_label), ylabel=short(y_label))
    _legend(figure)
    return figure


@styled
def corner(labels: Sequence[str], draws: np.ndarray, fitted: Sequence[float]) -> Figure:
    """Histogram of every parameter, scatter of every pair; a log axis where one spans decades."""
    n = len(labels)
    size = 1.7 + 1.35 * n
    figure = Figure(figsize=(size, size), layout="constrained")
    grid = figure.subplots(n, n, squeeze=False)
    shown = draws[np.linspace(0, len(draws) - 1, min(len(draws), 1500)).astype(int)]
    log = [bool((d > 0).all() and np.divide(*np.quantile(d, [0.995, 0.005])) > 30) for d in draws.T]
    see = [np.log10 if is_log else np.asarray for is_log in log]
    ranges = []
    for k in range(n):
        ends = [*np.quantile(see[k](draws[:, k]), [0.005, 0.995])]
        ends += [see[k](fitted[k])] if np.isfinite(fitted[k]) else []
        ranges.append(widened(np.array(ends)))
    for i in range(n):
        for j in range(n):
            axes = grid[i, j]
            if j > i:
                axes.axis("off")
                continue
            axes.grid(False)
            axes.set_xlim(*ranges[j])
            if i == j:
                axes.hist(see[i](draws[:, i]), 40, range=ranges[i], color=SKY)
                axes.set_yticks([])
            else:
                axes.scatter(see[j](shown[:, j]), see[i](shown[:, i]), s=4, lw=0, alpha=0.3, c=BLUE)
                axes.set_ylim(*ranges[i])
                if np.isfinite(fitted[i]):
                    axes.axhline(see[i](fitted[i]), color=VERMILLION, lw=0.9)
                axes.yaxis.set_major_locator(MaxNLocator(3, integer=log[i]))
                axes.yaxis.set_major_formatter(_ticks(log[i]))
            if np.isfinite(fitted[j]):
                axes.axvline(see[j](fitted[j]), color=VERMILLION, lw=0.9)
            axes.xaxis.set_major_locator(MaxNLocator(3, integer=log[j]))
            axes.xaxis.set_major_formatter(_ticks(log[j]))
            axes.tick_params(labelbottom=i == n - 1, labelleft=0 == j < i)
            if i == n - 1:
                axes.set_xlabel(short(labels[j], 24))
                axes.tick_params("x", rotation=40)
            if 0 == j < i:
                axes.set_ylabel(short(labels[i], 24))
    figure.align_labels()
    return figure


@styled
def triangle(x: np.ndarray, y: np.ndarray, values: np.ndarray, unexcited: np.ndarray | None,
             x_label: str, y_label: str, bar_label: str) -> Figure:  # fmt: skip
    """A map over (beta, alpha) with cell edges `x`, `y`; NaN outside, hatched where `unexcited`."""
    figure, axes = single(SQUARE)
    axes.grid(False)
    top = float(np.nanquantile(values, 0.97))
    beyond = bool(np.nanmax(values) > 3 * top > 0)
    mesh = axes.pcolormesh(x, y, values, cmap="Blues", vmin=0, vmax=top if beyond else None)
    inside = Path([(x[0], x[0]), (x[-1], x[-1]), (x[0], x[-1])])
    mesh.set_clip_path(inside, axes.transData)
    if unexcited is not None and unexcited.any():
        veil = np.ma.masked_array(np.ones(unexcited.shape), ~unexcited)
        hatched = axes.pcolor(x, y, veil, cmap=ListedColormap([(1, 1, 1, 0)]), hatch="////",
                              edgecolors="#7a7a7a", lw=0)  # fmt: skip
        hatched.set_clip_path(inside, axes.transData)
    axes.plot([x[0], x[-1]], [x[0], x[-1]], color=EDGE, lw=0.8)
    axes.set_aspect("equal")
    axes.set(xlabel=short(x_label), ylabel=short(y_label))
    bar = figure.colorbar(mesh, ax=axes, shrink=0.85, extend="max" if beyond else "neither")
    bar.set_label(short(bar_label))
    bar.outline.set_visible(False)  # type: ignore[operator]
    return figure


@styled
def panels(names: Sequence[str], x: np.ndarray, y: np.ndarray, y_label: str) -> Figure:
    """A small chart for every row of x and y, all with one scale of y."""
    figure, axes = small(len(names), 1.7, width=WIDE, sharey=True)
    for panel, name, here, there in zip(axes, names, x, y, strict=True):
        panel.axhline(0, color=EDGE, lw=0.8)
        panel.plot(here, there, lw=1.6, color=BLUE)
        panel.set_xlabel(short(name, 30))
        panel.xaxis.set_major_locator(MaxNLocator(4))
    figure.supylabel(short(y_label), fontsize=9.5)
    return figure


def single(size: tuple[float, float] = SIZE) -> tuple[Figure, Any]:
    """A figure of one pair of axes."""
    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots()


def small(
    count: int, height: float, most: int = 4, width: float | None = None,
    layout: Any = "constrained", **shared: Any,
) -> tuple[Figure, list[Any]]:  # fmt: skip
    """A figure of so many small charts, at most `most` beside each other."""
    across = min(count, most)
    down = -(-count // across)
    width = width or (WIDE if across > 2 else 4.9 * across)
    figure = Figure(figsize=(width, 0.6 + height * down), layout=layout)
    grid = figure.subplots(down, across, squeeze=False, **shared)
    for axes in grid.flat[count:]:
        axes.set_visible(False)
    return figure, list(grid.flat[:count])


def shared_legend(figure: Figure, grid: Sequence[Any], columns: int | None = None) -> None:
    """One legend of all charts, each name once."""
    found: dict[str, Any] = {}
    for axes in grid:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(name, handle)
    names, handles = list(found), list(found.values())
    figure.legend(handles, names, loc="outside upper left", ncols=columns or len(found))


def _legend(figure: Figure) -> None:
    """Above the axes, where it hides nothing."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if labels:
        figure.legend(handles, [short(x, 36) for x in labels], loc="outside upper left",
                      ncols=min(len(labels), 3 if sum(map(len, labels)) < 42 else 2),
                      columnspacing=1.4, handlelength=1.6, markerscale=1.6)  # fmt: skip


def pale(colour: str) -> tuple[float, ...]:
    """Half way to white: unlike transparency it does not darken where a line crosses itself."""
    return tuple(0.5 + 0.5 * c for c in to_rgb(colour))


def widened(x: np.ndarray) -> tuple[float, float]:
    low, high = float(np.nanmin(x)), float(np.nanmax(x))
    margin = 0.04 * (high - low) or 1.0
    return low - margin, high + margin


def logarithmic(axes: Any, names: str) -> None:
    """Make the axes of these names, "x" or "xy", logarithmic."""
    for name in names:
        getattr(axes, f"set_{name}scale")("log")
        log_ticks(getattr(axes, f"{name}axis"), 9)


def log_ticks(axis: Any, most: int = 4) -> None:
    """So many labels of a logarithmic axis at most, without mathematical text."""
    axis.set_major_locator(LogLocator(numticks=most))
    axis.set_major_formatter(
        FuncFormatter(lambda x, _: f"{x:.3g}" if 1e-3 <= x <= 1e4 else power_of_ten(np.log10(x), 3))
    )
    axis.set_minor_formatter(NullFormatter())


def _ticks(log: bool) -> FuncFormatter:
    return FuncFormatter(lambda x, _: power_of_ten(x) if log else f"{x:.4g}")


def short(text: str, most: int = 44) -> str:
    text = " ".join(text.split())
    return text if len(text) <= most else text[: most - 1] + "…"
