"""Fits of many specimens: where they lie, what each says of its parameters, and which stand out."""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

import identify
from hysteresis import InputError
from hysteresis._limits import damage_told
from hysteresis.numerics._functions import NORMAL_95
from identify import load_posterior

from ..figures._format import quantity
from ..intake._folders import folders_of

FAR = 3.5
"""Robust deviations from the median beyond which a specimen is an outlier."""

FEW = 5
"""Number of specimens below which outliers are not searched."""


class Figure90(NamedTuple):
    """A parameter of one specimen with the ends of its 90 % interval, NaN where it has none."""

    value: float
    low: float
    high: float
    error: float
    status: str


@dataclass
class Specimen:
    """One fit among many: its name on the page, its folder, and why it stands out, if it does."""

    name: str
    folder: Path
    document: dict[str, Any]
    fit: identify.FitResult
    posterior: identify.internal.Posterior | None
    why: dict[str, str] = field(default_factory=dict)

    @property
    def judged(self) -> tuple[str, dict[str, float]]:
        """Error figures of the held-out rows, or of the training rows, and which."""
        metrics = self.document["metrics"]
        word = "held-out" if metrics.get("test") else "training"
        return word, metrics.get("test") or metrics["train"]

    @property
    def kind(self) -> tuple[str, str, str]:
        """Specimens compare that have the same model and units."""
        return self.fit.name, self.fit.train.input_unit, self.fit.train.output_unit

    @cached_property
    def figures(self) -> dict[str, Figure90]:
        """Parameters with their intervals: of the draws if sampled, else of the fit."""
        drawn = {} if self.posterior is None else {s.name: s for s in self.posterior.summaries}
        found = {}
        for p in self.fit.parameters:
            if p.value is None or not np.isfinite(p.value):
                continue
            error = p.stderr if p.stderr is not None and np.isfinite(p.stderr) else np.nan
            low, high = p.value - NORMAL_95 * error, p.value + NORMAL_95 * error
            if p.name in drawn:
                low, high = drawn[p.name].q05, drawn[p.name].q95
            elif p.low is not None and p.high is not None:
                low, high = p.low, p.high
            found[p.name] = Figure90(float(p.value), float(low), float(high), error, p.status)
        return found

    @property
    def sentence(self) -> str:
        """Why it stands out."""
        said = []
        for name, side in self.why.items():
            if name == "error":
                word, figures = self.judged
                said.append(f"{word} error {quantity(figures['nrmse_percent'], '%')}")
            else:
                unit = next(p.unit for p in self.fit.parameters if p.name == name)
                value = quantity(self.figures[name].value, unit)
                said.append(f"{name} {side} the others, {value}")
        return f"{self.name} is an outlier: {'; '.join(said)}."


def places(folders: Sequence[Path]) -> dict[str, Path]:
    """Folders of fits by name: those given, and in place of a folder of folders the fits in it.

    Raises `InputError` `file-not-found` for a folder that holds none, to the depth of two.
    """
    each = [_inside(folder) for folder in folders]
    unique = {place.resolve(): place for inside in each for place in inside.values()}
    if len(each) == 1:
        named = {place.resolve(): name for name, place in each[0].items()}
    else:
        above = common([*unique])
        named = {top: top.relative_to(above).as_posix() for top in unique}
    return {named[top]: place for top, place in unique.items()}


def common(found: Sequence[Path]) -> Path:
    """The folder that holds all of these folders."""
    return Path(os.path.commonpath([place.resolve().parent for place in found]))


def _natural(file: Path) -> list[tuple[int, str]]:
    """pad-9 before pad-10."""
    parts = re.split(r"(\d+)", file.as_posix())
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def _inside(folder: Path) -> dict[str, Path]:
    """Fits of one folder by name: itself, those of --each, or those in its folders."""
    if (folder / "fit.json").is_file() or not folder.is_dir():
        listed = folders_of(folder, identify.internal.read_document(folder))
        names = {value or folder.resolve().name: name for value, name in listed.items()}
        return {value: folder / name for value, name in names.items()}
    below = [*folder.glob("*/fit.json"), *folder.glob("*/*/fit.json")]
    found: dict[Path, None] = {}
    for file in sorted(below, key=_natural):
        try:
            listed = folders_of(file.parent, identify.internal.read_document(file.parent))
        except InputError:
            listed = {"": "."}  # it is named when it is opened
        found |= dict.fromkeys(file.parent / name for name in listed.values())
    if not found:
        identify.internal.read_document(folder)  # says that there is none
    return {place.relative_to(folder).as_posix(): place for place in found}


def opened(found: dict[str, Path]) -> tuple[list[Specimen], dict[str, str]]:
    """Specimens, and by name why others cannot be read.

    Raises the first `InputError` where none can be.
    """
    specimens, failed, first = [], {}, None
    for name, place in found.items():
        try:
            with damage_told("The fit", place, "Fit again."):
                fitted, document = identify.internal.read_fit(place)
                one = Specimen(name, place, document, fitted, load_posterior(place))
                _ = one.judged[1]["nrmse_percent"], one.document["verdict"]["level"]
            specimens.append(one)
        except InputError as error:
            first = first or error
            failed[name] = str(error)
    if first is not None and not specimens:
        raise first
    return specimens, failed


def kinds(specimens: Sequence[Specimen]) -> list[list[Specimen]]:
    """Specimens of one model and the same units, the commonest first."""
    found: dict[tuple[str, str, str], list[Specimen]] = {}
    for one in specimens:
        found.setdefault(one.kind, []).append(one)
    return sorted(found.values(), key=len, reverse=True)


def mark_outliers(group: Sequence[Specimen]) -> None:
    """Say of each specimen of one kind which figures stand out, and how far."""
    if len(group) < FEW:
        return
    for name in dict.fromkeys(name for one in group for name in one.figures):
        having = [one for one in group if name in one.figures]
        if len(having) < FEW:
            continue
        value = np.array([one.figures[name].value for one in having])
        error = np.array([one.figures[name].error for one in having])
        for one, far in zip(having, deviations(value, np.nan_to_num(error)), strict=True):
            if abs(far) > FAR:
                one.why[name] = "above" if far > 0 else "below"
    wrong = np.array([one.judged[1]["nrmse_percent"] for one in group])
    for one, far in zip(group, deviations(wrong, np.zeros(len(wrong))), strict=True):
        if far > FAR:
            one.why["error"] = "above"


def deviations(
    value: Float[np.ndarray, " specimens"], error: Float[np.ndarray, " specimens"]
) -> Float[np.ndarray, " specimens"]:
    """How far each value lies from the median, in robust deviations that count its own error:

        d_i = (z_i - median z) / sqrt((1.4826 median |z - median z|)^2 + e_i^2)

    z is the logarithm where all values are positive, and e_i its error. Scales below 1 % of the median
    count as that, so that specimens that agree to the last digit do not stand out.

    Source: Iglewicz, Hoaglin, How to Detect and Handle Outliers (ASQC 1993), 11.
    """
    positive = bool((value > 0).all())
    z, e = (np.log(value), error / value) if positive else (value, error)
    middle = np.median(z)
    scale = 1.4826 * np.median(np.abs(z - middle))
    scale = max(float(scale), 0.01 if positive else 0.01 * abs(float(middle)), 1e-300)
    return (z - middle) / np.hypot(scale, e)
