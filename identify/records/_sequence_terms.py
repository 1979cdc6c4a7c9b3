"""What known rows tell of a sequence, learnt from many: a linear model, some of whose weights are its own.

    y = F x + R z + c + e,    z ~ N(0, V),  c ~ N(0, v exp(-|t - t'| / T)),  e ~ N(0, s^2)

x is shared by all sequences: a curve and powers of the input, stops that are relaxed before the first row,
the same by the distance from the middle of the range, stops that have come from that middle, and the
input's rate, and its root, behind low-pass filters of 0 to 512 sampling steps (eddies, ringing). z is of
each sequence: an offset, the first state of every stop, which the rows before the first one have left
there, the strength of the stops and of the rate. So a sequence is predicted from its known rows k by

    y = F x + K_k (K_kk + s^2)^-1 (y_k - F_k x),    K = R V R' + cov(c)

which is linear in x: x makes the mean over sequences of the rms error of unknown rows least, with a ridge.
V, v, T, s and the ridge are those that predict the unknown rows of sequences held out best. The mean error
of these says whether the terms are worth more than the states of a model.

Source: Robinson, That BLUP is a good thing: the estimation of random effects, Statistical Science 6 (1991).
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy.linalg
from jaxtyping import Float

from hysteresis import AbstractModel, Note, Record
from hysteresis._known_past import KnownPast, known_past, outputs_of
from hysteresis.models._conditioned import with_condition
from hysteresis.numerics._functions import NORMAL_95, hats_of
from hysteresis.numerics._recurrence import clamped, relaxed
from hysteresis.records._abstract_record import KNOWN

from .._levels import FEWEST, LITTLE, PART
from ._clocks import usual_speed
from ._folds import QUARTERS

THRESHOLDS = 2.0 ** np.arange(-8, -1)
"""Of the stops, in parts of the input's range."""

CUTOFFS = 2.0 ** np.arange(10)
"""Time constants of the low-pass filters, in sampling steps."""

CELLS, PLACES, POWERS = np.linspace(-1, 1, 10), np.array([0.0, 0.5, 1.0]), np.arange(1, 10)
"""Knots of the curve, and of the distance from the middle, in halves of the range; powers of the place."""

LOOSE = {"rates": 100.0, "powers": 10.0}
"""How much larger the squares of these shared weights are expected than those of others."""

START = np.array([LITTLE, LITTLE, LITTLE, LITTLE, LITTLE, 10.0, LITTLE, LITTLE])
"""Variances of offset, first states, stops, the rate and what fades out; its time in sampling steps;
variance of the error; the ridge. Outputs are in units of the rms of a usual sequence."""

MOVES = 10.0, np.sqrt(10.0)
"""By which each of these is divided and multiplied, the larger one first."""

REWEIGHED = 10
"""Solutions of least squares, each with the sequences weighed by what the one before errs by in them."""

ROWS = 100
"""Of a sequence: evenly spread, and the last known one."""


Equations = tuple[np.ndarray, np.ndarray, float]


