"""Three fits that must not be believed as they stand, and whether every place where they are shown says so.

A parameter at a bound, one that the data do not tell, and a likelihood with two maxima: each is fitted,
kept, sampled and reported as a user would.
"""

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from hysid.reporting._report import write_report
from hysteresis import (
    AbstractModel,
    Burgers,
    GeneralizedKelvinVoigt,
    LinearSponge,
    Record,
    StandardLinearSolid,
)
from identify import FitResult, fit, sample, save, save_posterior
from identify.internal import Posterior, read_document

from .._measure import Row, judged

CONSTRUCTED = "at bound, unidentified, multimodal: shown in report, JSON and text, of 3"

OPEN = ("no lower end", "no upper end", "no end either way")
"""What the report says of a profile without an end."""


class ConstructedCase(NamedTuple):
    """A fit with a fault; `sampled`: the fault is the posterior's, which is drawn."""

    name: str
    fit: Callable[[], FitResult]
    sampled: bool


class Shown(NamedTuple):
    """Where a case says what it is."""

    report: bool
    document: bool
    text: bool


def constructed_cases() -> tuple[ConstructedCase, ...]:
    """The three."""
    return (
        ConstructedCase("at bound", _at_bound, False),
        ConstructedCase("unidentified", _unidentified, False),
        ConstructedCase("multimodal", _multimodal, True),
    )


def shown(case: ConstructedCase, folder: Path) -> Shown:
    """Fit, save, sample where needed and report into `folder`, and read what is there."""
    found = case.fit()
    save(found, folder)
    posterior = sample(found, steps=500, seed=0) if case.sampled else None
    if posterior is not None:
        save_posterior(posterior, folder)
    report = write_report(folder).read_text("utf-8")
    return _multimodal_shown(report, folder, found, posterior) if posterior else _status_shown(
        case.name, report, folder, found
    )  # fmt: skip


def _status_shown(status: str, report: str, folder: Path, found: FitResult) -> Shown:
    """The word stands where a symmetric error would, and among the reasons, which the command prints."""
    listed = [p for p in read_document(folder)["parameters"] if p["status"] == status]
    names = [p["name"] for p in listed]
    reasons = " ".join(found.verdict.reasons)
    return Shown(
        report=bool(names) and status in report and any(lack in report for lack in OPEN),
        document=bool(names) and all(p["stderr"] is None for p in listed),
        text=bool(names) and f"No standard error for {', '.join(names)} ({status})." in reasons,
    )


def _multimodal_shown(report: str, folder: Path, found: FitResult, posterior: Posterior) -> Shown:
    summaries = json.loads((folder / "posterior.json").read_text("utf-8"))["parameters"]
    reasons = " ".join(found.verdict.reasons)
    return Shown(
        report="The likelihood has another maximum as good at" in report and "two modes" in report,
        document=any(s["modes"] == 2 for s in summaries),
        text="Two minima" in reasons and any("two modes" in s.words for s in posterior.summaries),
    )


def case_rows(quick: bool) -> list[Row]:
    """How many of the three are shown as what they are in all places; the same for `quick`."""
    right = 0
    for case in constructed_cases():
        with tempfile.TemporaryDirectory() as folder:
            right += all(shown(case, Path(folder)))
    return [judged(CONSTRUCTED, right, 3, at_least=True)]


def _at_bound() -> FitResult:
    """A slope of 2 that is said to be at least 2.2."""
    told = {"K": {"bounds": (2.2, 5.0), "start": 3.0}}
    truth = LinearSponge(2.0, 1.0, -np.inf)
    return _fitted(truth, LinearSponge(3.0, 1.0, -np.inf), 0.01, parameters=told)


def _unidentified() -> FitResult:
    """A dashpot in series that never gives way."""
    start = Burgers(2.0, 40.0, 1.0, 5.0)
    return _fitted(StandardLinearSolid(2.0, 1.0, 5.0), start, 0.01)


def _multimodal() -> FitResult:
    """Two branches of one stiffness, whose times the noise nearly hides: either may be the slow one."""
    truth = GeneralizedKelvinVoigt(2.0, jnp.array([1.0, 1.0]), jnp.array([2.0, 12.0]))
    told = {name: {"fixed": True} for name in ("E0", "E.0", "E.1", "offset")}
    return _fitted(truth, truth, 0.26, step=0.2, samples=120, parameters=told)


def _fitted(
    truth: AbstractModel,
    start: AbstractModel,
    noise: float,
    *,
    step: float = 0.1,
    samples: int = 400,
    **options: Any,
) -> FitResult:
    t = step * np.arange(samples)
    u = 10 * np.abs((t / 8 + 1) % 2 - 1)
    y = np.asarray(truth.simulate(t, u))
    y = y + noise * np.ptp(y) * np.random.default_rng(0).normal(size=samples)
    record = Record.from_arrays(u, y, t, input_unit="N", output_unit="mm", time_unit="s")
    return fit(record, start, conditioning="keep", clocks="keep", noise="gaussian", **options)
