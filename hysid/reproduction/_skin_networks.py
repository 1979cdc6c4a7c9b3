"""How the networks of a virtual skin are trained from its records: each a recipe of a few lines."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from compensate.microchannel import (
    EverettNetwork,
    ForceNetwork,
    MotionFilter,
    MultiContactEstimator,
    windows,
)
from hysteresis.networks import StaircaseNetwork
from identify import Trained, train

from ..soft_sensor._contacts import train_contacts
from ..soft_sensor._force_networks import BATCH, decaying, staircase_squares, updates_of
from ..soft_sensor._force_records import ForceRecord

Series = Float[np.ndarray, " _"]


class Learnt(NamedTuple):
    """A network, its RMSE on the tenth of the rows it did not learn from, and how it learnt."""

    model: Any
    off: float
    trained: Trained


def train_staircase(
    times: Sequence[Series],
    inputs: Sequence[Series],
    outputs: Sequence[Series],
    *,
    thresholds: Sequence[float],
    lags: Sequence[float],
    epochs: int = 1000,
    rate: float = 2e-3,
    every: int = 1,
) -> Learnt:
    """`StaircaseNetwork` from inputs to outputs, one array for each record.

    `every`: it learns from every so many rows; its memory has seen them all.
    """
    start = StaircaseNetwork.random(
        inputs, outputs, times, jax.random.key(0), thresholds=thresholds, lags=lags
    )
    pairs = zip(times, inputs, strict=True)
    x = np.concatenate([np.asarray(start.prepare(t, u))[::every] for t, u in pairs])
    y = np.concatenate([one[::every] for one in outputs])
    found = train(
        start, staircase_squares, (x, y), epochs=epochs, batch=BATCH, float32=True,
        optimizer=_decaying(rate, epochs, len(y)),
    )  # fmt: skip
    return _learnt(found)


def train_everett(
    times: Sequence[Series],
    readings: Sequence[Series],
    forces: Sequence[Series],
    *,
    epochs: int = 600,
    high_force: float,
) -> Learnt:
    """`EverettNetwork` from readings to forces, records of one length; five of them a batch."""
    t, z, F = (jnp.asarray(np.stack(part)) for part in (times, readings, forces))
    start = EverettNetwork.random(jax.random.key(0), high=float(z.max()), force=high_force)
    found = train(
        start, _sequence_squares, (t, z, F), batch=5, epochs=epochs,
        optimizer=_decaying(2e-2, epochs, len(times), 5),
    )  # fmt: skip
    return _learnt(found)


def train_recurrent(records: Sequence[ForceRecord], *, epochs: int = 100, seed: int = 0) -> Learnt:
    """The paper's `ForceNetwork` from the last forces on one location to all layers' readings."""
    forces = np.concatenate([windows(one.force) for one in records])
    readings = np.concatenate([one.reading for one in records])
    found = train(
        ForceNetwork.random(jax.random.key(seed)), _window_squares, (forces, readings),
        epochs=epochs, batch=BATCH, float32=True, patience=10,
        optimizer=_decaying(2e-3, epochs, len(forces)),
    )  # fmt: skip
    return _learnt(found._replace(module=eqx.nn.inference_mode(found.module)))


def train_channels(
    places: Sequence[Sequence[ForceRecord]],
    *,
    thresholds: Sequence[float],
    lags: Sequence[float],
    high_force: float,
    noise: float,
    epochs: int = 600,
) -> MultiContactEstimator:
    """`train_contacts` of records of one location each, with thresholds in N."""
    rows = min(sum(len(one.time) for one in records) for records in places)
    learnt = train_contacts(
        {str(k): records for k, records in enumerate(places)},
        noise=noise, high_force=high_force, lags=lags,
        thresholds=[r / high_force for r in thresholds],
        motion=MotionFilter(high_force, acceleration=10.0, turn=10.0, turns=1.0),
        updates=updates_of(epochs, rows),
    )  # fmt: skip
    return learnt.estimator


def _learnt(found: Trained) -> Learnt:
    return Learnt(found.module, float(np.sqrt(found.validation[found.best])), found)


def _decaying(
    rate: float, epochs: int, rows: int, batch: int = BATCH
) -> optax.GradientTransformation:
    """Adam over all epochs of the nine tenths of the rows that are not held out."""
    return decaying(epochs * (9 * rows // (10 * batch)), rate=rate)


def _sequence_squares(network: EverettNetwork, rows: Any, key: Any) -> Array:
    t, reading, force = rows
    return jnp.mean((jax.vmap(network.simulate)(t, reading) - force) ** 2)


def _window_squares(network: ForceNetwork, rows: Any, key: Any) -> Array:
    return jnp.mean((network(rows[0], key) - rows[1]) ** 2)
