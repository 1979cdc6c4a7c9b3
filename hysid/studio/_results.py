"""A fit as the page shows it: verdict, candidates, curves, residuals, sliders, posterior."""

import csv
import hashlib
import inspect
import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import identify
from compensate.export.targets._export_to import TARGETS
from hysteresis import AbstractModel, InputError, Record, parameters
from hysteresis._format import plain
from hysteresis._parameter import ParameterInfo, parameter_at
from hysteresis.records._abstract_record import kind_of_units
from hysteresis.records._arrays import floats
from identify import load_posterior

from ..figures._format import axes_of
from ..intake._folders import folders_of
from ..intake._selection import Selection, selection_of_fit
from ..reporting._report import HEADLINES
from ._equivalents import target_name
from ._views import ALL, GAP, clock_of, peaks

MOST = 12
"""Sliders, at most."""
NEAR = 1e-3
"""How near to a bound a slider goes, as a part of the distance between both bounds."""


class Slider(NamedTuple):
    """A parameter with its value and its meaning, and the ends of its slider: `logarithmic` where it is
    positive."""

    name: str
    value: float
    unit: str
    low: float
    high: float
    logarithmic: bool
    meaning: str = ""


def sliders_of(fit: identify.FitResult) -> list[Slider]:
    """A slider for each scalar parameter of a fit's model that is not fixed, at most `MOST`; none for those
    of a composition's parts, which mean little one by one.

    It spans a factor of ten to either side of a positive value, else twice its size, and never leaves the
    parameter's bounds.
    """
    train = fit.train
    try:
        units = fit.model.unit_words(train.input_unit, train.output_unit, train.time_unit)
        return [
            Slider(name, value, info.in_units(units), *_ends(info, value), info.meaning)
            for name, info, array in parameters(fit.model)
            if array is not None and array.ndim == 0 and not info.fixed and "." not in name
            for value in (float(array),)
        ][:MOST]
    except (ValueError, TypeError, NotImplementedError):  # a model of a user's own
        return []


def moved(model: AbstractModel, values: Mapping[str, float]) -> AbstractModel:
    """The model with some scalar parameters at other values; it is as it was where none differs."""
    new = model
    for name, value in values.items():
        old = parameter_at(model, name)
        if value != float(old):
            # A default binds the name of this round.
            new = eqx.tree_at(
                lambda m, name=name: parameter_at(m, name), new, jnp.asarray(value, old.dtype)
            )
    return new


def _ends(info: ParameterInfo, value: float) -> tuple[float, float, bool]:
    low, high = info.bounds
    inside = NEAR * (high - low) if math.isfinite(high - low) else 0.0  # a bound itself is no value
    positive, size = value > 0 and low >= 0, 2 * abs(value) or 1.0
    least, most = (value / 10, value * 10) if positive else (value - size, value + size)
    least, most = max(least, low + inside), min(most, high - inside)
    return min(least, value), max(most, value), positive


# What a loop would look like with another stiffness, loop width or relaxation time.
#
# The figures are those of `FitResult.characteristics`, which every model has: a composition's own numbers
# mean little one by one. The model's output is taken apart into the middle line of its loops over the
# input, m(u), and the distance from it. Of a record y = m(u) + d
#
# y' = m(0) + s (m(u) - m(0)) + w d,
#
# with s the factor of the stiffness (its inverse where the output is the deformation) and w that of the
# loop width. A relaxation time that is r times as long is a clock that runs r times as slowly.


LEVELS = 60
"""Inputs at which the middle line is taken."""
MOVES = 1e-3
"""Of the output's range: a relaxation time that changes less than this is not in the model."""
SLOWER = 3.0
"""Factor by which a slider makes a stiffness or a time smaller or larger, and a loop wider."""
FAR = 1e3
"""No factor is larger, or smaller than its inverse."""

STIFFNESS, WIDTH, TIME = "stiffness", "loop width", "relaxation time"


def judged(fit: identify.FitResult) -> Record:
    """The record whose loop is shown: the held-out one, where there is one."""
    return fit.train if fit.test is None else fit.test


