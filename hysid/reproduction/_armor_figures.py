"""Pictures of the virtual experiments, drawn as the paper of Tsuji et al. (2014) draws its own."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from hysteresis.rigs._sponge import SpongeCycles

from ..figures._base import BLUE, DIM, GREEN, GREY, INK, SIZE, VERMILLION, single, styled
from ._armor import METHODS, Rig, body_errors, linear_range

WIDE = (9.6, 3.7)
FORCE, DISPLACEMENT = "force (N)", "displacement (mm)"
LINES = {"1": (VERMILLION, "loading"), "2": (BLUE, "both"), "3": (GREEN, "unloading")}


@styled
def loops(cycles: SpongeCycles, lines: dict[str, Any]) -> Figure:
    """Fig 6: five tests and the three lines."""
    figure, axes = _one("Fig 6. Five tests, three approximations")
    for number, shade in enumerate(np.linspace(0.0, 0.7, 5), start=1):
        rows = np.flatnonzero(cycles.cycle == number)
        rows = np.arange(max(rows[0] - 1, 0), rows[-1] + 1)
        label = {1: "test 1", 5: "test 5"}.get(number)
        axes.plot(cycles.force[rows], cycles.displacement[rows], color=str(shade), lw=0.9,
                  marker="o", ms=2.2, mew=0, label=label)  # fmt: skip
    force = np.array([2.0, 20.0])
    for name, (colour, branch) in LINES.items():
        K, b = float(lines[name].K), float(lines[name].b)
        text = f"{name}: {branch}, {K:.3f} F + {b:.2f}"
        axes.plot(force, K * force + b, color=colour, lw=1.8, label=text)
    axes.legend(loc="lower right")
    return figure


@styled
def aging(fresh: SpongeCycles, aged: SpongeCycles) -> Figure:
    """Fig 9: both records, and their differences sample by sample."""
    figure = Figure(figsize=WIDE, layout="constrained")
    left, right = figure.subplots(1, 2)
    figure.suptitle("Fig 9. The same sponge six months later", fontsize=10)
    left.plot(fresh.force, fresh.displacement, color="#cfe6f5", lw=5, label="fresh")
    left.plot(aged.force, aged.displacement, color=BLUE, lw=0.9, label="after six months")
    K, b = aged.statistics().both
    force = np.array([2.0, 20.0])
    left.plot(force, K * force + b, color=INK, lw=1.4, label=f"aged: {K:.3f} F + {b:.3f}")
    left.plot(force, 1.298 * force + 6.186, color=VERMILLION, lw=1.4, ls="--",
              label="the paper: 1.298 F + 6.186")  # fmt: skip
    left.set(xlabel=FORCE, ylabel=DISPLACEMENT)
    left.legend(loc="lower right")
    right.axhline(0, color="#666666", lw=0.8)
    right.set_title("sample by sample")
    left.set_title("five tests each")
    off = aged.displacement - fresh.displacement
    right.plot(fresh.force, off, ls="", marker="o", ms=3.5, mew=0, color=BLUE, alpha=0.7)
    right.set(xlabel=FORCE, ylabel="aged less fresh (mm)")
    return figure


@styled
def force_range(cycles: SpongeCycles) -> Figure:
    """Fig 7: mean and standard deviation up to 40 N."""
    figure, axes = _one("Fig 7. Linear up to about 25 N")
    found = linear_range(cycles)
    shown = found.line < 1.15 * found.mean.max()
    axes.plot(found.force[shown], found.line[shown], color=BLUE, lw=1.4, label="line, 2 to 20 N")
    axes.errorbar(found.force, found.mean, found.sd, color=INK, lw=1.2, marker="o", ms=3.5,
                  elinewidth=0.9, capsize=2.5, label="mean and standard deviation")  # fmt: skip
    axes.axvline(found.limit, color=VERMILLION, lw=1.2, ls="--", label=f"{found.limit:.1f} N")
    axes.set(xlabel=FORCE, ylabel=DISPLACEMENT, ylim=(0, None))
    axes.legend(loc="lower right")
    return figure


@styled
def thickness(records: dict[float, SpongeCycles]) -> Figure:
    """Fig 10: blocks of other thicknesses."""
    figure, axes = _one("Fig 10. Thickness")
    for (height, cycles), colour in zip(records.items(), (INK, BLUE, VERMILLION), strict=True):
        axes.plot(cycles.force, cycles.displacement, color=colour, lw=1.1, label=f"{height:g} mm")
    axes.legend(loc="upper left")
    return figure


@styled
def surface_1(by_name: Mapping[str, Float[np.ndarray, "rigs points"]]) -> Figure:
    """Fig 12: errors (rigs, 76) in z by `DISPLACEMENTS`, one rig's as dots, the mean of all as lines."""
    figure = Figure(figsize=(9.6, 4.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1, 2.2))
    figure.suptitle("Fig 12. Error in z at the 76 points of surface 1, 15 N", fontsize=10)
    number = np.arange(1, 77)
    styles = {"none": (GREY, "uncompensated")} | {
        name: (colour, f"approximation {name}, {branch}")
        for name, (colour, branch) in LINES.items()
    }
    for name, errors in by_name.items():
        colour, label = styles.get(name, (INK, name))
        axes = above if name == "none" else below
        axes.plot(number, errors[0], ls="", marker="o", ms=2.6, mew=0, color=colour, alpha=0.55)
        for line in range(4):  # the four lines of points
            rows = slice(19 * line, 19 * line + 19)
            axes.plot(number[rows], errors.mean(0)[rows], color=colour, lw=1.5,
                      label=f"{label}: {errors.mean():.1f} mm" if line == 0 else None)  # fmt: skip
    for axes in (above, below):
        for middle in (10, 29, 48, 67):
            axes.axvline(middle, color=DIM, lw=0.8, ls=":")
        axes.grid(axis="x", visible=False)
        axes.set_ylabel("error (mm)")
    above.set_ylim(18, 27)
    below.set_ylim(0, None)
    below.set_xlim(0, 77)
    below.set_xticks((1, 10, 29, 48, 67, 76))
    below.set_xlabel("point: along x, y, both diagonals; dotted: the middle of the surface")
    handles = [h for a in (above, below) for h in a.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, columnspacing=1.4,
                  handlelength=1.4)  # fmt: skip
    return figure


