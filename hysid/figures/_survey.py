"""Figures of many specimens, of creep, relaxation and moduli: spectrum, master curve, shift factors."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

import identify
from identify import FitResult
from identify.results._detail import DiscreteSpectrum
from identify.spectra._superposition import Shifts

from . import _base as f
from ._base import BLUE, GREY, INK, SKY, VERMILLION, WIDE, logarithmic, single, small, styled
from ._format import label, label_of, name_of, pretty

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
    # Of 100 charts, axes that share limits and a layout that is found cost two thirds of the time.
    figure, grid = small(len(drawn), 1.5, 6, WIDE, layout="none")
    height = figure.get_figheight()
    figure.subplots_adjust(0.065, 0.55 / height, 0.995, 1 - 0.25 / height, 0.08, 0.28)
    x, y = (f.widened(np.concatenate([p[k] for _, *both in drawn for p in both])) for k in (0, 1))
    for axes, (name, measured, model) in zip(grid, drawn, strict=True):
        axes.plot(*measured, lw=3, color=f.pale(BLUE))
        axes.plot(*model, lw=1, color=VERMILLION)
        axes.set(xlim=x, ylim=y)
        axes.set_title(f.short(name, 24), fontsize=8.5)
        axes.locator_params(nbins=4)
        axes.label_outer()
    figure.supxlabel(x_label, fontsize=9.5, y=0.08 / height)
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
    f.shared_legend(figure, grid, 3)
    return figure


class Piece(NamedTuple):
    """Rows of one sequence over the reference's clock: "storage", "loss" or "", and its temperature."""

    part: str
    temperature: float
    x: np.ndarray
    y: np.ndarray


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


@styled
def master_of(fit: FitResult) -> Figure:
    """The master curve of a fit: shifted rows, coloured by temperature, and what the spectrum makes of
    them."""
    record, pieces = fit.train, [piece for piece, _ in pieces_of(fit)]
    every = np.concatenate([piece.x for piece in pieces])
    x = np.geomspace(every.min(), every.max(), 300)
    lines = identify.internal.answers_over(_detail(fit), record, x)
    figure, axes = single()
    T = np.array([piece.temperature for piece in pieces])
    warm = Normalize(np.nanmin(T), np.nanmax(T)) if np.isfinite(T).any() else None
    marks = {"storage": "o", "loss": "s", "": "o"}
    for piece in pieces:
        colour = SKY if warm is None else colormaps["coolwarm"](warm(piece.temperature))
        axes.plot(piece.x, piece.y, ls="", marker=marks[piece.part], ms=3, mew=0, color=colour)
    for (part, y), style in zip(lines.items(), ("-", "--"), strict=False):
        axes.plot(x, y, style, lw=1.0, color=INK, label=part or "spectrum")
    if warm is not None:
        figure.colorbar(ScalarMappable(warm, "coolwarm"), ax=axes, label="temperature (°C)")
    logarithmic(axes, "xy")
    axes.set(xlabel=clock_of(fit), ylabel=label_of(record, "output"))
    axes.legend()
    return figure


@styled
def shift_factors(shifts: Shifts) -> Figure:
    """log10 a over temperature with errors, and the law through them."""
    figure, axes = single()
    T = shifts.temperature
    along = np.linspace(T.min(), T.max(), 200)
    law = [shifts.by_law(float(one)) for one in along]
    axes.plot(along, law, lw=1.1, color=VERMILLION, label=shifts.law)
    drawn = {"ls": "", "marker": "o", "ms": 3.5, "color": INK, "capsize": 2, "lw": 0.8}
    axes.errorbar(T, shifts.log_a, shifts.error, **drawn)
    axes.set(xlabel="temperature (°C)", ylabel="log10 of the shift factor")
    axes.legend()
    return figure


def pieces_of(fit: FitResult) -> Iterator[tuple[Piece, np.ndarray]]:
    """Of every sequence the reduced rows that count, and their relative residuals."""
    record, detail = fit.train, _detail(fit)
    relative = fit.residuals / identify.internal.sizes_of(record, fit.used)
    for part, at, temperature, factor in identify.internal.runs_of(record, detail.shifts):
        rows = np.arange(at.start, at.stop)[fit.used[at]]
        x = (record.input if record.time is None else record.time)[rows] * factor
        yield Piece(part, temperature, x, record.output[rows]), relative[rows]


def clock_of(fit: FitResult) -> str:
    """The label of the axis over which all rows lie on one curve."""
    record, shifts = fit.train, _detail(fit).shifts
    moduli = identify.internal.is_moduli(record)
    unit = record.input_unit if moduli else record.time_unit
    what = "frequency" if moduli else name_of(record, "time")
    return label(what if shifts is None else f"reduced {what}", unit)


def _detail(fit: FitResult) -> DiscreteSpectrum:
    assert isinstance(fit.detail, DiscreteSpectrum)
    return fit.detail
