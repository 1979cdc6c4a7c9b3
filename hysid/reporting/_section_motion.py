"""Report sections on an oscillator: frequency response, hysteretic force, residuals, classes."""

from typing import Any

import numpy as np

from identify.results._detail import Motion

from ..figures import _base as f
from ..figures._format import label, number, quantity
from ._case import Case, Section, Table

LINES = 400
"""Of a spectrum are shown, each the rms of its neighbours."""


def response(case: Case) -> Section:
    """The best linear approximation, with the levels of noise and of nonlinear distortion."""
    linear = motion_of(case).linear
    x = label("frequency", _rate(case))
    y = label("displacement / force", " / ".join(case.units[::-1]))
    hertz = linear.frequencies
    curves = [f.Curve("measured", hertz, np.abs(linear.response), f.BLUE, "dots")]
    for word, level, colour in (
        ("linear oscillator", np.abs(linear.model(hertz)), f.VERMILLION),
        ("distortion and noise", linear.distortion, f.ORANGE),
        ("noise", linear.noise, f.GREY),
    ):
        if np.isfinite(level).any():
            curves.append(f.Curve(word, hertz, level, colour))
    figure = f.chart(curves, x, y, log="y")
    resonance = quantity(linear.resonance, _rate(case))
    section = Section(
        "Frequency response",
        [f"The best linear oscillator has its undamped resonance at {resonance}."],
    )
    caption = (
        "Distortion is what of the response is not smooth in frequency: where it lies above the noise, the"
        " spring is not linear. Both levels need a force that repeats itself."
    )
    section.draw(figure, "Frequency response with its levels", caption)
    return section


def hysteresis(case: Case) -> Section:
    """The hysteretic force of the model along the fitted motion."""
    motion, fit = motion_of(case), case.fit
    rows = slice(0, motion.recorded.period or len(fit.train))
    y = case.predicted["train"][rows]
    z: Any = np.asarray(motion.recorded.model.hysteresis.simulate(None, y))
    thin = slice(len(y) // 2, None) if len(y) > 200 else slice(None)
    force = label("hysteretic force", case.units[0])
    drawn = f.Curve("", y[thin], z[thin], f.BLUE, "thin")
    figure = f.chart([drawn], case.output_label, force)
    caption = "The hysteretic force over the displacement, of the second half of the fitted motion."
    section = Section("Hysteretic force")
    section.draw(figure, "Hysteretic force over displacement", caption)
    return section


def residuals(case: Case) -> Section:
    """Spectra of output and residuals: what the model leaves at the resonance."""
    fit, motion = case.fit, motion_of(case)
    used = fit.used
    y = np.asarray(fit.train.output)[used]
    left = fit.residuals[used]
    hertz = np.fft.rfftfreq(len(y), motion.recorded.dt)
    both = [np.abs(np.fft.rfft(x - x.mean())) / np.sqrt(len(x)) for x in (y, left)]
    groups = np.array_split(np.arange(1, len(hertz)), min(LINES, len(hertz) - 1))
    at = np.array([hertz[group].mean() for group in groups])
    shown = [np.array([np.sqrt(np.mean(x[group] ** 2)) for group in groups]) for x in both]
    curves = [
        f.Curve("measured output", at, shown[0], f.BLUE),
        f.Curve("residuals", at, shown[1], f.VERMILLION),
        f.Curve("noise", at[[0, -1]], np.full(2, fit.noise.sigma), f.GREY, "dashed"),
    ]
    x_label, y_label = label("frequency", _rate(case)), label("rms per line", case.units[1])
    figure = f.chart(curves, x_label, y_label, log="y")
    caption = (
        f"chi2 per row of the averaged motion is {number(motion.chi2)}; noise alone leaves 1. Residuals"
        " that rise at the resonance mean that the class of hysteresis is wrong."
    )
    section = Section("Residuals")
    section.draw(figure, "Spectra of output and residuals", caption)
    return section


def classes(case: Case) -> Section:
    """The classes of hysteresis that were tried."""
    tried = motion_of(case).classes
    least = min(one["bic"] for one in tried)
    rows = [
        (str(one["class"]), number(one["chi2"]), number(one["effective_parameters"]),
         number(one["bic"] - least))
        for one in tried
    ]  # fmt: skip
    said = "Classes tried, the chosen one first. It was fitted in finer steps than the others."
    columns = ("Class", "chi2 per row", "Effective parameters", "Criterion above the least")
    return Section("Classes of hysteresis", tables=[Table(said, columns, rows, strong=0)])


def motion_of(case: Case) -> Motion:
    """The kind of fit that these sections are about."""
    assert isinstance(case.fit.detail, Motion)
    return case.fit.detail


def _rate(case: Case) -> str:
    """The unit of a frequency."""
    unit = case.fit.train.time_unit
    return "Hz" if unit == "s" else f"1 / {unit}"
