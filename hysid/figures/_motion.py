"""Figures of an oscillator: frequency response, hysteretic force, spectrum of the residuals."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ._base import BLUE, GREY, ORANGE, VERMILLION, log_ticks, single, styled


@styled
def frequency_response(
    frequencies: np.ndarray, response: Any, noise: np.ndarray, distortion: np.ndarray, model: Any,
    x_label: str, y_label: str,
) -> Figure:  # fmt: skip
    """The size of output over input in the excited lines, the linear model, and two levels (NaN: none)."""
    figure, axes = single()
    axes.semilogy(frequencies, np.abs(response), ".", ms=2.5, color=BLUE, label="measured")
    axes.semilogy(frequencies, np.abs(model), lw=1.1, color=VERMILLION, label="linear oscillator")
    for level, colour, word in (
        (distortion, ORANGE, "distortion and noise"),
        (noise, GREY, "noise"),
    ):
        if np.isfinite(level).any():
            axes.semilogy(frequencies, level, lw=0.9, color=colour, label=word)
    axes.set(xlabel=x_label, ylabel=y_label)
    log_ticks(axes.yaxis)
    figure.legend(loc="outside upper left", ncols=2, columnspacing=1.4, handlelength=1.6)
    return figure


@styled
def hysteretic_force(
    displacement: np.ndarray, force: np.ndarray, x_label: str, y_label: str
) -> Figure:
    """The model's hysteretic force over the displacement."""
    figure, axes = single()
    axes.plot(displacement, force, lw=0.5, color=BLUE)
    axes.set(xlabel=x_label, ylabel=y_label)
    return figure


@styled
def residual_spectrum(
    frequencies: np.ndarray, output: np.ndarray, residual: np.ndarray, sigma: float, x_label: str,
    y_label: str,
) -> Figure:  # fmt: skip
    """Amplitude densities of the output and of the residuals; white noise of `sigma` is level."""
    figure, axes = single()
    axes.semilogy(frequencies, output, lw=0.8, color=BLUE, label="measured output")
    axes.semilogy(frequencies, residual, lw=0.8, color=VERMILLION, label="residuals")
    axes.axhline(sigma, lw=0.9, ls="--", color=GREY, label="noise")
    axes.set(xlabel=x_label, ylabel=y_label)
    log_ticks(axes.yaxis)
    figure.legend(loc="outside upper left", ncols=3, columnspacing=1.4, handlelength=1.6)
    return figure
