"""The data sheet of a sensor as a page: four pictures, and every line with its definition."""

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from identify.results._data_sheet import DataSheet

from . import _base as f
from ._format import axes_of, label, measured, name_of, number, pretty

PAGE = (8.27, 11.69)
"""A4, in inches."""

TOP, LINE = 0.535, 0.0253
"""Of the page: where the lines begin, and the height of one with its definition."""


@f.styled
def draw_panel(sheet: DataSheet, draw: Callable[[DataSheet, Any], None]) -> Figure:
    """One of the pictures alone."""
    figure, axes = f.single()
    draw(sheet, axes)
    return figure


@f.styled
def draw_sheet(sheet: DataSheet) -> Figure:
    """The whole sheet on one page."""
    figure = Figure(figsize=PAGE)
    figure.text(0.07, 0.962, title(sheet), fontsize=15, weight="bold", color=f.INK)
    figure.text(0.07, 0.944, subtitle(sheet), fontsize=8.5, color=f.EDGE)
    for k, (draw, _) in enumerate(PANELS):
        axes = figure.add_axes((0.1 + 0.465 * (k % 2), 0.772 - 0.198 * (k // 2), 0.385, 0.142))
        axes.tick_params(labelsize=7.5)
        for axis in (axes.xaxis, axes.yaxis):
            axis.label.set_fontsize(8)
        draw(sheet, axes)
    for k, row in enumerate(sheet.rows):
        y = TOP - LINE * k - 0.01
        figure.text(0.07, y, f.short(row.name, 34), fontsize=8.5, weight="bold", color=f.INK)
        figure.text(0.50, y, measured(row), fontsize=8.5, color=f.INK, ha="right")
        figure.text(0.52, y, row.basis or row.reason, fontsize=7.5, color=f.EDGE)
        figure.text(0.07, y - 0.0097, row.definition, fontsize=6.6, color=f.EDGE)
    return figure


def title(sheet: DataSheet) -> str:
    """What is measured by what."""
    return f"Data sheet: {name_of(sheet.record, 'output')} for {name_of(sheet.record, 'input')}"


def subtitle(sheet: DataSheet) -> str:
    """Range, runs and loops."""
    record, unit = sheet.record, pretty(sheet.record.input_unit)
    runs, width = len(record.labels), (sheet.high - sheet.low) / 10
    told = [
        f"Range {number(sheet.low, width)} to {number(sheet.high, width)} {unit}".rstrip(),
        f"{len(sheet.rising)} loops of {runs} run{'s' * (runs != 1)}",
        f"{len(record):,} rows" + (f" of {record.source}" if record.source else ""),
    ]
    basis = "Per cent are of the full-scale output, unless a line says of the reading."
    return f"{'; '.join(told)}. {basis}"


def _line(sheet: DataSheet) -> np.ndarray:
    return sheet.zero + sheet.scale * (sheet.inputs - sheet.low) / (sheet.high - sheet.low)


def _curve(sheet: DataSheet, axes: Any) -> None:
    record = sheet.record
    path = f.trace(record.input, record.output, record.mask, record.starts, 1500)
    axes.plot(*path, lw=0.5, color=f.DIM)
    axes.plot(sheet.inputs, _line(sheet), lw=0.9, ls="--", color=f.EDGE, label="terminal line")
    for curves, colour, word in _branches(sheet):
        axes.plot(sheet.inputs, curves.mean(0), lw=1.3, color=colour, label=word)
    axes.legend(fontsize=7)
    x, y = axes_of(record)
    axes.set(xlabel=x, ylabel=y)


def _deviation(sheet: DataSheet, axes: Any) -> None:
    axes.axhline(0, color=f.EDGE, lw=0.8)
    for curves, colour, word in _branches(sheet):
        apart = _percent(sheet, curves.mean(0) - _line(sheet))
        axes.plot(sheet.inputs, apart, lw=1.3, color=colour, label=word)
    axes.set(xlabel=axes_of(sheet.record)[0], ylabel="from terminal line (%)")


def _scatter(sheet: DataSheet, axes: Any) -> None:
    axes.axhline(0, color=f.EDGE, lw=0.8)
    for curves, colour, _ in _branches(sheet):
        apart = _percent(sheet, curves - curves.mean(0)).T
        axes.plot(sheet.inputs, apart[:, :40], lw=0.6, color=colour, alpha=0.7)
    axes.set(xlabel=axes_of(sheet.record)[0], ylabel="loop less mean loop (%)")


def _creep(sheet: DataSheet, axes: Any) -> None:
    for t, y in sheet.holds[:40]:
        axes.plot(t - t[0], _percent(sheet, y - y[0]), lw=0.9, color=f.VERMILLION)
    unit = sheet.record.time_unit
    axes.set(xlabel=label("time of the hold", unit), ylabel="change in a hold (%)")
    if not sheet.holds:
        how = {"ha": "center", "transform": axes.transAxes, "color": f.EDGE}
        axes.text(0.5, 0.5, "the input is never held", **how)


def _branches(sheet: DataSheet) -> tuple[tuple[np.ndarray, str, str], ...]:
    return (sheet.rising, f.ORANGE, "upscale"), (sheet.falling, f.BLUE, "downscale")


def _percent(sheet: DataSheet, y: np.ndarray) -> np.ndarray:
    return 100 * y / abs(sheet.scale)


PANELS: tuple[tuple[Callable[[DataSheet, Any], None], str], ...] = (
    (
        _curve,
        "The readings (grey), the mean upscale and downscale curves, and the line through their ends.",
    ),
    (
        _deviation,
        "Deviation of the mean curves from that line: their distance is the hysteresis, their bend the"
        " non-linearity.",
    ),
    (_scatter, "Every loop less the mean loop: repeatability, and what differs between runs."),
    (_creep, "Change of the output while the input is held in the upper half of the range."),
)
"""The pictures of a sheet, and what to look for in each."""
