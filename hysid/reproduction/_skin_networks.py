"""How the networks of a virtual skin are trained from its records: each a recipe of a few lines."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from compensate.microchannel import ForceNetwork, MotionFilter, MultiContactEstimator, windows
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
        optimizer=decaying_over(rate, epochs, len(y)),
    )  # fmt: skip
    return learnt_of(found)


def train_recurrent(records: Sequence[ForceRecord], *, epochs: int = 100, seed: int = 0) -> Learnt:
    """The paper's `ForceNetwork` from the last forces on one location to all layers' readings."""
    forces = np.concatenate([windows(one.force) for one in records])
    readings = np.concatenate([one.reading for one in records])
    found = train(
        ForceNetwork.random(jax.random.key(seed)), _window_squares, (forces, readings),
        epochs=epochs, batch=BATCH, float32=True, patience=10,
        optimizer=decaying_over(2e-3, epochs, len(forces)),
    )  # fmt: skip
    return learnt_of(found._replace(module=eqx.nn.inference_mode(found.module)))


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


def learnt_of(found: Trained) -> Learnt:
    return Learnt(found.module, float(np.sqrt(found.validation[found.best])), found)


def decaying_over(
    rate: float, epochs: int, rows: int, batch: int = BATCH
) -> optax.GradientTransformation:
    """Adam over all epochs of the nine tenths of the rows that are not held out."""
    return decaying(epochs * (9 * rows // (10 * batch)), rate=rate)


def _window_squares(network: ForceNetwork, rows: Any, key: Any) -> Array:
    return jnp.mean((network(rows[0], key) - rows[1]) ** 2)
