"""A soft sensor as it is used: its channels, their checks, all that was learnt of it, and its files.

soft_sensor.json   channels, names, settings       soft_sensor.npz   all arrays
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from compensate import Quantity, Status
from compensate.microchannel import Localizer
from compensate.microchannel._force import ForceEstimator
from compensate.microchannel._localizer import PlaceStatus
from compensate.microchannel._position import PositionEstimator
from compensate.microchannel._readout import ChannelStatus, Readout
from hysteresis import InputError
from hysteresis._limits import damage_told, load_arrays
from hysteresis._serialisation import Arrays, described, rebuilt
from identify.internal import read_checked, whole_files, write_set

SHORTEST = 64
"""Samples that streams are lengthened to, and the doubles of it: as many programs are compiled."""


FORCE = Quantity("force", "N")


Estimates = dict[str, np.ndarray]
"""Columns over rows, of what a sensor was taught: force in its unit, force_sd, force_status; place,
probability, place_status; position (rows, coordinates), position_sd, position_status; and channels.

Statuses are "OK" only where every channel is sound: `channels` names those that are not, "layer 2: STUCK".
A stuck or saturated channel stands before the status of what was made of it, a gap behind.
"""


def flagged(found: Estimates) -> Bool[np.ndarray, " rows"]:
    """Rows where something is not to be used without a thought."""
    words = [column for name, column in found.items() if name.endswith("status")]
    return np.any(~np.isin(words, ("OK", "NO_PRESS")), axis=0)


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
    ) -> Estimates:
        """All estimates over a stream that begins with the sensor at rest. Never raises for its values.

        `time` in `time_unit`; None where nothing depends on it. After a gap the stream goes on.
        """
        readings = np.asarray(readings, float)
        n, found = len(readings), Estimates()
        t = np.zeros(n) if time is None else np.asarray(time, float)
        t, y = (lengthened(part) for part in (t, readings))
        value, states = (np.asarray(part)[:n] for part in self.readout.simulate(t, y))
        sound = np.where(states == ChannelStatus.MISSING, np.nan, value)
        worst = states.max(axis=1).tolist()
        if self.force is not None:
            of = self.force.simulate(self._forwards(t), y if len(self.channels) > 1 else y[:, 0])
            value, deviation, status = (
                np.broadcast_to(part, len(y))[:n] for part in (of.value, of.deviation, of.status)
            )
            words = _worst(worst, status, Status)
            found |= {"force": value, "force_sd": deviation, "force_status": words}
        if self.localizer is not None:
            names = np.array([*map(str, self.localizer.names), ""], object)
            at = self.localizer.locate(sound)
            found |= {
                "place": names[at.place], "probability": at.probability.max(1),
                "place_status": _worst(worst, at.status, PlaceStatus),
            }  # fmt: skip
        if self.position is not None:
            there = self.position.estimate(lengthened(sound))
            point, deviation, status = (np.asarray(part)[:n] for part in there)
            words = _worst(worst, status, PlaceStatus)
            idle = np.isin(words, ("NO_PRESS", "INVALID"))
            found |= {
                "position": np.where(idle[:, None], np.nan, point),
                "position_sd": np.where(idle, np.nan, deviation), "position_status": words,
            }  # fmt: skip
        return found | {
            "channels": np.array([self._faults(row) for row in states.tolist()], object)
        }

    def _faults(self, states: list[int]) -> str:
        """The channels of a row that are not sound, with what is wrong."""
        pairs = zip(self.channels, states, strict=True)
        return ", ".join(f"{c.name}: {ChannelStatus(s).name}" for c, s in pairs if s) or "OK"

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


def _worst(channels: list[int], own: Any, kind: type[Status] | type[PlaceStatus]) -> Any:
    found = []
    for channel, status in zip(channels, np.asarray(own).tolist(), strict=True):
        word, faulty = kind(status).name, channel in (ChannelStatus.STUCK, ChannelStatus.SATURATED)
        if (faulty and word != "INVALID") or (channel and word == "OK"):
            word = ChannelStatus(channel).name
        found.append(word)
    return np.array(found, object)


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