class SequenceTerms(NamedTuple):
    """The terms that were learnt from the sequences of a record.

    - `low`, `high`: the input's range. `step`: the usual sampling step, 1 without a clock; `speed`: the rms
      of the input's rate. `centre`, `scale`: of the output.
    - `settings`: as `START` has them. `shared`: the weights x.
    - `error`: mean over held-out sequences of the rms error of unknown rows, each times its weight.
    """

    low: float
    high: float
    step: float
    speed: float
    centre: float
    scale: float
    settings: tuple[float, ...] = ()
    shared: tuple[float, ...] = ()
    error: float = float("nan")

    def predicted(
        self, record: Record
    ) -> tuple[Float[np.ndarray, " samples"], Float[np.ndarray, " samples"]]:
        """Outputs, and their standard deviation where the known rows leave it open, 0 in these."""
        values, deviation = np.empty(len(record)), np.zeros(len(record))
        for rows, one in self._sequences(record):
            known = one.known[_some(len(one.known))]
            gain, left = one.gain(known, np.arange(len(one.y)), np.array(self.settings))
            fixed = one.F @ np.array(self.shared)
            y = fixed + gain @ (one.y - fixed)[known]
            values[rows] = self.centre + self.scale * y
            deviation[rows] = self.scale * np.sqrt(np.maximum(left, 0))
        if record.known is not None:
            deviation[record.known] = 0.0
        return values, deviation

    def _sequences(self, record: Record) -> Iterator[tuple[slice, "_Sequence"]]:
        known = np.zeros(len(record), bool) if record.known is None else record.known
        for _, rows in record.sequences():
            t = None if record.time is None else record.time[rows]
            y = (record.output[rows] - self.centre) / self.scale
            F, R, clock = self._columns(record.input[rows], t)
            told = np.flatnonzero(known[rows] & np.isfinite(y))
            counted = np.flatnonzero(record.mask[rows] & ~known[rows])
            yield rows, _Sequence(F, R, clock, y, told, counted, record.weights[rows] * self.scale)

    def _columns(
        self, u: np.ndarray, t: np.ndarray | None
    ) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
        """Shared columns, those of the sequence by their variance, and the time in sampling steps."""
        clock = np.arange(len(u), dtype=float) if t is None else (t - t[0]) / self.step
        place = (2 * u - self.low - self.high) / (self.high - self.low)
        thresholds = (self.high - self.low) * THRESHOLDS
        n, each = len(thresholds), np.tile(thresholds, 4)
        rested = np.clip(u[0] - (self.low + self.high) / 2, -thresholds, thresholds)
        begun = np.concatenate([0 * thresholds, rested, thresholds, -thresholds])
        middle = clamped(u[:, None] - each, u[:, None] + each, u[0] - begun)
        strained = (u[:, None] - middle) / each
        stops, first = strained[:, : 2 * n], strained[:, 2 * n :] - np.tile(strained[:, :n], 2)
        dt = np.diff(clock, prepend=clock[0] - 1)
        v = np.diff(u, prepend=u[0]) / np.where(dt > 0, dt, 1) / self.speed
        decay = np.exp(-dt[:, None] / CUTOFFS)
        filtered = relaxed(
            decay, (1 - decay)[..., None] * v[:, None, None], np.zeros((len(CUTOFFS), 1))
        )
        rates = np.column_stack([v, filtered[..., 0]])
        far = hats_of(np.abs(place), PLACES)[:, 1:]
        inside = np.clip(place, -1, 1)
        powers = np.where(POWERS > 1, inside[:, None] ** POWERS, place[:, None])
        by_place = (stops[:, :n, None] * far[:, None]).reshape(len(u), -1)
        roots = np.sign(rates) * np.sqrt(np.abs(rates))
        curve = hats_of(inside, CELLS)
        kinds = {"rates": rates, "roots": roots, "stops": stops, "curve": curve, "places": by_place,
                 "powers": powers}  # fmt: skip
        F = np.hstack([np.sqrt(LOOSE.get(kind, 1.0)) * columns for kind, columns in kinds.items()])
        wide = np.tile(THRESHOLDS / THRESHOLDS[-1], 2) ** 0.5
        return F, [np.ones((len(u), 1)), first * wide, stops[:, :n], rates[:, :1]], clock


