"""Figures of a report on creep and relaxation: a curve with its range, a spectrum."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ._base import EDGE, GREY, INK, SKY, VERMILLION, Curve, single, styled
from ._format import power_of_ten


class Range(NamedTuple):
    """A predicted curve and the range around it."""

    t: np.ndarray
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray


@styled
def step_answer(
    measured: Sequence[Curve], predicted: Range, span: float, x_label: str, y_label: str, log: str
) -> Figure:
    """Measured rows as dots, the curve and its range over time; `span` is where the fitted rows end.

    `log` names the logarithmic axes: "", "x" or "xy".
    """
    figure, axes = single()
    t, value, low, high = predicted
    axes.fill_between(t, low, high, color=SKY, alpha=0.6, lw=0, label="range, 90 %")
    for name, x, y, colour, _ in measured:
        axes.plot(x, y, ls="", marker="o", ms=2.5, mew=0, color=colour, label=name)
    axes.plot(t, value, lw=1.1, color=VERMILLION, label="model")
    axes.axvline(span, color=EDGE, lw=0.8, ls="--")
    logarithmic(axes, log)
    axes.set(xlabel=x_label, ylabel=y_label)
    figure.legend(loc="outside upper left", ncols=2, columnspacing=1.4, handlelength=1.6)
    return figure


@styled
def spectrum(
    tau: np.ndarray, strength: np.ndarray, error: np.ndarray, inside: tuple[float, float],
    x_label: str, y_label: str,
) -> Figure:  # fmt: skip
    """Strengths over their time constants, with errors (NaN for none); grey outside the record."""
    figure, axes = single()
    logarithmic(axes, "x")
    ends = min(inside[0], *tau) / 3, max(inside[1], *tau) * 3
    for a, b in ((ends[0], inside[0]), (inside[1], ends[1])):
        axes.axvspan(a, b, color=GREY, alpha=0.2, lw=0)
    axes.vlines(tau, 0, strength, color=INK, lw=1.6)
    axes.plot(tau, strength, "o", color=INK, ms=4.5)
    known = np.isfinite(error)
    axes.errorbar(tau[known], strength[known], error[known], ls="", color=VERMILLION, capsize=3)
    axes.set(xlabel=x_label, ylabel=y_label, xlim=ends)
    axes.set_ylim(bottom=0)
    return figure


def _tick(x: float, _: object) -> str:
    return f"{x:g}" if 1e-3 <= x <= 1e4 else power_of_ten(np.log10(x))


def logarithmic(axes: Any, names: str) -> None:
    for name in names:
        getattr(axes, f"set_{name}scale")("log")
        axis = getattr(axes, f"{name}axis")
        axis.set_major_locator(LogLocator(numticks=9))
        axis.set_major_formatter(FuncFormatter(_tick))
        axis.set_minor_formatter(NullFormatter())
