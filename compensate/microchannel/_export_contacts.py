"""Export of an estimator of several contacts to a file that runs without JAX."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from hysteresis import InputError
from hysteresis.networks import StaircaseNetwork

from ..export._document import write
from ..export._export import Quantity, longest_step
from ..export._precision import require_double
from ..runtime._contact_forces import KIND
from ..runtime._file import SCHEMA
from ._export import network_document
from ._multi import MultiContactEstimator
from ._sensors import ChannelSensor

GOLDEN = 60
"""Samples that a file is checked with when it is loaded, some milliseconds each."""


def export_contacts(
    estimator: MultiContactEstimator,
    path: str | Path,
    readings: ArrayLike,
    times: ArrayLike,
    *,
    channels: Sequence[Quantity],
    contacts: Sequence[Quantity],
    title: str = "",
) -> Path:
    """Write an estimator of several contacts as JSON for `compensate.runtime.load_contacts`.

    The file has the forces at once; those that come late, of `MotionFilter(delay=...)`, are JAX's alone.

    **Arguments:**

    - `estimator`: of a `ChannelSensor` whose models are `StaircaseNetwork`s, as `hysid.train_contacts`
      makes it.
    - `readings` (samples, channels), `times` (samples,) in s: typical of its use, from rest. The file keeps
      the first of them with their forces, and checks them when it is loaded.
    - `channels`, `contacts`: name and unit of each; forces are in N.
    - `title`: a description in one line.

    **Returns:** the path of the file.

    **Raises:** `InputError` for other sensors and models, another number of names than of channels or
    contacts, fewer than two finite readings, and JAX in single precision.

    **Example:**

        >>> record = presses_of_b[0]
        >>> names = [compensate.Quantity(name, "V") for name in ("layer 1", "layer 2")]
        >>> forces = [compensate.Quantity(name, "N") for name in "BD"]
        >>> file = compensate.microchannel.export_contacts(
        ...     learnt.estimator, folder / "contacts.json", record.reading, record.time,
        ...     channels=names, contacts=forces)
        >>> len(compensate.runtime.load_contacts(file).contacts)
        2
    """
    require_double()
    sensor = estimator.sensor
    if not isinstance(sensor, ChannelSensor) or not all(
        isinstance(model, StaircaseNetwork) and model.channels == 1 for model in sensor.models
    ):
        raise InputError(
            "not-exportable", "only sensors of staircase networks are exported.",
            fix="train them with hysid.train_contacts.",
        )  # fmt: skip
    y, t = np.asarray(readings, float), np.asarray(times, float)
    sound = np.isfinite(y).all(1)
    layers, places = np.asarray(sensor.gains).shape
    if (len(channels), len(contacts), y.shape[1]) != (layers, places, layers):
        raise InputError(
            "wrong-channels",
            f"readings of {y.shape[1]} channels, {len(channels)} names of channels and"
            f" {len(contacts)} of contacts, for {layers} channels and {places} contacts.",
            fix="give channels=[Quantity(name, unit), ...] and contacts likewise, one for each.",
        )  # fmt: skip
    if sound.sum() < 2:
        raise InputError("no-rows", "there are no readings to export for.")
    y, t = y[sound], t[sound]
    longest = longest_step(t)
    y, t = y[:GOLDEN], t[:GOLDEN]
    found, motion = estimator.simulate(t, y), estimator.motion
    document = {
        "schema": SCHEMA, "kind": KIND, "title": title or f"{places} contacts",
        "channels": [channel._asdict() for channel in channels],
        "contacts": [contact._asdict() for contact in contacts],
        "longest": longest,
        "models": [
            network_document(model) for model in sensor.models if isinstance(model, StaircaseNetwork)
        ],
        "gains": np.asarray(sensor.gains).tolist(), "zero": np.asarray(sensor.zero).tolist(),
        "reading_sigma": np.asarray(estimator.reading_sigma).tolist(),
        "motion": {
            name: getattr(motion, name)
            for name in ("high", "acceleration", "turn", "turns", "ways", "gap_s")
        },
        "golden": {
            "dt": np.diff(t, prepend=t[0]).tolist(), "reading": y.tolist(),
            "value": np.asarray(found.value).tolist(),
            "deviation": np.asarray(found.deviation).tolist(),
            "status": np.asarray(found.status).tolist(), "tolerance": 1e-6 * motion.high,
        },
    }  # fmt: skip
    return write(path, document)
