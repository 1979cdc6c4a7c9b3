"""A soft sensor's force estimator learnt from its records: by networks that each leave a part of them out,
or by fits."""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

import identify
from compensate import invert
from compensate.internal import BackwardsModel
from compensate.microchannel._force import ForceEstimator
from hysteresis import AbstractModel, InputError, Record
from hysteresis.internal import StaircaseNetwork
from hysteresis.numerics._functions import NORMAL_95
from identify.internal import train
from identify.training._train import Trained

from ._force_records import ForceData, ForceRecord, gather, held_out_parts

Tell = Callable[[int, int, str], None]

THRESHOLDS = (0.05, 0.1, 0.2, 0.4)
"""Half widths of the plays, in parts of a channel's range."""
LAGS, REPEATS = 6, 20
"""Delays of a channel: from a sampling step to the longest that was seen this often."""
DECAYS = (0.0, 0.2)
"""Weight decays tried: many channels of one press need some, thousands of presses none."""
HIDDEN, BATCH, RATE = (64, 32), 64, 3e-3


class Settings(NamedTuple):
    """What a training is asked for; see `train_force`."""

    members: int
    updates: int
    seed: int
    checkpoint: Path | None
    resume: bool
    tell: Tell


class Found(NamedTuple):
    """A model from reading to force, and what it made of rows it had not seen.

    `held_out` (rows,): NaN where nothing was held out. `curves`: of every training. `words`: settings.
    """

    model: AbstractModel
    held_out: Float[np.ndarray, " rows"]
    curves: tuple[Trained, ...]
    words: dict[str, Any]