def handles_of(fit: identify.FitResult) -> list[Slider]:
    """The sliders of a fit's loop: the meaning of each is the figure that the fit tells."""
    told = {one.name: (one.value, one.unit) for one in fit.characteristics if one.value is not None}
    slope = "slope" if "slope" in told else STIFFNESS
    found = []
    for name, label in ((STIFFNESS, slope), (WIDTH, WIDTH), (TIME, TIME)):
        if (name == TIME and not _relaxes(fit)) or (name == WIDTH and WIDTH not in told):
            continue
        value, unit = told.get(label, (100.0, "percent"))
        ends = sorted((value / SLOWER, value * SLOWER))
        low, logarithmic = (0.0, False) if name == WIDTH else (ends[0], value > 0)
        found.append(Slider(name, value, unit, low, ends[1], logarithmic, label))
    return found


def reshaped(fit: identify.FitResult, record: Record, factors: Mapping[str, float]) -> np.ndarray:
    """(n,) the model's output with figures of its loop that are so many times as large.

    Raises `InputError` `unknown-parameter` for a figure without a slider, or a factor far from its ends.
    """
    for name, by in factors.items():
        least = 0.0 if name == WIDTH else 1 / FAR
        if name not in (STIFFNESS, WIDTH, TIME) or not least <= by <= FAR:
            raise InputError(
                "unknown-parameter", f"There is no slider {name!r:.60} at {by:g} times."
            )
    y = np.asarray(fit.predict(_slower(record, factors.get(TIME, 1.0))), float)
    stiffness, width = factors.get(STIFFNESS, 1.0), factors.get(WIDTH, 1.0)
    if kind_of_units(record) == "creep":
        stiffness = 1 / stiffness
    levels, middle = _middle(record, y)
    here, first = np.interp(record.input, levels, middle), np.interp(0.0, levels, middle)
    return first + stiffness * (here - first) + width * (y - here)