class _Sequence(NamedTuple):
    """A sequence in units of the terms: its columns, and which rows are known and which count."""

    F: np.ndarray
    R: list[np.ndarray]
    clock: np.ndarray
    y: np.ndarray
    known: np.ndarray
    counted: np.ndarray
    weights: np.ndarray

    def gain(
        self, known: np.ndarray, rows: np.ndarray, settings: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """What each of these rows takes from the errors of known ones, and the variance that is left."""
        *variances, fading, lasts, noise = settings[:-1]
        R = np.hstack([np.sqrt(v) * columns for v, columns in zip(variances, self.R, strict=True)])

        def covariance(rows: np.ndarray) -> np.ndarray:
            apart = np.abs(self.clock[rows][:, None] - self.clock[known])
            return R[rows] @ R[known].T + fading * np.exp(-apart / lasts)

        across = covariance(rows)
        own = covariance(known) + noise * np.eye(len(known))
        gain = scipy.linalg.solve(own, across.T, assume_a="pos").T if len(known) else across
        return gain, (R[rows] ** 2).sum(1) + fading - (gain * across).sum(1)

    def equations(self, settings: np.ndarray) -> Equations:
        """Of the errors of the rows that count, times their weights: H, b and the mean square of y."""
        known = self.known[_some(len(self.known))]
        rows = self.counted[_some(len(self.counted))]
        gain, _ = self.gain(known, rows, settings)
        w = self.weights[rows] / np.sqrt(len(rows))
        A = w[:, None] * (self.F[rows] - gain @ self.F[known])
        y = w * (self.y[rows] - gain @ self.y[known])
        return A.T @ A, A.T @ y, float(y @ y)


def _some(count: int) -> np.ndarray:
    """`ROWS` places at most, evenly spread, with the last one."""
    return np.arange(count - 1, -1, -max(1, -(-count // ROWS)))[::-1]


def sequence_rms(record: Record, predicted: Float[np.ndarray, " samples"]) -> float:
    """The mean over sequences of the rms error of the rows that count, each times its weight."""
    error = (record.weights * (predicted - record.output)) ** 2
    counted = [np.flatnonzero(record.mask[rows]) + rows.start for _, rows in record.sequences()]
    return float(np.mean([np.sqrt(np.mean(error[rows])) for rows in counted if len(rows)]))


def learnt(record: Record) -> SequenceTerms | None:
    """The terms of a record whose sequences begin with known rows; None where these are too few."""
    if record.known is None or record.input.ndim > 1:
        return None
    low, high = float(record.input.min()), float(record.input.max())
    step = usual_speed(record)[1] or 1.0
    seen = np.isfinite(record.output) & (record.mask | record.known)
    sizes = [
        np.mean(record.output[r][seen[r]] ** 2) for _, r in record.sequences() if seen[r].any()
    ]
    moved = np.concatenate([np.diff(record.input[rows]) for _, rows in record.sequences()])
    empty = SequenceTerms(
        low, high, step, float(np.sqrt(np.mean(moved**2))) or 1.0, float(record.output[seen].mean()),
        float(np.sqrt(np.median(sizes))) or 1.0,
    )  # fmt: skip
    if not high > low:
        return None
    each = [one for _, one in empty._sequences(record) if len(one.known) and len(one.counted)]
    if len(each) < FEWEST:
        return None
    search = _Search(each)
    settings = search.best()
    shared = search.solved([one.equations(settings) for one in each], settings)
    found = empty._replace(
        settings=tuple(settings.tolist()), shared=tuple(shared.tolist()),
        error=search.error(settings),
    )  # fmt: skip
    # Variances that are all larger give the same values: the search leaves their size open.
    values, deviation = found.predicted(record)
    off = ((values - record.output) / np.where(deviation > 0, deviation, np.inf))[record.mask]
    optimism = found.error / sequence_rms(record, values)
    # By nine in ten: a sequence that is far off does not widen the others.
    wider = np.quantile(off**2, 0.9) / NORMAL_95**2 * optimism**2
    settings[[*range(settings.size - 3), -2]] *= wider  # all but the time and the ridge
    return found._replace(settings=tuple(settings.tolist()))


class _Search:
    def __init__(self, each: list[_Sequence]) -> None:
        self.each = each
        # Not by their order: levels and rates often follow it.
        self.fold = np.random.default_rng(0).permutation(len(each)) % QUARTERS

    def solved(self, equations: list[Equations], settings: np.ndarray) -> np.ndarray:
        """The least mean of sqrt(e_i^2 + m), e_i the rms error of a sequence and m the median of e_i^2."""
        H, b, y = (np.array(each) for each in zip(*equations, strict=True))
        scale = np.mean([one.weights.mean() for one in self.each]) ** 2
        ridge = scale * settings[-1] * np.eye(b.shape[1])
        x, weights = np.zeros(b.shape[1]), np.ones(len(y))
        for _ in range(REWEIGHED):
            x = scipy.linalg.solve(
                np.tensordot(weights, H, 1) / len(y) + ridge, weights @ b / len(y), assume_a="pos"
            )
            squares = np.maximum((H @ x) @ x - 2 * b @ x + y, np.finfo(float).tiny)
            weights = 1 / np.sqrt(squares + np.median(squares))
            weights /= weights.mean()
        return x

    def error(self, settings: np.ndarray) -> float:
        """The mean rms error of the unknown rows of held-out sequences."""
        equations = [one.equations(settings) for one in self.each]
        found = []
        for fold in range(QUARTERS):
            own = [one for one, k in zip(equations, self.fold, strict=True) if k != fold]
            x = self.solved(own, settings)
            held = [one for one, k in zip(equations, self.fold, strict=True) if k == fold]
            found += [np.sqrt(max(x @ H @ x - 2 * b @ x + y, 0)) for H, b, y in held]
        return float(np.mean(found))

    def best(self) -> np.ndarray:
        """Settings by moves of one at a time, each kept where the error falls."""
        best, least = START.copy(), self.error(START)
        for factor, k in product(MOVES, range(len(START))):
            for move in (1 / factor, factor):
                tried = best.copy()
                tried[k] *= move
                if (error := self.error(tried)) < least:
                    best, least = tried, error
        return best


# Running a model over a record of which the first rows of each sequence are known.

RELATIVE = "rms of the sequence"
"""The name of a sigma that is the rms of each sequence's output."""


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
        last = slice(max(rest.start - max(1, round(PART * misfit.lasts)), rows.start), rest.start)
        missed = record.output[last] - values[last]
        error = np.nanmean(missed) if misfit.lasts else np.nan
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
