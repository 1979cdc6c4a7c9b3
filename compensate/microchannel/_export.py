"""Export of estimators of one force or several to files that run without JAX."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError
from hysteresis.models._staircase_network import StaircaseNetwork

from ..export._document import nodes_of, require_double, tree_of, write
from ..export._export import DEEP, Quantity, deepest, has_rates, longest_step
from ..runtime import _contact_forces, _network
from ..runtime._file import SCHEMA, number
from ._force import BackwardsModel, ForceEstimator
from ._multi import MultiContactEstimator

GOLDEN, GOLDEN_OF_SEVERAL = 200, 60
"""Samples that a file is checked with when it is loaded; several contacts take milliseconds a sample."""

READING, FORCE = Quantity("reading"), Quantity("force", "N")


def export_force(
    estimator: ForceEstimator, path: str | Path, readings: ArrayLike, *, times: ArrayLike | None = None,
    channels: Sequence[Quantity] = (READING,), estimate: Quantity = FORCE, title: str = "",
) -> Path:  # fmt: skip
    """Write an estimator as JSON for `compensate.runtime.load`, with readings to verify it on loading.

    **Arguments:**

    - `estimator`: of a `StaircaseNetwork`, or a chain of models that `invert` takes.
    - `readings`: (samples,), or (samples, channels), typical of its use. The file keeps the first of them
      with their forces, and its Preisach memory is as deep as they need.

    **Other arguments:**

    - `times` (samples,): of the readings, s.
    - `channels`: name and unit of each channel; `estimate`: of the force.
    - `title`: a description in one line.

    **Returns:** the path of the file.

    **Raises:** `InputError` for a model that cannot be exported, fewer than two finite readings, missing
    times where the model needs them, another number of names than of channels, and JAX in single
    precision.

    **Example:**

        >>> y = model.simulate(t, u)
        >>> file = compensate.microchannel.export_force(estimator, folder / "force.json", y)
        >>> compensate.runtime.load(file).high
        6.0
    """
    require_double()
    y = np.asarray(readings, float)
    count = 1 if y.ndim == 1 else y.shape[1]
    if len(channels) != count:
        raise InputError(
            "wrong-channels", f"readings of {count} channels and {len(channels)} names.",
            fix="channels=[Quantity(name, unit), ...], one for each.",
        )  # fmt: skip
    y, t = _sound(y, times)
    model, rates = _program(estimator.model, t, y)
    if rates and t is None:
        raise InputError(
            "no-time", "this model depends on the rate, and no times were given.",
            fix="give the times of the readings.",
        )  # fmt: skip
    t = np.zeros(len(y)) if t is None else t
    longest = longest_step(t) if rates else None
    t, y = t[:GOLDEN], y[:GOLDEN]
    found = estimator.simulate(t, y)
    ends = (estimator.low_reading, estimator.high_reading)
    limits = zip(*(np.broadcast_to(np.asarray(end, float), (count,)) for end in ends), strict=True)
    document = {
        "schema": SCHEMA, "kind": _network.KIND, "title": title or type(estimator.model).__name__,
        "channels": [channel._asdict() for channel in channels], "estimate": estimate._asdict(),
        "limits": [[number(low), number(high)] for low, high in limits],
        "high": estimator.high, "scale": estimator.newtons,
        "deviation": float(estimator.deviation), "rates": rates,
        "longest": longest, "model": model,
        "golden": _told(t, y, found) | {"tolerance": 1e-9 * estimator.high},
    }  # fmt: skip
    return write(path, document)


def _sound(y: np.ndarray, times: Any) -> tuple[np.ndarray, Any]:
    """Readings that are whole, and their times, where they are given."""
    sound = np.isfinite(y.reshape(len(y), -1)).all(1)
    if sound.sum() < 2:
        raise InputError("no-rows", "there are no readings to export for.")
    return y[sound], None if times is None else np.asarray(times, float)[sound]


def _told(t: np.ndarray, y: np.ndarray, found: Any) -> dict[str, Any]:
    """Readings, and what they are told as."""
    known = {"value": found.value, "status": found.status, "reading": y}
    return {"dt": np.diff(t, prepend=t[0]).tolist()} | {
        name: np.asarray(values).tolist() for name, values in known.items()
    }


def _program(
    model: AbstractModel, t: np.ndarray | None, y: np.ndarray
) -> tuple[dict[str, Any], bool]:
    """The model as plain numbers, and whether it needs times."""
    if isinstance(model, StaircaseNetwork):
        return _network_document(model), bool(model.times)
    if y.ndim > 1:
        raise InputError(
            "not-exportable", f"a {type(model).__name__} of several channels cannot be exported.",
            fix="train a network.",
        )  # fmt: skip
    backwards = isinstance(model, BackwardsModel)
    chain = _behind(model.compensator) if backwards else model
    dt = np.zeros(len(y)) if t is None else np.diff(t, prepend=t[0])
    way = "find" if backwards else "move"

    # Nothing is inverted here: what runs backwards has its inverse, and forwards a reading may fall.
    depth = deepest(tree_of(chain, depth=DEEP), way, dt.tolist(), y.tolist())
    # A quarter more than these readings needed, and never less than compensators have.
    tree = tree_of(chain, depth=max(64, depth + depth // 4))
    return {"kind": "tree", "way": way, "tree": tree}, any(map(has_rates, nodes_of(tree)))


def _behind(compensator: Any) -> AbstractModel:
    """The model of which a compensator is the inverse."""
    if not isinstance(getattr(compensator, "model", None), AbstractModel):
        raise InputError(
            "not-exportable", f"a {type(compensator).__name__} cannot be exported.",
            fix="use the estimator itself, or train a network.",
        )  # fmt: skip
    return compensator.model


def _network_document(model: Any) -> dict[str, Any]:
    """Layers that take x as it is and give y: what scales them is put into the first and the last."""
    W = [np.asarray(matrix, float) for matrix in model.matrices]
    b = [np.asarray(bias, float) for bias in model.biases]
    centre, spread = np.asarray(model.centre), np.asarray(model.spread)
    W[0] = W[0] / spread[:-1]
    b[0] = b[0] - W[0] @ centre[:-1]
    W[-1], b[-1] = spread[-1] * W[-1], centre[-1] + spread[-1] * b[-1]
    return {
        "kind": "network", "matrices": [matrix.tolist() for matrix in W],
        "biases": [bias.tolist() for bias in b],
        "thresholds": list(model.thresholds), "times": list(model.times),
        "rest": list(model.rest), "scale": list(model.scale),
    }  # fmt: skip


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
    """Write an estimator of several contacts as JSON for `compensate.runtime.load`.

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
        >>> len(compensate.runtime.load(file).contacts)
        2
    """
    require_double()
    sensor = estimator.sensor
    if not all(isinstance(one, StaircaseNetwork) and one.channels == 1 for one in sensor.models):
        raise InputError(
            "not-exportable", "only sensors of staircase networks are exported.",
            fix="train them with hysid.train_contacts.",
        )  # fmt: skip
    y = np.asarray(readings, float)
    layers, places = np.asarray(sensor.gains).shape
    if (len(channels), len(contacts), y.shape[1]) != (layers, places, layers):
        raise InputError(
            "wrong-channels",
            f"readings of {y.shape[1]} channels, {len(channels)} names of channels and"
            f" {len(contacts)} of contacts, for {layers} channels and {places} contacts.",
            fix="give channels=[Quantity(name, unit), ...] and contacts likewise, one for each.",
        )  # fmt: skip
    y, t = _sound(y, times)
    longest = longest_step(t)
    y, t = y[:GOLDEN_OF_SEVERAL], t[:GOLDEN_OF_SEVERAL]
    found, motion = estimator.simulate(t, y), estimator.motion
    document = {
        "schema": SCHEMA, "kind": _contact_forces.KIND, "title": title or f"{places} contacts",
        "channels": [channel._asdict() for channel in channels],
        "contacts": [contact._asdict() for contact in contacts],
        "longest": longest, "models": list(map(_network_document, sensor.models)),
        "gains": np.asarray(sensor.gains).tolist(), "zero": np.asarray(sensor.zero).tolist(),
        "reading_sigma": np.asarray(estimator.reading_sigma).tolist(),
        "motion": {
            name: getattr(motion, name)
            for name in ("high", "acceleration", "turn", "turns", "ways", "gap_s")
        },
        "golden": {
            **_told(t, y, found), "deviation": np.asarray(found.deviation).tolist(),
            "tolerance": 1e-6 * motion.high,
        },
    }  # fmt: skip
    return write(path, document)
