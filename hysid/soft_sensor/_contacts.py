"""Several contacts at once, learnt from presses of one place at a time."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from compensate.microchannel._multi import ChannelSensor, MotionFilter, MultiContactEstimator
from hysteresis import InputError
from hysteresis.models._staircase_network import StaircaseNetwork

from ._force_records import ForceData, ForceRecord, gather, held_out_parts
from ._force_training import THRESHOLDS, lags_of, train_staircase

PARTS, UPDATES = 5, 20_000
BEYOND = 1.1
"""Of the largest force that was taught: what the estimator may find."""
STILL = 0.02
"""Of the largest rate of a place's presses: what moves more slowly is held."""


class ContactTraining(NamedTuple):
    """An estimator of several contacts, and how well each place's readings are described.

    - `estimator`: with its places in the order of `names`.
    - `off` (places, channels): rms error of the readings of presses that were held out, in their unit.
    - `gains` (channels, places); `zero` (channels,): the reading at rest.
    """

    estimator: MultiContactEstimator
    names: tuple[str, ...]
    off: Float[np.ndarray, "places channels"]
    gains: Float[np.ndarray, "channels places"]
    zero: Float[np.ndarray, " channels"]


def train_contacts(
    places: Mapping[str, Sequence[ForceRecord]],
    *,
    noise: float = 0.0,
    high_force: float | None = None,
    motion: MotionFilter | None = None,
    thresholds: Sequence[float] = THRESHOLDS,
    lags: Sequence[float] | None = None,
    updates: int = UPDATES,
    seed: int = 0,
    tell: Callable[[int, int, str], None] = lambda done, total, words: None,
) -> ContactTraining:
    """Learn to estimate the forces on several places at once, from presses of one place at a time:

        z_l = zero_l + sum_k G_lk M_k[F_k]

    Channels in series add what each place does to them. M_k is a small network on the memory of the force
    (`StaircaseNetwork`), fitted to the channels weighted by their gains G. A filter then finds the forces
    that make the readings. Whole presses are held out of every place, to stop the training, and to say how
    far the readings are off.

    **Arguments:**

    - `places`: name -> records of presses of that place alone, each from rest, with readings (samples,
      channels) in the same channels and unit.
    - `noise`: of a reading, in its unit; it counts where the networks err less.
    - `high_force`: the largest force, N; by default a tenth more than any that was taught.

    **Other arguments:**

    - `motion`: how forces move; by default turns as often and rates as large as in the records.
    - `thresholds`: half widths of the plays, in parts of the largest force. `lags`: delays, s; by default
      from the sampling to the length of the records.
    - `updates`: steps of each training, of 64 rows. `seed`: of weights and batches.
    - `tell`: called with (done, total, words) now and then.

    **Returns:** a `ContactTraining`. Its estimator takes readings (samples, channels).

    **Raises:** `InputError` for fewer than two places, fewer channels than places, and as `train_force`
    does for records.

    **Source:** Kim and Park (2018), section III D, which presses each place alone, too.

    **Example:**

        >>> learnt = hysid.train_contacts({"B": presses_of_b, "D": presses_of_d}, updates=20)
        >>> learnt.names, learnt.gains.shape
        (('B', 'D'), (2, 2))
    """
    if len(places) < 2:
        raise InputError(
            "bad-option", f"{len(places)} place.", fix="give the presses of two places, or more."
        )
    data = {name: gather(records) for name, records in places.items()}
    channels = {one.channels for one in data.values()}
    if len(channels) > 1 or min(channels) < len(data):
        raise InputError(
            "wrong-channels",
            f"{len(data)} places and {' and '.join(map(str, sorted(channels)))} channels.",
            cause="Forces on as many places cannot be told apart from fewer channels.",
            fix="give every record the same channels, at least one for each place.",
        )
    first = [one.reading[list(one.starts)] for one in data.values()]
    zero = np.median(np.concatenate(first), axis=0)
    models, gains, off, rests = [], [], [], []
    for k, (name, one) in enumerate(data.items()):
        signal = one.reading - zero
        strongest = signal[:, np.std(signal, axis=0).argmax()]
        gain = signal.T @ strongest / (strongest @ strongest)

        def told(epoch: int, epochs: int, words: str, k: int = k, name: str = name) -> None:
            tell(round(1000 * (k + epoch / epochs)), 1000 * len(data), f"{name}: {words}")

        model, held = _learnt(
            one, signal @ gain / (gain @ gain), thresholds, lags, updates, seed + k, told
        )
        found = np.asarray(model.evaluate(model.prepare(one.time, one.force, starts=one.starts)))
        missed = signal - found[:, None] * gain
        # What a network says of a sensor at rest is part of the zero, or several contacts would add it.
        idle = float(model.step(model.init(), 0.0, 0.0)[1])
        models.append(replace(model, centre=(*model.centre[:-1], model.centre[-1] - idle)))
        gains.append(gain)
        rests.append(zero + gain * idle)
        off.append(np.sqrt(np.mean(missed[held] ** 2, axis=0)))
    most = max(float(one.force.max()) for one in data.values())
    high = BEYOND * most if high_force is None else high_force
    moving = motion_of(list(data.values()), high) if motion is None else motion
    G, errors = np.stack(gains, axis=1), np.stack(off)
    sigma = np.maximum(errors.max(axis=0), max(noise, 1e-12))
    zero = np.mean(rests, axis=0)
    sensor = ChannelSensor(models, G, zero)
    return ContactTraining(
        MultiContactEstimator(sensor, sigma, moving), tuple(data), errors, G, zero
    )


def motion_of(data: Sequence[ForceData], high: float) -> MotionFilter:
    """How forces moved in some records: how fast, and how often they turned.

    Machines move at constant rates between turns, and fingers do not. So within a second a rate may change
    by as much as it changes at a turn.
    """
    rates, turns, seconds = [np.zeros(0)], 0, 0.0
    for one, rows in ((each, rows) for each in data for rows in each.sequences()):
        rate = np.diff(one.force[rows]) / np.diff(one.time[rows])
        moves = np.abs(rate) > STILL * max(float(np.abs(rate).max(initial=0.0)), 1e-300)
        turns += int((np.diff(np.where(moves, np.sign(rate), 0.0)) != 0).sum())
        seconds += float(np.ptp(one.time[rows]))
        rates.append(rate[moves])
    moving = np.concatenate(rates)
    turn = max(float(np.sqrt(np.sum(moving**2) / max(len(moving), 1))), 1e-3 * high)
    return MotionFilter(
        high, acceleration=turn, turn=turn, turns=max(turns, 1) / max(seconds, 1e-9)
    )


def _learnt(
    data: ForceData,
    signal: Float[np.ndarray, " rows"],
    thresholds: Sequence[float],
    lags: Sequence[float] | None,
    updates: int,
    seed: int,
    tell: Callable[[int, int, str], None],
) -> tuple[StaircaseNetwork, Bool[np.ndarray, " rows"]]:
    """A network from force to signal, and the rows that were held out."""
    cut = data.starts[1:]
    times, forces, signals = (np.split(x, cut) for x in (data.time, data.force, signal))
    start = StaircaseNetwork.random(
        forces, signals, times, jax.random.key(seed), thresholds=thresholds,
        lags=lags_of(data) if lags is None else lags, scale=(float(data.force.max()),),
    )  # fmt: skip
    held = held_out_parts(data, min(PARTS, data.presses)) == 0
    x = np.asarray(start.prepare(data.time, data.force, starts=data.starts))
    pairs = [(x[at], signal[at]) for at in (~held, held)]
    return train_staircase(start, pairs, updates, seed=seed, progress=tell).module, held