def _middle(record: Record, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inputs, and the mean there of the outputs of both branches."""
    levels = np.linspace(record.input.min(), record.input.max(), LEVELS)
    cell = np.rint(np.interp(record.input, levels, np.arange(LEVELS))).astype(int)
    means = []
    for way in (1, -1):
        rows = (record.branch == way) & np.isfinite(y)
        count, total = (np.bincount(cell[rows], x, LEVELS) for x in (None, y[rows]))
        there = np.flatnonzero(count)
        if there.size:
            means.append(np.interp(np.arange(LEVELS), there, total[there] / count[there]))
    return levels, np.mean(means, axis=0) if means else np.zeros(LEVELS)


def _relaxes(fit: identify.FitResult) -> bool:
    record = judged(fit)
    if record.time is None:
        return False
    one, other = (np.asarray(fit.predict(_slower(record, by)), float) for by in (1.0, SLOWER))
    return bool(np.nanmax(np.abs(one - other)) > MOVES * np.ptp(record.output[record.mask]))


def _slower(record: Record, by: float) -> Record:
    if record.time is None or by == 1.0:
        return record
    return replace(record, time=record.time[0] + (record.time - record.time[0]) / by)


BINS = 24
"""Bars of a parameter's marginal distribution."""
EXPORTS = (".h", "compensator.json")
"""Ends of names of files that `hysid export` has written for the page."""
WIDE = 30
"""Ratio of the ends of a positive parameter from which its distribution is shown over the logarithm."""
SAID = ("model", "purpose", "metrics", "skipped", "notes", "seconds", "data")
"""Entries of fit.json that the page has as they are."""
TRIED = ("model", "score_percent", "metrics", "verdict")
"""The same of a candidate."""
SHOWN = 6
"""Parameters whose marginal distribution is drawn."""


class Fits:
    """The fits of a folder, each read again when its files have changed. JAX works for one at a time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._load = lru_cache(4)(lambda folder, stamp: identify.load(folder))

    def summary(
        self,
        folder: Path,
        selection: Selection | None,
        options: Mapping[str, Any],
        value: str = "",
        file: Path | None = None,
    ) -> dict[str, Any]:
        """What the page says of the fit in a folder; of several fits (`each`), of the one of a value.

        `stale`: the fit is not one of this selection, these options and this file.

        Raises `InputError` where there is none.
        """
        whole = identify.internal.read_document(folder)
        places = folders_of(folder, whole)
        value = value if value in places else next(iter(places))
        own, asked = folder / places[value], selection_of_fit(whole)
        document = whole if "" in places else identify.internal.read_document(own)
        written = (folder / "fit.json").stat().st_mtime
        level, listed = document["verdict"]["level"], document["parameters"]
        determined = document.get("determined", [one["name"] for one in listed])
        at = "" if places[value] == "." else f"{places[value]}/"
        there = sorted(file.name for file in own.iterdir() if file.is_file())
        made = {target_name(own, target) for target in TARGETS}
        made |= {name for name in there if name.endswith(EXPORTS)}
        return {
            "values": list(places) if "" not in places else [],
            "value": value,
            "headline": HEADLINES[level], "level": level,
            "reasons": [reason["text"] for reason in document["verdict"]["reasons"]],
            **{name: document[name] for name in SAID},
            "characteristics": document.get("characteristics", []),
            "parameters": [one for one in listed if one["name"] in determined],
            "undetermined": sum(one["name"] not in determined for one in listed),
            "candidates": [{name: one[name] for name in TRIED} for one in document["candidates"]],
            "baselines": document.get("baselines", []),
            "stale": _stale(whole, selection, options, file, written),
            "invertible": not asked.is_step and not isinstance(asked.input, tuple),
            "posterior": _posterior(own / "posterior.json"),
            "report": f"{folder.name}/{at}report.html" if "report.html" in there else None,
            "exports": [f"{folder.name}/{at}{n}" for n in sorted(made) if (own / n).exists()],
            "folder": places[value],
            "made": str(written),
        }  # fmt: skip

    def curves(self, folder: Path) -> dict[str, Any]:
        """Measured and modelled loops, residuals, sliders, of at most so many rows as a plot shows."""
        with self._lock:
            fit = self._loaded(folder)
            record, (u, y), modelled = fit.train, axes_of(fit.train), fit.predict(fit.train)
            records = [_curve("training", record, modelled, fit.used)]
            if fit.test is not None:
                records.append(_curve("held out", fit.test, fit.predict(fit.test)))
            dropped = record.mask & ~fit.used
            excluded = _curve("excluded", record, modelled, dropped) if dropped.any() else None
            candidates, baselines = identify.internal.residuals_of_all(folder)
            asked = identify.internal.members_and_questions(fit)
            x = f"time ({record.time_unit})" if record.time is not None else "row"
            units = {"u_unit": record.input_unit, "y_unit": record.output_unit}
            return {
                "records": records,
                "excluded": excluded,
                "shapes": [one._asdict() for one in handles_of(fit)],
                "sliders": [one._asdict() for one in sliders_of(fit)],
                "candidates": _loops(fit, [one.name for one in fit.candidates], candidates)[1:],
                "baselines": _loops(fit, [one.name for one in fit.baselines], baselines),
                "asked": [one._asdict() for one in asked],
                "axes": {"x": x, "u": u, "y": y, **units},
            }

    def redrawn(
        self, folder: Path, values: Mapping[str, float], factors: Mapping[str, float]
    ) -> dict[str, Any]:
        """The model's output with parameters at other values, or figures of its loop that are so many times
        as large, and its error; nothing is written.

        Raises `InputError` `unknown-parameter` where there is no such slider.
        """
        with self._lock:
            fit = self._loaded(folder)
            if unknown := values.keys() - {one.name for one in sliders_of(fit)}:
                raise InputError("unknown-parameter", f"There is no slider {min(unknown)!r:.60}.")
            fit = replace(fit, model=moved(fit.model, values))
            record = judged(fit)
            return _curve("moved", record, reshaped(fit, record, factors))

    def _loaded(self, folder: Path) -> identify.FitResult:
        about = (folder / "fit.json").stat()
        return self._load(folder, (about.st_mtime_ns, about.st_size))

    def posterior_marginals(self, folder: Path) -> list[dict[str, Any]]:
        """A histogram of each parameter's draws, 99 % of them."""
        with self._lock:
            posterior = load_posterior(folder)
        if posterior is None:
            return []
        draws = posterior.draws.reshape(-1, len(posterior.names))
        found = []
        for k, name in enumerate(posterior.names[:SHOWN]):
            low, high = np.quantile(draws[:, k], [0.005, 0.995])
            wide = low > 0 and high > WIDE * low
            to, back = (np.log, np.exp) if wide else (np.asarray, np.asarray)
            count, edges = np.histogram(to(draws[:, k]), BINS, tuple(to([low, high])))
            edges = back(edges)
            found.append({"name": name, "count": count, "edges": edges, "logarithmic": bool(wide)})
        return found


def written_rows(file: Path) -> dict[str, Any]:
    """What `hysid predict --inverse` has written, thinned for a plot: lines, measured and estimated."""
    with file.open(encoding="utf-8", newline="") as opened:
        header, *table = csv.reader(opened)
    first, at, n = header.index("line"), header.index("status"), len(table)
    columns = [floats([row[k] for row in table]) for k in range(first, at)]
    line, *before, estimated = columns
    chosen = peaks((*before, estimated), slice(0, n)) if n else np.zeros(0, int)
    flagged = np.array([row[at] != "OK" for row in table], bool)
    # Before the estimate stand line, input and output; the one that was wanted may be missing.
    names = (*header[first + 1 : at - 1], None)
    seen = (*(column[chosen] for column in before), None)
    return {
        "name": header[at - 1], "measured_name": names[0], "reading_name": names[1], "rows": n,
        "flagged_rows": int(flagged.sum()), "line": line[chosen], "estimated": estimated[chosen],
        "flagged": flagged[chosen], "measured": seen[0], "reading": seen[1],
    }  # fmt: skip


def _loops(
    fit: identify.FitResult, names: Sequence[str], residuals: np.ndarray | None
) -> list[dict[str, Any]]:
    """The loops of what was tried, on the training rows; none where its residuals were not saved."""
    if residuals is None or residuals.shape != (len(names), len(fit.train)):
        return []
    found = []
    for name, residual in zip(names, residuals, strict=True):
        curve = _curve(name, fit.train, fit.train.output + residual, np.isfinite(residual))
        found.append({key: curve[key] for key in ("word", "rms", "u", "model", "gap")})
    return found


def _stale(
    whole: dict[str, Any], selection: Selection | None, options: Mapping[str, Any], file: Path | None,
    made: float,
) -> bool:  # fmt: skip
    """Whether other rows, columns or options are chosen than those of a fit, or the file is another one.

    A fit that was saved from Python says nothing of its rows and options.
    """
    pairs = []
    if selection is not None and "selection" in whole:
        now, then = selection.as_json(), selection_of_fit(whole).as_json()
        keys = now.keys() & then.keys()
        if isinstance(now["input"], tuple) != isinstance(then["input"], tuple):
            keys -= {"input", "condition"}  # one of two inputs was taken as a condition
        pairs += [(now[key], then[key]) for key in keys]
    usual = inspect.signature(identify.fit).parameters
    for name, then in whole.get("options", {}).items():
        pairs.append((options.get(name, usual[name].default if name in usual else then), then))
    if any(plain(now) != plain(then) for now, then in pairs):
        return True
    known = whole["data"].get("sha256")
    if not file or not known or file.stat().st_mtime <= made:
        return False
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest() != known


def _posterior(file: Path) -> dict[str, Any] | None:
    if not file.is_file():
        return None
    try:
        document = identify.internal.read_json(file)
        return {key: document[key] for key in ("parameters", "draws", "converged", "notes")}
    except (InputError, KeyError):
        return None


def _curve(
    word: str, record: Record, modelled: np.ndarray, counted: np.ndarray | None = None
) -> dict[str, Any]:
    """A record and a model's output on it, thinned to the rows that a plot shows."""
    modelled = np.asarray(modelled, float)
    keep = (record.mask if counted is None else counted) & np.isfinite(record.output)
    error = modelled - record.output
    rms = float(np.sqrt(np.mean(error[keep] ** 2))) if keep.any() else float("nan")
    rows = np.flatnonzero(keep)
    begins = np.isin(rows, record.starts) | (np.diff(rows, prepend=-2) > 1)
    if len(rows) > ALL:
        columns = record.input[rows], record.output[rows], error[rows]
        shown = peaks(columns, slice(0, len(rows)))
        # A gap between two rows that are shown is one wherever there is one between them.
        gaps = np.cumsum(begins)[shown]
        rows, begins = rows[shown], np.diff(gaps, prepend=0) > 0
    return {
        "word": word, "rms": rms, "x": clock_of(record)[rows], "u": record.input[rows],
        "y": record.output[rows], "model": modelled[rows], "residual": error[rows], "gap": begins * GAP,
    }  # fmt: skip