def updates_of(epochs: int, rows: int) -> int:
    """How many updates take so many epochs."""
    return max(1, epochs * rows // BATCH)


def lags_of(data: ForceData) -> tuple[float, ...]:
    """Delays in s that records of this length and sampling can tell of."""
    steps = np.concatenate([np.diff(data.time[rows]) for rows in data.sequences()])
    lengths = np.array([np.ptp(data.time[rows]) for rows in data.sequences()])
    least = float(np.median(steps))
    most = max(3 * least, min(float(lengths.max()), float(lengths.sum()) / REPEATS))
    return tuple(float(tau) for tau in np.geomspace(least, most, LAGS))


def train_networks(
    data: ForceData,
    part: np.ndarray,
    settings: Settings,
    *,
    only: Sequence[int] | None = None,
    decays: Sequence[float] = DECAYS,
) -> Found:
    """The mean of `StaircaseNetwork`s, each without one part of the records, which stops its training.

    `only`: the parts left out in turn, all by default. `decays`: of the weights, tried on two of them.
    """
    known = data.known & (part >= 0)
    left_out = tuple(range(int(part.max()) + 1)) if only is None else tuple(only)
    first = data.reading[np.array(data.starts)].reshape(len(data.starts), -1)
    own = {
        "thresholds": THRESHOLDS, "lags": lags_of(data), "rest": np.median(first, 0).tolist(),
        "hidden": HIDDEN,
        "scale": np.ptp(data.reading.reshape(len(data.time), -1), axis=0).tolist(),
    }  # fmt: skip
    cut = data.starts[1:]
    times, readings = np.split(data.time, cut), np.split(data.reading, cut)
    forces = [data.force[known]]
    keys = jax.random.split(jax.random.key(settings.seed), max(left_out) + 1)
    starts = {k: StaircaseNetwork.random(readings, forces, times, keys[k], **own) for k in left_out}
    # A run may begin at any rest: presses are learnt as they came, and once more as if they were first.
    plain = starts[left_out[0]]
    fresh, x = (
        np.asarray(plain.prepare(data.time, data.reading, starts=begin))
        for begin in (data.rests, data.starts)
    )
    both = [x] if data.rests == data.starts else [x, fresh]
    first = left_out[:2]
    done = {"of": len(decays) * len(first) + len(left_out) - len(first), "now": 0}

    if (folder := settings.checkpoint) is not None:
        folder.mkdir(parents=True, exist_ok=True)

    def one(k: int, decay: float) -> Trained:
        held = part == k

        def told(epoch: int, epochs: int, words: str) -> None:
            share = (done["now"] + epoch / epochs) / done["of"]
            settings.tell(round(1000 * share), 1000, f"network {k + 1}: {words}")

        pairs = [
            (np.concatenate([x[at] for x in both]), np.tile(data.force[at], len(both)))
            for at in (known & ~held, known & held)
        ]
        found = train_staircase(
            starts[k], pairs, settings.updates, decay, seed=settings.seed,
            progress=told, resume=settings.resume,
            checkpoint=folder and folder / f"network-{k}-decay-{decay:g}.npz",
        )  # fmt: skip
        done["now"] += 1
        return found

    tried = {decay: [one(k, decay) for k in first] for decay in decays}
    decay = min(tried, key=lambda d: sum(float(f.validation[f.best]) for f in tried[d]))
    trained = [*tried[decay], *(one(k, decay) for k in left_out[len(first) :])]
    held_out = np.full(len(part), np.nan)
    for k, found in zip(left_out, trained, strict=True):
        at = part == k
        held_out[at] = np.asarray(found.module.evaluate(jnp.asarray(fresh[at])))
    model = StaircaseNetwork.mean([found.module for found in trained])
    words = {"thresholds": THRESHOLDS, "lags": own["lags"], "hidden": HIDDEN, "decay": decay}
    return Found(model, held_out, tuple(trained), words)


def train_staircase(
    start: StaircaseNetwork, pairs: Sequence[Any], updates: int, decay: float = 0.0, **options: Any
) -> Trained:  # fmt: skip
    """A network of rows (inputs x, output), learnt and held out, by about so many steps."""
    learnt, held_out = pairs
    rows = len(learnt[1])
    batch = min(BATCH, rows)
    epochs = max(1, updates * batch // rows)
    return train(
        start, staircase_squares, learnt, validation=held_out, epochs=epochs, batch=batch, float32=True,
        optimizer=decaying(epochs * (rows // batch), decay), **options,
    )  # fmt: skip


def predicted(model: AbstractModel, data: ForceData) -> Float[np.ndarray, " rows"]:
    """The model's force at every row, each record from rest."""
    prepared = model.prepare(data.time, data.reading, starts=data.starts)
    return np.asarray(model.evaluate(prepared))


def staircase_squares(network: StaircaseNetwork, rows: Any, key: Any) -> Array:
    """Mean squared error of rows (inputs x, output)."""
    return jnp.mean((network.evaluate(rows[0]) - rows[1]) ** 2)


@cache
def decaying(steps: int, decay: float = 0.0, rate: float = RATE) -> optax.GradientTransformation:
    """Adam whose steps shrink to nothing over the training; the same one is compiled once."""
    schedule = optax.cosine_decay_schedule(rate, max(1, steps))
    return optax.adamw(schedule, weight_decay=decay) if decay else optax.adam(schedule)


def fit_structured(data: ForceData, part: np.ndarray, settings: Settings) -> Found:
    """The better of two fits on the part held out, of which neither has seen it."""
    if data.channels > 1:
        said = f"A structured estimator takes one reading, but there are {data.channels}."
        fix = 'kind="network" (--kind network), or hysid.fit of several inputs.'
        raise InputError("wrong-channels", said, fix=fix)
    held = part == part.max()
    learnt = data.known & (part >= 0) & ~held
    tried: list[tuple[float, int, Found]] = []
    faults = []
    for k, way in enumerate(("reading -> force", "force -> reading, run backwards")):
        settings.tell(k, 2, way)
        try:
            model, words = _fitted(data, learnt, settings.seed, backwards=k == 1)
        except InputError as error:
            faults.append(str(error))
            continue
        held_out = np.where(held, predicted(model, data), np.nan)
        off = float(np.mean((held_out - data.force)[held & data.known] ** 2))
        # A model that cannot be trusted to stay finite is none.
        if np.isfinite(off):
            tried.append((off, k, Found(model, held_out, (), {"model": f"{way}: {words}"})))
    if not tried:
        raise InputError("nothing-fits", " ".join(faults))
    settings.tell(2, 2, "fitted")
    return min(tried)[2]


def _fitted(
    data: ForceData, learnt: np.ndarray, seed: int, *, backwards: bool
) -> tuple[AbstractModel, str]:
    """The model as the readings come: a lag between clocks would need those of later."""
    pair, labels = (data.reading, data.force), tuple(map(str, range(len(data.starts))))
    if backwards:
        force = np.interp(data.time, data.time[data.known], data.force[data.known])
        pair = force, data.reading
    rows = np.arange(len(data.time))
    record = Record(*pair, data.time, np.array(data.starts), labels, learnt, rows)
    found = identify.fit(record, clocks="keep", seed=seed)
    return BackwardsModel(invert(found.model)) if backwards else found.model, found.name


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
