"""Figures of a Preisach model's memory and density, and of what a fit is worth: a matplotlib Figure out.

    from hysid import plots
    plots.staircase(u).savefig("staircase.svg")

In the Preisach plane the switch-down threshold beta is drawn to the right and the switch-up threshold
alpha upwards, so relays lie on and above the diagonal. Nothing global is touched.
"""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator
from matplotlib.tri import Triangulation

from hysteresis.preisach import memory_tree
from hysteresis.preisach._memory import MemoryTree
from identify import FitResult
from identify._forc import ForcDiagram
from identify.internal import Identifiability

from .figures._base import BLUE, EDGE, GREY, INK, SQUARE, VERMILLION
from .figures._base import single as _single
from .figures._base import styled as _styled
from .figures._base import triangle as _triangle
from .figures._diagnostics import bands as bands
from .figures._diagnostics import profiles as profiles
from .figures._diagnostics import residual_correlation as residual_correlation
from .figures._diagnostics import waterfall as waterfall
from .figures._format import label, power_of_ten

DOWN = "#ececec"
UP = "#cfe6f5"
SIGNED = LinearSegmentedColormap.from_list(
    "signed", ["#053061", "#2166ac", "#92c5de", "#ffffff", "#f4a582", "#b2182b", "#67001f"]
)
TENTHS = np.arange(1, 10) / 10


@_styled
def staircase(
    input: Float[np.ndarray, " samples"],
    low: float | None = None,
    high: float | None = None,
    *,
    unit: str = "1",
) -> Figure:
    """What a Preisach model remembers of an input: the border between relays that are up and down.

    On the left the input with the reversals that are still remembered; on the right, at the same
    heights, the relays: up below the staircase, down above it.

    **Arguments:**

    - `input`: from negative saturation on.
    - `low`, `high`: where all relays are down and up; the input's own range unless given.
    - `unit`: of the input.

    **Example:**

        >>> figure = hysid.plots.staircase(u, unit="N")
        >>> figure.axes[0].get_xlabel()
        'sample'
    """
    low = float(input.min()) if low is None else low
    high = float(input.max()) if high is None else high
    path = np.append(low, np.clip(input, low, high))
    tree = memory_tree(path)
    open_ = _open(tree, len(path) - 1)
    at = tree.node[open_]
    figure = Figure(figsize=(7.4, 3.7), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1.15, 1))

    left.plot(np.arange(len(input)), path[1:], color=GREY, lw=1.2)
    left.plot(len(input) - 1, path[-1], "s", color=INK, ms=5, zorder=4)
    left.set(xlabel="sample", ylabel=label("input", unit), ylim=(low, high))
    corners = _corners(path[at], path[-1])
    right.fill([low, low, high], [low, high, high], color=DOWN, lw=0)
    right.fill(*np.transpose([[low, low], *corners]), color=UP, lw=0)
    right.plot(*np.transpose(corners), color=INK, lw=1.8, solid_joinstyle="miter")
    right.plot(*np.transpose([[low, low], [high, high]]), color=EDGE, lw=0.8)
    right.plot(path[-1], path[-1], "s", color=INK, ms=5, zorder=4)
    for k, where in zip(open_[1:], at[1:], strict=True):
        level, colour = path[where], _colour(tree, k)
        left.plot([where - 1, len(input) - 1], [level, level], color=colour, lw=0.8, ls=(0, (4, 2)))
        left.plot(where - 1, level, "o", color=colour, ms=5, zorder=4)
        across = [low, level], [level, level]
        border = across if tree.rising[k] < 0 else across[::-1]
        right.plot(*border, color=colour, lw=0.8, ls=(0, (4, 2)))
        right.plot(level, level, "o", color=colour, ms=5, zorder=4)
    right.set(xlabel=label("switch-down threshold β", unit), xlim=(low, high), aspect="equal")
    right.set_ylabel(label("switch-up threshold α", unit))
    right.grid(False)
    _keys(
        figure,
        now={"color": INK, "marker": "s"},
        relays_up={"color": UP, "marker": "s", "ms": 9},
        relays_down={"color": DOWN, "marker": "s", "ms": 9},
    )
    return figure


