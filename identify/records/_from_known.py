"""Running a model over a record of which the first rows of each sequence are known."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from hysteresis import AbstractModel, Note, Record
from hysteresis._known_past import KnownPast, known_past, outputs_of
from hysteresis.models._conditioned import with_condition
from hysteresis.records._abstract_record import KNOWN

RELATIVE = "rms of the sequence"
"""The name of a sigma that is the rms of each sequence's output."""

FEW = 0.1
"""Of the rows in which an error decays: over the last so many known ones it is averaged."""


class Misfit(NamedTuple):
    """What a model errs by where its state is known: rms, in parts of that of the known outputs where it is
    `relative`; the rows in which an error decays to 1 / e, 0 where it does not last."""

    rms: float = 0.0
    relative: bool = False
    lasts: float = 0.0


def by_sequence(record: Record) -> Record:
    """The record with the rms of each sequence's counted outputs for its sigma: errors count by it."""
    sigma = np.ones(len(record)) if record.sigma is None else record.sigma
    own = np.ones(len(record))
    for _, rows in record.sequences():
        counted = rows.start + np.flatnonzero(record.mask[rows])
        if len(counted):
            relative = record.output[counted] / sigma[counted]
            own[rows] = np.sqrt(np.mean(relative**2)) or 1.0
    columns = {**record.columns, RELATIVE: sigma * own}
    return replace(record, columns=columns, sigma_name=RELATIVE)


def sequence_error(record: Record, predicted: Float[np.ndarray, " samples"]) -> float:
    """The mean over sequences of the rms error over the rms output, of counted rows, in per cent."""
    found = []
    for _, rows in record.sequences():
        counted = rows.start + np.flatnonzero(record.mask[rows])
        y = record.output[counted]
        if len(counted) and y.any():
            found.append(np.sqrt(np.mean((predicted[counted] - y) ** 2) / np.mean(y**2)))
    return 100 * float(np.mean(found)) if found else float("nan")


class FromKnown(NamedTuple):
    """Outputs, and their standard deviation for want of knowing the first state, (samples,)."""

    values: Float[np.ndarray, " samples"]
    deviation: Float[np.ndarray, " samples"]


def from_known(model: AbstractModel, record: Record, misfit: Misfit) -> FromKnown:
    """The model's outputs, each sequence in the state that its known rows tell, in the virgin one where it
    has none. What it errs by at the last known rows fades out after them."""
    u, outputs = with_condition(model, record, record.input), outputs_of(model)
    values, deviation = np.empty(len(record)), np.zeros(len(record))
    for rows, known, past in _pasts(model, record, misfit):
        t = None if record.time is None else record.time
        if past is None:
            values[rows] = outputs(None if t is None else t[rows], u[rows], (0,))
            continue
        rest = slice(rows.start + known, rows.stop)
        run = past.followed_by(None if t is None else t[rest], u[rest])
        each = np.asarray(outputs(*run)).reshape(len(past.inputs), -1)[:, rows.start - rows.stop :]
        values[rows] = each[0]
        last = slice(max(rest.start - max(1, round(FEW * misfit.lasts)), rows.start), rest.start)
        error = np.nanmean((record.output - values)[last]) if misfit.lasts else np.nan
        if np.isfinite(error):
            values[rest] += error * np.exp(-np.arange(1, 1 + rows.stop - rest.start) / misfit.lasts)
        deviation[rows] = np.sqrt(((each[1:] - each[0]) ** 2).sum(0) / 2)
    return FromKnown(values, deviation)


def with_past(model: AbstractModel, record: Record, misfit: Misfit) -> Record:
    """A record whose sequences begin with the inputs that known rows tell to have been before: rows that
    drive a model, have no output and no line, and do not count."""
    own, u, t, starts = [], [], [], []
    for rows, known, past in _pasts(model, record, misfit):
        before = 0 if past is None else past.inputs.shape[1] - known
        starts.append(sum(map(len, own)))
        own += [np.full(before, -1 - rows.start), np.arange(rows.start, rows.stop)]
        if past is not None:
            first = past.inputs[0, :before]
            u.append(first if first.ndim == 1 else first[:, 0])
            t += [] if past.times is None else [past.times[0, :before]]
        u.append(record.input[rows])
        t += [] if record.time is None else [record.time[rows]]
    index = np.concatenate(own)
    unseen, at = index < 0, np.where(index < 0, -1 - index, index)
    columns = {name: column[at] for name, column in record.columns.items() if name != KNOWN}
    said = f"{int(unseen.sum())} rows before the known ones are estimated from them: they drive the model."
    return replace(
        record, input=np.concatenate(u), time=np.concatenate(t) if t else None,
        output=np.where(unseen, np.nan, record.output[at]), mask=record.mask[at] & ~unseen,
        line=np.where(unseen, 0, record.line[at]), columns=columns, starts=np.array(starts),
        history=(*record.history, Note("known-past", said)),
    )  # fmt: skip


def _pasts(
    model: AbstractModel, record: Record, misfit: Misfit
) -> Iterator[tuple[slice, int, KnownPast | None]]:
    """The rows of each sequence, how many of them are known, and what these tell."""
    assert record.known is not None
    u, outputs = with_condition(model, record, record.input), outputs_of(model)
    for _, rows in record.sequences():
        known = int(record.known[rows].sum())
        own = slice(rows.start, rows.start + known)
        t = None if record.time is None else record.time[own]
        past = None
        if known:
            y = record.output[own]
            error = misfit.rms * (float(np.sqrt(np.nanmean(y**2))) if misfit.relative else 1.0)
            past = known_past(model, t, u[own], y, error, outputs)
        yield rows, known, past
