"""Pictures of the virtual skin, drawn as Kim and Park (2018) draw their own."""

import numpy as np
from matplotlib.figure import Figure

from ..figures._base import BLUE, GREEN, GREY, INK, ORANGE, SKY, VERMILLION, single, styled
from ._skin import PLACES, Skin
from ._skin_pair import DT, NAMES, SkinPair

COLOURS = (BLUE, ORANGE, GREEN, VERMILLION, SKY)
MARKS = "os^Dv"


@styled
def loops(skin: Skin, with_ours: bool) -> Figure:
    """Fig 6: four loops that no network has seen, force over reading."""
    figure = Figure(figsize=(9.6, 6.4), layout="constrained")
    figure.suptitle("Fig 6. Force of one contact from one reading", fontsize=10)
    curves = {"network": (skin.by_timeless, VERMILLION)}
    if with_ours:
        curves["ours"] = (skin.by_network, BLUE)
    for n, axes in enumerate(figure.subplots(2, 2, sharex=True, sharey=True).flat):
        z, F = skin.loops.reading[n], skin.loops.force[n]
        axes.plot(z, F, color=GREY, lw=4, alpha=0.6, label="reference")
        for name, (found, colour) in curves.items():
            off = 1e3 * float(np.sqrt(np.mean((found[n] - F) ** 2)))
            axes.plot(z, found[n], color=colour, lw=1.1, label=f"{name}: {off:.0f} mN")
        axes.legend(loc="upper left")
    for axes in figure.axes[2:]:
        axes.set_xlabel("reading (V)")
    for axes in figure.axes[::2]:
        axes.set_ylabel("force (N)")
    return figure


@styled
def places(skin: Skin) -> Figure:
    """Fig 7: both layers' readings of the presses to learn from, dim, and of those asked, dark."""
    figure, axes = single((6.4, 5.0))
    axes.set_title("Fig 7. Readings of presses at five places")
    known, asked = skin.rig.finger_presses(), skin.rig.finger_presses(20, session=1)
    for k, (name, colour, mark) in enumerate(zip(PLACES, COLOURS, MARKS, strict=True)):
        one = known.reading[known.location == k]
        axes.plot(*one.T, ls="", marker=mark, ms=3, mew=0, color=colour, alpha=0.3)
        one = asked.reading[asked.location == k]
        axes.plot(*one.T, ls="", marker=mark, ms=5, mew=0.5, mec=INK, color=colour, label=name)
    axes.set(xlabel="reading of layer 1 (V)", ylabel="reading of layer 2 (V)")
    axes.legend(title="place")
    return figure


@styled
def together(pair: SkinPair, with_ours: bool) -> Figure:
    """Fig 8: the forces of two fingers at once."""
    figure = Figure(figsize=(9.6, 5.4), layout="constrained")
    figure.suptitle("Fig 8. Forces of a finger on B and one on D", fontsize=10)
    found = pair.together
    t = DT * np.arange(1, len(found.truth) + 1)
    for k, axes in enumerate(figure.subplots(2, 1, sharex=True)):
        axes.fill_between(t, found.truth[:, k], color=GREY, alpha=0.45, lw=0, label="reference")
        axes.plot(t, found.paper[:, k], color=VERMILLION, lw=1.1, label="search")
        if with_ours:
            axes.plot(t, found.ours[:, k], color=BLUE, lw=1.1, label="ours")
        axes.set_ylabel(f"force on {NAMES[k]} (N)")
        axes.margins(x=0.01)
    figure.axes[1].set_xlabel("time (s)")
    handles = figure.axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper right", ncols=3)
    return figure
