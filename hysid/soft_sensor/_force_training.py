"""A soft sensor's force estimator learnt from its records."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from compensate.microchannel._force import ForceEstimator
from hysteresis import InputError
from hysteresis.numerics._normal import NORMAL_95
from identify.training._train import Trained

from ._force_networks import DECAYS, Found, Settings, Tell, fit_structured, train_networks
from ._force_records import ForceData, ForceRecord, gather, held_out_parts

KINDS = {"network": train_networks, "structured": fit_structured}
SKIPS = (0.6, 0.4, 0.2, 0.0)
"""Parts at the beginning of a single record whose exclusion is tried, because a new sample settles."""
WORTH = 1.05
"""Errors, to the least one, that are as good as it."""


class ForceTraining(NamedTuple):
    """A force estimator, and how good it is on records it did not learn from.

    - `estimator`: `ForceEstimator`, its deviation such that 90 % bands hold nine of ten held-out rows.
    - `kind`, `settings`: what was trained, and what was chosen from the data.
    - `rmse` (N), `nrmse_percent` (of the range of forces): of held-out rows, each judged by a model
      that had not seen it; a mean of several networks is somewhat better than this.
    - `coverage`: part of the rows of each held-out part within 90 % bands that the others calibrate.
    - `force`, `held_out` (rows,): measured and estimated so, NaN where nothing was held out.
    - `curves`: of every network's training.
    """

    estimator: ForceEstimator
    kind: str
    settings: dict[str, Any]
    rmse: float
    nrmse_percent: float
    coverage: float
    force: Float[np.ndarray, " rows"]
    held_out: Float[np.ndarray, " rows"]
    curves: tuple[Trained, ...]


def train_force(
    records: Sequence[ForceRecord | tuple[Any, Any, Any]],
    *,
    kind: str = "network",
    groups: Sequence[Any] | None = None,
    nan: str = "raise",
    skip: str | float = "auto",
    members: int = 5,
    updates: int = 20_000,
    seed: int = 0,
    checkpoint: str | Path | None = None,
    resume: bool = False,
    tell: Tell | None = None,
) -> ForceTraining:
    """Learn to estimate force from a soft sensor's readings, from records with a load cell.

    Thresholds of the memory come from the range of the readings, delays from the sampling and the length of
    the records, the reading at rest from their first rows. Whole records, or stretches of a few long ones,
    are held out to stop a training, to choose a model and to judge it, because neighbouring rows are almost
    equal.

    **Arguments:**

    - `records`: sequences (time in s, reading, force in N), see `ForceRecord`, each from rest.
    - `kind`: `"network"`, the mean of `members` networks of the Preisach staircase and delays
      (`StaircaseNetwork`), of any number of channels; `"structured"`, of one, what `identify.fit` finds
      from reading to force, or from force to reading and run backwards, whichever is better on held-out
      records.

    - `groups`: one name for each record, such as the speed or the depth of a press: those of one group
      are held out together. Without groups, repetitions of a held-out record stay among the training
      records, and the held-out error is smaller than that of presses at another speed.

    **Other arguments:**

    - `nan`: `"omit"` learns only from rows with a force; the readings of all rows are kept as history.
      `"interpolate"` fills both in a straight line.
    - `skip`: part at the beginning of each record that only drives the memory; `"auto"` leaves a fifth or
      two, or three, of one or two long records out where that predicts their last fifth as well.
    - `members`: parts that are held out in turn. `updates`: steps of each training, of 64 rows.
    - `seed`: of weights, batches and parts.
    - `checkpoint`: a folder for the state of the training; `resume`: continue from that state.
    - `tell`: called with (done, total, words) now and then.

    **Returns:** a `ForceTraining`: the estimator, and its errors on held-out rows in N.

    **Raises:** `InputError` for records that cannot be learnt from, see `Record`; for an unknown kind or
    fewer than two members; and as `identify.internal.train` and `identify.fit` do.

    **Source:** Kim and Park (2018), section III A, for the network only.

    **Example:**

        >>> time = np.arange(80.0)
        >>> force = 3 * np.sin(np.linspace(0, np.pi, 80)) ** 2
        >>> records = [(time, 0.3 + scale * 0.1 * force, scale * force) for scale in (1.0, 1.2, 1.4, 1.6)]
        >>> learnt = hysid.train_force(records, members=2, updates=50)
        >>> learnt.estimator.simulate(*records[0][:2]).value.shape
        (80,)
    """
    if kind not in KINDS:
        fix = f"Use one of {', '.join(map(repr, KINDS))}."
        raise InputError("bad-option", f"{kind!r} is not a kind of estimator.", fix=fix)
    if members < 2 or updates < 1:
        raise InputError("bad-option", f"{members} members, {updates} updates: at least 2, and 1.")
    if not (skip == "auto" or (isinstance(skip, float | int) and 0 <= skip < 0.9)):
        raise InputError("bad-option", f'skip={skip!r} is neither "auto" nor a part below 0.9.')
    data = gather(records, nan)
    most = data.presses if groups is None else max(2, len(set(groups)))
    settings = Settings(
        min(members, most), updates, seed, None if checkpoint is None else Path(checkpoint),
        resume, tell or (lambda *_: None),
    )  # fmt: skip
    share = _skipped(data, settings) if skip == "auto" else float(skip)
    part = held_out_parts(data, settings.members, share, seed, groups)
    found: Found = KINDS[kind](data, part, settings)
    return _judged(kind, found._replace(words=found.words | {"skip": share}), data, part)


def _skipped(data: ForceData, settings: Settings) -> float:
    """The part to leave out: the most that predicts the last fifth as well as any, to `WORTH`.

    How a sample settles is seen once, and is no news of another run, before which it may have settled.
    """
    if len(data.starts) > 2 or data.presses < 8:
        return 0.0
    short = settings._replace(
        updates=max(1, settings.updates // 4), checkpoint=None, resume=False, tell=lambda *_: None
    )
    error = {}
    for share in SKIPS:
        # One network, of the rows between what is left out and the last fifth.
        fifth, after = held_out_parts(data, 5), held_out_parts(data, 5, share)
        part = np.where(fifth == 4, 0, np.where(after >= 0, 1, -1))
        found = train_networks(data, part, short, only=(0,), decays=DECAYS[-1:]).held_out
        error[share] = float(np.nanmean((found - data.force)[part == 0] ** 2)) ** 0.5
    return next(share for share in SKIPS if error[share] <= WORTH * min(error.values()))


def _judged(kind: str, found: Found, data: ForceData, part: np.ndarray) -> ForceTraining:
    held_out = np.where(data.known, found.held_out, np.nan)
    low, high = 0.0, 1.1 * float(data.force[data.known].max())
    off = np.abs(np.clip(held_out, low, high) - data.force)
    seen = np.isfinite(off)
    deviation = _deviation(off[seen])
    inside = []
    for k in np.unique(part[seen]):
        own, others = seen & (part == k), seen & (part != k)
        band = _deviation(off[others]) if others.any() else deviation
        inside.append(off[own] < NORMAL_95 * band)
    margin = 0.02 * np.ptp(data.reading, axis=0)
    ends = data.reading.min(axis=0) - margin, data.reading.max(axis=0) + margin
    estimator = ForceEstimator(found.model, deviation, high, *ends)
    rmse = float(np.sqrt(np.mean(off[seen] ** 2)))
    return ForceTraining(
        estimator, kind, found.words, rmse, 100 * rmse / data.span,
        float(np.concatenate(inside).mean()), data.force, held_out, found.curves,
    )  # fmt: skip


def _deviation(off: Float[np.ndarray, " rows"]) -> float:
    """The one whose 90 % band holds nine of ten: errors have longer tails than a normal one's."""
    return max(float(np.quantile(off, 0.9)) / NORMAL_95, 1e-12)
