"""Fits of creep and relaxation: their options, what is in a record, what a prediction is worth."""

from contextlib import suppress
from typing import Any

import numpy as np

import identify
from hysteresis import InputError, Record
from identify.results._detail import DiscreteSpectrum
from identify.spectra._spectrum import Spectrum

from ._options import FIT_FIELDS, OF_SPECTRA

BEYOND = "beyond the trained times"
RANGE = ("since the step", "low", "high")
"""Columns that a step's prediction has besides."""


def step_options(options: dict[str, Any]) -> dict[str, Any]:
    """Those options of `fit` that `fit_step` takes. Raises `InputError` where others were set."""
    why = "Creep, relaxation and moduli are fitted by a spectrum of time constants."
    taken = _only(options, "of_step", "--step, --hold or --frequency", why)
    return taken | _of_parameters(taken.pop("parameters", {}))


def shared_options(options: dict[str, Any]) -> dict[str, Any]:
    """Those that `fit_shared` takes. Raises `InputError` where others were set."""
    return _only(options, "of_shared", "--share", "Specimens are fitted together by least squares.")


def _only(options: dict[str, Any], kind: str, chosen: str, why: str) -> dict[str, Any]:
    others = {k: one.default for k, one in FIT_FIELDS.items() if not one.metadata.get(kind)}
    for name, usual in others.items():
        if options.get(name, usual) != usual:
            raise InputError(
                "bad-option",
                f"--{name} cannot be used with {chosen}.",
                cause=why,
                fix="Leave it out.",
            )
    return {name: value for name, value in options.items() if name not in others}


def _of_parameters(said: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Known strengths, and the bounds of the time constants."""
    found: dict[str, Any] = {"fixed": {}}
    for name, key, value in ((name, *one) for name, own in said.items() for one in own.items()):
        with suppress(TypeError, ValueError):
            if key == "fixed":
                found["fixed"][name] = float(value)
                continue
            if name == "tau" and key == "bounds":
                low, high = map(float, value)
                found["bounds"] = (low, high)
                continue
        raise InputError(
            "bad-option",
            f"{name} {key}={value} cannot be set for a spectrum.",
            fix='Give a known strength ("E_inf fixed=0"), or "tau bounds=LOW,HIGH".',
        )
    return found


def motion_options(options: dict[str, Any]) -> dict[str, Any]:
    """The options of a fit that is no spectrum. Raises `InputError` where one without effect was set."""
    spectrum = "a spectrum", "--step, --hold or --frequency"
    needed: dict[str, tuple[str, str]] = dict.fromkeys(OF_SPECTRA, spectrum)
    if str(options["model"]).casefold().startswith("oscillator"):
        why = "An oscillator is fitted to its motion, with noise of one size."
        given = options | {"parameter": tuple(options["parameters"])}
        options = _only(given, "of_motion", "--model Oscillator", why)
    else:
        needed["oversampling"] = "an oscillator", "--model Oscillator"
    for name, (kind, fix) in needed.items():
        if options.get(name, usual := FIT_FIELDS[name].default) != usual:
            fix = f"Give {fix}, or leave it out."
            raise InputError("bad-option", f"--{name} needs {kind}.", fix=fix)
    return options


def check_step(record: Record) -> dict[str, Any]:
    """What is in a record of creep or relaxation, and what to mind."""
    record = identify.internal.stepped(record)
    kind = identify.internal.kind_of(record)
    rows = record.mask & np.isfinite(record.output)
    t = record.input[rows] if record.time is None else record.time[rows]
    decades = float(np.log10(t.max() / t[t > 0].min()))
    warnings = [str(note) for note in identify.internal.told_by_the_change(record, kind)]
    if decades < 1:
        warnings.append(
            f"The rows span {decades:.2g} decades: more than one time constant can hardly be"
            " told. [short-span]"
        )
    clock = "frequency" if record.time is None else "time"
    text = record.describe(loop=f"step   {kind} over {decades:.2g} decades of {clock}")
    found = {"kind": kind, "decades": decades, "warnings": warnings}
    return {"text": text} | found | record.summary()


def on_the_clock_of(fitted: identify.FitResult, record: Record) -> Record:
    """A record with its step where the fitted one had it: at zero of its clock, or at its first row."""
    return identify.internal.stepped(
        record, at_first_row=identify.internal.is_at_first_row(fitted.train)
    )


def later(fitted: identify.FitResult, record: Record) -> list[str]:
    """What to say about each row of a record: is it beyond the times or frequencies that were fitted?"""
    x = record.input if record.time is None else record.time
    low, high = (-np.inf, _spectrum(fitted).span) if record.time is not None else fitted.trained
    return [BEYOND if not low <= one <= high else "OK" for one in x]


def open_range(fitted: identify.FitResult, record: Record) -> np.ndarray:
    """Of every row the time, the least and the largest output that the fitted record leaves open.

    NaN on the way to a hold, and where there are several runs, or moduli.
    """
    if identify.internal.is_survey(record):
        return np.full((len(record), 3), np.nan)
    assert record.time is not None
    way = identify.internal.way_of(record)
    found = _spectrum(fitted)._replace(way=way)
    _, low, high = found.predict(np.maximum(record.time, 0.0))
    ends = np.sort(np.stack([low, high], 1) * record.input[-1], axis=1)
    ends[record.time < 0] = np.nan
    return np.column_stack([record.time, ends])


def _spectrum(fitted: identify.FitResult) -> Spectrum:
    assert isinstance(fitted.detail, DiscreteSpectrum)
    return fitted.detail.spectrum
