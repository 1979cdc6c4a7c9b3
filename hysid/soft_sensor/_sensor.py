"""A soft sensor as it is used: its channels, their checks, all that was learnt of it, and its files.

soft_sensor.json   channels, names, settings       soft_sensor.npz   all arrays
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from compensate import Status, UncertainEstimate
from compensate.microchannel import (
    Changes,
    ChannelStatus,
    ForceEstimator,
    Localizer,
    Located,
    PlaceStatus,
    Position,
    PositionEstimator,
    Readout,
)
from hysteresis import InputError
from hysteresis._limits import damage_told, load_arrays
from hysteresis._serialisation import Arrays, described, rebuilt
from identify.internal import read_checked, whole_files, write_set

SHORTEST = 64
"""Samples that streams are lengthened to, and the doubles of it: as many programs are compiled."""


class Quantity(NamedTuple):
    """Name and unit of a column."""

    name: str
    unit: str = "1"


FORCE = Quantity("force", "N")


class SoftEstimate(NamedTuple):
    """Of readings (samples, channels): what each channel is worth, and what was learnt to be told of them.

    `force` in the sensor's unit; `place` an index into `localizer.names`; None for what was not learnt.
    """

    channels: Changes
    force: UncertainEstimate | None
    place: Located | None
    position: Position | None


class Words(NamedTuple):
    """The statuses of a `SoftEstimate` as words (samples,): "OK" only where every channel is sound.

    `channels` names those that are not, "layer 2: STUCK". A stuck or saturated channel stands before the
    status of what was made of it, a gap behind.
    """

    channels: list[str]
    force: list[str]
    place: list[str]
    position: list[str]


@dataclass(frozen=True)
class SoftSensor:
    """What `hysid microchannel train` leaves behind: the readings of some channels in, what is known out.

    **Arguments:**

    - `channels`: their names and units, in the order in which readings come.
    - `readout`: checks of every channel; its zero is the sensor at rest, from which places are told.
    - `step`: time from sample to sample, where time goes back and the stream nevertheless goes on.
    - `time_unit`: of all times.
    - `force`: from the readings as they are, with `force_in`, its name and unit.
    - `localizer`: places from the changes of the readings. `position`: coordinates, with `position_in`.

    Raises `InputError` where the channels of the parts differ, or nothing was learnt.
    """

    channels: tuple[Quantity, ...]
    readout: Readout
    step: float = 0.0
    force: ForceEstimator | None = None
    force_in: Quantity = FORCE
    localizer: Localizer | None = None
    position: PositionEstimator | None = None
    position_in: tuple[Quantity, ...] = ()
    time_unit: str = "s"

    def __post_init__(self) -> None:
        count = [self.readout.channels]
        count += [] if self.localizer is None else [len(self.localizer.clouds.noise)]
        count += [] if self.position is None else [len(self.position.centre) - 1]
        if set(count) != {len(self.channels)}:
            raise InputError(
                "wrong-channels", f"A sensor of {len(self.channels)} channels has parts of {count}.",
                place="SoftSensor", fix="Train all parts on the readings of one sensor.",
            )  # fmt: skip
        if self.force is None and self.localizer is None and self.position is None:
            said = "The sensor estimates neither a force, nor a place, nor a position."
            raise InputError("nothing-to-learn", said)

    def estimate(
        self,
        time: Float[np.ndarray, " samples"] | None,
        readings: Float[np.ndarray, "samples channels"],
    ) -> SoftEstimate:
        """All estimates over a stream that begins with the sensor at rest. Never raises for its values.

        `time` in `time_unit`; None where nothing depends on it. After a gap the stream goes on.
        """
        readings = np.asarray(readings, float)
        samples = len(readings)
        t = np.zeros(samples) if time is None else np.asarray(time, float)
        t, y = (lengthened(part) for part in (t, readings))
        changes = self.readout.simulate(t, y)
        value, states = (np.asarray(part)[:samples] for part in changes)
        sound = np.where(states == ChannelStatus.MISSING, np.nan, value)
        force, position = None, None
        if self.force is not None:
            seen = y if len(self.channels) > 1 else y[:, 0]
            found = self.force.simulate(self._forwards(t), seen)
            whole = (jnp.broadcast_to(part, (len(y),)) for part in found[:3])
            force = UncertainEstimate(*(part[:samples] for part in whole))
        if self.position is not None:
            there = self.position.estimate(lengthened(sound))
            position = Position(*(part[:samples] for part in there))
        channels = Changes(*(part[:samples] for part in changes))
        place = None if self.localizer is None else self.localizer.locate(sound)
        return SoftEstimate(channels, force, place, position)

    def words(self, found: SoftEstimate) -> Words:
        """Of `estimate`."""
        states = np.asarray(found.channels.status)
        channels = []
        for row in states.tolist():
            pairs = zip(self.channels, row, strict=True)
            faults = [f"{c.name}: {ChannelStatus(s).name}" for c, s in pairs if s]
            channels.append(", ".join(faults) or "OK")
        worst = states.max(axis=1).tolist()
        return Words(
            channels,
            [] if found.force is None else _worst(worst, found.force.status, Status),
            [] if found.place is None else _worst(worst, found.place.status, PlaceStatus),
            [] if found.position is None else _worst(worst, found.position.status, PlaceStatus),
        )

    def _forwards(self, t: np.ndarray) -> np.ndarray:
        """A clock that never goes back: where it does, a step later."""
        good, found = np.isfinite(t), np.full(len(t), np.nan)
        steps = np.diff(t[good], prepend=t[good][:1])
        found[good] = np.cumsum(np.where(steps < 0, self.step, steps))
        return found


def lengthened(rows: np.ndarray) -> np.ndarray:
    """Its last row repeated, so that few lengths are compiled: what comes later changes nothing."""
    length = SHORTEST
    while length < len(rows):
        length *= 2
    return np.pad(rows, [(0, length - len(rows))] + [(0, 0)] * (rows.ndim - 1), mode="edge")


def _worst(channels: list[int], own: object, kind: type[Status] | type[PlaceStatus]) -> list[str]:
    found = []
    for channel, status in zip(channels, np.asarray(own).tolist(), strict=True):
        word, faulty = kind(status).name, channel in (ChannelStatus.STUCK, ChannelStatus.SATURATED)
        if (faulty and word != "INVALID") or (channel and word == "OK"):
            word = ChannelStatus(channel).name
        found.append(word)
    return found


SCHEMA = 1
KIND = "hysid soft sensor"
WORDS, ARRAYS = "soft_sensor.json", "soft_sensor.npz"
AGAIN = "train again (--overwrite)."
MAKE = "train a sensor: hysid microchannel train FILE --input COL --force COL --out DIR."

PARTS = ("readout", "force", "localizer", "position")


def save_sensor(sensor: SoftSensor, folder: str | Path) -> Path:
    """Write a sensor to a folder, which is made; one that is there is written over.

    Raises `InputError` for a part that cannot be kept in a file.
    """
    folder = Path(folder)
    arrays: Arrays = {}
    parts = {name: described(getattr(sensor, name), name, arrays)[0] for name in PARTS}
    document = {
        "schema": SCHEMA, "kind": KIND,
        "channels": [channel._asdict() for channel in sensor.channels], "step": sensor.step,
        "time_unit": sensor.time_unit,
        "force_in": sensor.force_in._asdict(),
        "position_in": [coordinate._asdict() for coordinate in sensor.position_in],
        **parts,
    }  # fmt: skip
    write_set(folder, WORDS, document, {ARRAYS: arrays})
    return folder


def load_sensor(folder: str | Path) -> SoftSensor:
    """Load a trained soft sensor from the folder that `hysid microchannel train` wrote.

    Nothing in the folder is executed.

    **Arguments:** `folder`: with soft_sensor.json and soft_sensor.npz.

    **Returns:** a `SoftSensor`: its channels, and an estimator for each quantity it was trained for.

    **Raises:** `InputError` where the folder has no sensor, a file is damaged or was changed, or a newer
    version of hysid wrote it.

    **Example:**

        >>> sensor = hysid.load_sensor(sensor_folder)
        >>> [channel.name for channel in sensor.channels]
        ['layer 1', 'layer 2']
    """
    folder = Path(folder)
    document = read_checked(folder, WORDS, SCHEMA, make=MAKE, again=AGAIN)
    with damage_told(WORDS, folder, AGAIN):
        if document["kind"] != KIND:
            raise ValueError("it holds something else")
        arrays = load_arrays(whole_files(folder, document, AGAIN)[ARRAYS])
        return SoftSensor(
            tuple(Quantity(**words) for words in document["channels"]),
            step=float(document["step"]), time_unit=document["time_unit"],
            force_in=Quantity(**document["force_in"]),
            position_in=tuple(Quantity(**words) for words in document["position_in"]),
            **{name: rebuilt(document[name], arrays) for name in PARTS},
        )  # fmt: skip
