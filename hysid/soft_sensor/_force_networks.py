"""Models from reading to force: networks that each leave a part of the records out, and fits."""

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
from hysteresis import AbstractModel, InputError, Record
from hysteresis.internal import StaircaseNetwork
from identify.internal import train
from identify.training._train import Trained

from ._force_records import ForceData

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