@_styled
def memory(
    input: Float[np.ndarray, " samples"], low: float | None = None, *, unit: str = "1"
) -> Figure:
    """The memory of a Preisach model over time: the stack of reversals, its pushes and its pops.

    Above, each reversal with a line at its level for as long as it is remembered: two of them are
    wiped out where the input passes the older one again. Below, the stack: one bar for each reversal,
    resting on the one that it hangs on.

    **Arguments:**

    - `input`: from negative saturation on.
    - `low`: where all relays are down; the least input unless given.
    - `unit`: of the input.

    **Example:**

        >>> figure = hysid.plots.memory(u, unit="N")
        >>> figure.axes[0].get_ylabel()
        'input (N)'
    """
    low = float(input.min()) if low is None else low
    path = np.append(low, np.maximum(input, low))
    tree = memory_tree(path)
    depth, end = _lives(tree, path)
    figure = Figure(figsize=(7.4, 4.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1))
    above.plot(np.arange(len(input)), path[1:], color=GREY, lw=1.2)
    for k in range(1, len(tree.node)):
        begin, colour = tree.node[k] - 1, _colour(tree, k)
        level = path[tree.node[k]]
        above.plot([begin, end[k]], [level, level], color=colour, lw=0.8)
        above.plot(begin, level, "o", color=colour, ms=4.5, zorder=4)
        below.barh(depth[k], end[k] - begin, left=begin, height=0.8, lw=0.8,
                   facecolor=(colour, 0.35), edgecolor=colour)  # fmt: skip
    for younger, older in _popped(tree):
        at, levels = end[older], path[tree.node[[older, younger]]]
        above.plot([at, at], levels, color=INK, lw=0.8, ls=":")
        above.plot(at, levels[0], "o", color=INK, mfc="white", ms=4.5, zorder=4)
    above.set(ylabel=label("input", unit), xlim=(0, len(input) - 1))
    deepest = int(depth.max(initial=1))
    below.set(xlabel="sample", ylabel="depth of the stack", ylim=(0.4, deepest + 0.6))
    below.set_yticks(range(1, deepest + 1, -(-deepest // 8)))
    below.grid(axis="y", visible=False)
    _keys(figure, wiped_out={"color": INK, "mfc": "white"})
    return figure


@_styled
def forc(diagram: ForcDiagram, *, input_unit: str = "1", output_unit: str = "1") -> Figure:
    """A FORC diagram: density over coercivity and bias, white at 0, contours at tenths of its peak.

    **Example:**

        >>> diagram = identify.forc_diagram(curves, smoothing=1)
        >>> figure = hysid.plots.forc(diagram, input_unit="N", output_unit="mm")
        >>> figure.axes[0].get_xlabel()
        'coercivity (α − β)/2 (N)'
    """
    x, y, z = diagram.coercivity, diagram.bias, diagram.density
    mesh = Triangulation(x, y)
    sides = np.hypot(*(v[mesh.triangles] - np.roll(v[mesh.triangles], 1, 1) for v in (x, y)))
    mesh.set_mask(sides.max(1) > 4 * np.median(sides))  # gaps between the curves stay empty
    peak = float(np.quantile(np.abs(z), 0.999))
    figure, axes = _single(SQUARE)
    colours = axes.tripcolor(mesh, z, cmap=SIGNED, vmin=-peak, vmax=peak, shading="gouraud")
    axes.tricontour(mesh, z, levels=peak * TENTHS, colors=INK, linewidths=0.5)
    axes.axhline(0, color=EDGE, lw=0.6, ls=":")
    axes.set_aspect("equal")
    axes.set_facecolor(DOWN)  # not measured
    axes.grid(False)
    axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axes.set(xlabel=label("coercivity (α − β)/2", input_unit), xlim=(max(x.min(), 0.0), x.max()),
             ylabel=label("bias (α + β)/2", input_unit), ylim=(y.min(), y.max()))  # fmt: skip
    per = output_unit if input_unit == "1" else f"{output_unit} / {input_unit}²"
    _bar(figure, axes, colours, "density", per)
    return figure


@_styled
def identifiability(found: Identifiability, *, unit: str = "1") -> Figure:
    """How much data tell about each cell of a grid, 0 to 1; the cells the input swept are outlined.

    **Example:**

        >>> found = identify.identifiability(loops, cells=6)
        >>> figure = hysid.plots.identifiability(found, unit="N")
        >>> figure.axes[0].get_xlabel()
        'switch-down threshold β (N)'
    """
    told, excited = found.told, found.excited
    nodes = np.linspace(found.low, found.high, len(told) + 1)
    down, up = label("switch-down threshold β", unit), label("switch-up threshold α", unit)
    shown = np.where(excited, told, np.nan)
    figure = _triangle(nodes, nodes, shown, ~excited, down, up, "how much the data tell")
    axes = figure.axes[0]
    colours = axes.collections[0]
    colours.set_clim(0, 1)
    border = axes.add_collection(
        LineCollection(_border(nodes, excited), colors=INK, linewidths=1.2)
    )
    border.set_clip_path(colours.get_clip_path())
    return figure


@_styled
def candidates(fit: FitResult) -> Figure:
    """The error of every model a fit tried, best first: held out in training, and on the test rows.

    **Example:**

        >>> figure = hysid.plots.candidates(fit)
        >>> [text.get_text() for text in figure.axes[0].get_yticklabels()]
        ['LinearSponge']
    """
    names = [candidate.name for candidate in fit.candidates]
    place = np.arange(len(names))[::-1]
    figure, axes = _single((6.4, 0.8 + 0.42 * len(names)))
    held_out = [candidate.score for candidate in fit.candidates]
    axes.barh(place + 0.18, held_out, 0.34, color=BLUE, label="held out in training")
    tests = [candidate.metrics["test"] for candidate in fit.candidates]
    if all(test is not None for test in tests):
        errors = [test.nrmse_percent for test in tests if test is not None]
        axes.barh(place - 0.18, errors, 0.34, color=VERMILLION, label="test rows")
    axes.set_yticks(place, names)
    axes.set_xlabel("error, % of the output's range")
    axes.legend(frameon=False)
    return figure


def _open(tree: MemoryTree, sample: int) -> list[int]:
    """The anchors remembered at a sample, the oldest first."""
    found = [int(tree.anchor[sample])]
    while found[-1]:
        found.append(int(tree.parent[found[-1]]))
    return found[::-1]


def _popped(tree: MemoryTree) -> list[tuple[int, int]]:
    """The pairs of anchors that were wiped out: the younger one and the older one it hung on."""
    younger = tree.event[tree.event >= len(tree.node)] - len(tree.node)
    return list(zip(younger.tolist(), tree.parent[younger].tolist(), strict=True))


def _lives(tree: MemoryTree, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth of each anchor in the stack, and where between samples of the input it is wiped out."""
    depth, last = np.zeros(len(tree.node), int), tree.node.copy()
    for k in range(1, len(tree.node)):
        depth[k] = depth[tree.parent[k]] + 1
    for sample in range(len(path)):
        last[_open(tree, sample)] = sample
    end = last - 1.0
    for younger, older in _popped(tree):
        before, after = path[last[older] : last[older] + 2]
        end[[younger, older]] = end[older] + (path[tree.node[older]] - before) / (after - before)
    return depth, end


def _corners(reversals: Float[np.ndarray, " open"], now: float) -> list[list[float]]:
    """(beta, alpha) along the border, from the left edge to the diagonal at the present input."""
    low = reversals[0]
    levels = [*reversals[1:], now]
    corners, beta = [], low
    for k, level in enumerate(levels):
        if k % 2 == 0:  # a maximum
            corners.append([beta, level])
        else:
            beta = level
            corners.append([level, levels[k - 1]])
    return [*corners, [now, now]]


def _colour(tree: MemoryTree, anchor: int) -> str:
    return BLUE if tree.rising[anchor] > 0 else VERMILLION


def _keys(figure: Figure, **more: dict[str, Any]) -> None:
    """A legend of the two kinds of reversals and of further marks by name."""
    marks = {"maximum": {"color": VERMILLION}, "minimum": {"color": BLUE}} | more
    handles = [
        Line2D([], [], ls="", label=name.replace("_", " "), **({"marker": "o", "ms": 5} | mark))
        for name, mark in marks.items()
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=len(marks), handlelength=1.0)


def _bar(figure: Figure, axes: Any, drawn: Any, text: str, unit: str) -> None:
    """A colour bar; a power of ten goes from its numbers into the label's unit."""
    bar = figure.colorbar(drawn, ax=axes, shrink=0.85)
    bar.outline.set_visible(False)  # type: ignore[operator]
    power = int(np.floor(np.log10(np.abs(drawn.get_clim()).max() or 1.0)))
    if not -2 <= power <= 3:
        bar.formatter = FuncFormatter(lambda x, _: f"{x / 10.0**power:.3g}".replace("-", "−"))
        unit = power_of_ten(power) + (f" {unit}" if unit != "1" else "")
    bar.set_label(label(text, unit))


def _border(nodes: Float[np.ndarray, " nodes"], cells: np.ndarray) -> list[Any]:
    """The segments between cells that are and are not in a set."""
    framed = np.pad(cells, 1)
    level = [
        [(nodes[j], nodes[i]), (nodes[j + 1], nodes[i])]
        for i, j in np.argwhere(framed[1:, 1:-1] != framed[:-1, 1:-1])
    ]
    upright = [
        [(nodes[j], nodes[i]), (nodes[j], nodes[i + 1])]
        for i, j in np.argwhere(framed[1:-1, 1:] != framed[1:-1, :-1])
    ]
    return level + upright