@styled
def body(rigs: Sequence[Rig], names: Sequence[str]) -> Figure:
    """Fig 14: mean errors of 45 points by entries of `METHODS`, dark in mm, light over the shell's size."""
    methods = {name: METHODS[name] for name in names}
    figure, axes = single((1.9 + 1.6 * len(methods), SIZE[1] + 0.3))
    figure.suptitle("Fig 14. Error of 45 points over the body, 15 N", fontsize=10)
    beside = axes.twinx()
    beside.spines["right"].set_visible(True)
    beside.grid(False)
    for n, method in enumerate(methods.values()):
        means = np.array([body_errors(rig, method).mean() for rig in rigs])
        part = 100 / rigs[0].width(method)
        sides = ((axes, n - 0.2, 1.0, BLUE), (beside, n + 0.2, part, "#bcd9ea"))
        for on, at, scale, colour in sides:
            on.bar(at, scale * means.mean(), 0.38, color=colour, yerr=scale * means.std(),
                   error_kw={"lw": 1.0, "capsize": 3, "ecolor": INK})  # fmt: skip
            if method.published is not None:
                on.plot([at], [scale * method.published], marker="D", ms=5, color=VERMILLION, ls="")
    axes.bar([0], [0], color=BLUE, label="mm")
    axes.bar([0], [0], color="#bcd9ea", label="% of the shell's width")
    axes.plot([], [], marker="D", ms=5, color=VERMILLION, ls="", label="published")
    labels = [f"({name}) {method.label}".replace(", ", ",\n") for name, method in methods.items()]
    axes.set_xticks(range(len(methods)), labels)
    axes.grid(axis="x", visible=False)
    top = axes.get_ylim()[1]
    axes.set(ylabel="error (mm)", ylim=(0, top))
    beside.set(ylabel="error over width (%)", ylim=(0, top / 6))
    figure.legend(loc="outside lower center", ncols=3, columnspacing=1.4, handlelength=1.4)
    return figure


def _one(title: str) -> tuple[Figure, Any]:
    figure, axes = single((5.6, 4.0))
    axes.set(xlabel=FORCE, ylabel=DISPLACEMENT, title=title)
    return figure, axes
