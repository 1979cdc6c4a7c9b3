"""A soft sensor as it is used: its channels, their checks, all that was learnt of it, and its files.

soft_sensor.json   channels, names, settings       soft_sensor.npz   all arrays
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
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
from hysteresis._escape import shell_word
from hysteresis._files import write_table
from hysteresis._limits import damage_told, load_arrays
from hysteresis._serialisation import Arrays, described, rebuilt
from hysteresis._show import aligned
from hysteresis.records._csv import fulfilling
from hysteresis.records._table import Table
from hysteresis.records._units import name_and_unit
from identify.internal import metrics, read_checked, whole_files, write_set
from identify.results._goodness_of_fit import Metrics

from ..intake._selection import Selection, in_unit
from ._learn import Targets, places_of

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


# `hysid microchannel estimate`: a soft sensor over a file, and how far off it is.

TRAINING = "training.json"
MANY = 0.2
"""Part of the presses that are found elsewhere, from which swapped wires are looked for."""
MOST_ORDERS = 6
"""Channels whose orders can all be tried."""


def estimates_of(
    sensor: SoftSensor,
    time: Float[np.ndarray, " rows"] | None,
    readings: Float[np.ndarray, "rows channels"],
    streams: Iterable[np.ndarray | slice],
) -> Estimates:
    """Every stream, given by its rows, from rest."""
    each = [
        (rows, sensor.estimate(None if time is None else time[rows], readings[rows]))
        for rows in streams
    ]
    order = np.argsort(np.concatenate([np.arange(len(readings))[rows] for rows, _ in each]))
    return {name: np.concatenate([found[name] for _, found in each])[order] for name in each[0][1]}


def judged(
    sensor: SoftSensor,
    found: Estimates,
    force: Float[np.ndarray, " rows"],
    place: np.ndarray,
    position: Float[np.ndarray, "rows coordinates"],
    counts: Bool[np.ndarray, " rows"],
) -> dict[str, Any]:
    """Error figures of what was learnt, over the rows that count and whose truth is known."""
    figures: dict[str, Any] = {}
    if (told := found.get("force")) is not None:
        known = counts & np.isfinite(force) & np.isfinite(told)
        if known.any():
            of = metrics(force[known], told[known])._asdict()
            figures["force"] = of | {"unit": sensor.force_in.unit}
    known = counts & (place != "")
    if "place" in found and known.any():
        figures["place"] = _places(sensor, found["place"], place, known, counts & (place == ""))
    if (told := found.get("position")) is None:
        return figures
    known = counts & np.isfinite(position).all(1) & np.isfinite(told).all(1)
    if known.any():
        error = np.linalg.norm(position[known] - told[known], axis=1)
        figures["position"] = {
            "mean_error": float(error.mean()), "rms_error": float(np.sqrt(np.mean(error**2))),
            "q95_error": float(np.quantile(error, 0.95)), "rows": int(known.sum()),
            "unit": sensor.position_in[0].unit,
        }  # fmt: skip
    return figures


def _places(
    sensor: SoftSensor, found: np.ndarray, place: np.ndarray, known: np.ndarray, rest: np.ndarray
) -> dict[str, Any]:
    assert sensor.localizer is not None
    names = [*map(str, sensor.localizer.names)]
    truths = [*names, *sorted(set(place[known].tolist()) - set(names))]
    pairs = Counter(zip(place[known].tolist(), found[known].tolist(), strict=True))
    taken = [[pairs[truth, name] for name in (*names, "")] for truth in truths]
    return {
        "accuracy": float((found[known] == place[known]).mean()), "rows": int(known.sum()),
        "confusion": {"places": truths, "estimates": [*names, "none"], "counts": taken},
        "rows_at_rest": int(rest.sum()), "rest_taken_for_a_place": int((rest & (found != "")).sum()),
    }  # fmt: skip


def confusion_lines(table: dict[str, Any]) -> list[str]:
    """The confusion table of `judged` as text: nothing for zero."""
    cells = [["", *table["estimates"]]] + [
        [name, *(str(n or "") for n in row)]
        for name, row in zip(table["places"], table["counts"], strict=True)
    ]
    return aligned(cells, range(1, len(cells[0])))


def estimate(
    folder: Path,
    file: Path,
    target: Path | None = None,
    *,
    where: Sequence[str] = (),
    **reading: Any,
) -> dict[str, Any]:
    """Run the sensor of a folder over a file; write the estimates beside it, or to `target`.

    A reading that is missing or no number is told so in its row, and the stream goes on. Error figures are
    over every row whose truth is in the file, under the names of the training.

    `reading`: other options of how the file is read, instead of the training's.

    Raises `InputError` for a folder without a sensor, a file without one of its channels.
    """
    if (folder / "fit.json").is_file() and not (folder / TRAINING).is_file():
        words = f"{shell_word(str(folder))} {shell_word(str(file))}"
        raise InputError(
            "wrong-channels", "This folder holds a fit, and no trained sensor.", place=str(folder),
            fix=f"Run hysid predict {words} --inverse, or without it where the force is the output.",
        )  # fmt: skip
    document = read_checked(folder, TRAINING, 1, make=MAKE, again="train again.")
    sensor = load_sensor(folder)
    selection = replace(Selection.from_json(document["selection"]), **reading)
    words = document["targets"]
    targets = Targets(words["force"], words["place"], tuple(words["position"]))
    table = selection.read(file)
    _check_channels(table, sensor)
    rows, notes = _rows(table, selection, where)
    readings = np.column_stack([in_unit(table, *c)[rows] for c in sensor.channels])
    clock = selection.time
    time = None if clock is None else in_unit(table, clock, sensor.time_unit)[rows]
    streams = _streams(table, selection, rows, time)
    if selection.dt is not None:
        time = np.empty(len(rows))
        for stream in streams:
            time[stream] = selection.dt * np.arange(len(stream))
    found = estimates_of(sensor, time, readings, streams)
    force, place, position = _truths(table, targets, sensor, rows)
    figures = judged(sensor, found, force, place, position, np.ones(len(rows), bool))
    notes += _swapped(sensor, found, readings, place)
    target = target or folder / f"estimated-{Path(file).stem}.csv"
    _write(target, sensor, found, table.line[rows], time)
    none = dict.fromkeys(Metrics._fields)
    words = {k: Counter(x.tolist()) for k, x in found.items() if k.endswith("status")}
    statuses = {k: dict(sorted(counts.items())) for k, counts in words.items()}
    return {
        **figures.pop("force", none), **figures, "flagged": int(flagged(found).sum()),
        "rows": len(rows), "statuses": statuses, "channels_at_fault": _faults(sensor, found),
        "notes": notes, "file": str(target),
    }  # fmt: skip


def _check_channels(table: Table, sensor: SoftSensor) -> None:
    for channel in sensor.channels:
        if channel.name not in table.columns:
            fix = "Rename the column; if the channel has failed, add it with empty cells."
            bare = name_and_unit(channel.name)[0]
            if alike := [name for name in table.columns if name_and_unit(name)[0] == bare]:
                fix = f"Give {alike[0]!r} in {channel.unit}, under the name {channel.name!r}."
            have = ", ".join(map(repr, table.columns))
            raise InputError(
                "wrong-channels",
                f"The file has no column {channel.name!r}, a channel of the trained sensor; it has {have}.",
                place=table.path, cause="The channel was not recorded, or its header has changed.",
                fix=fix,
            )  # fmt: skip


def _rows(table: Table, selection: Selection, where: Sequence[str]) -> tuple[np.ndarray, list[str]]:
    """Those of the conditions; of the training's only those whose columns are there."""
    notes, used = [], np.ones(len(table.line), bool)
    for condition in where or selection.where:
        if not where and condition.partition("=")[0].strip() not in table.columns:
            notes.append(f"no column for {condition!r}: every row is used.")
            continue
        used &= fulfilling(table, [condition])
    if not used.any():
        raise InputError("no-rows", f"No row has {' and '.join(where)}.", place=table.path)
    return np.flatnonzero(used), notes


def _streams(
    table: Table, selection: Selection, rows: np.ndarray, time: np.ndarray | None
) -> list[np.ndarray]:
    """Rows of each sequence, in the order of their first rows."""
    names = [name for name in selection.group if name in table.columns]
    parts = np.array([table.text[name][rows] for name in names] or [np.full(len(rows), "")])
    _, first, member = np.unique(parts, axis=1, return_index=True, return_inverse=True)
    streams = [np.flatnonzero(member.ravel() == k) for k in np.argsort(first)]
    if selection.segments != "auto" or time is None:
        return streams
    cuts = [np.flatnonzero(np.diff(time[stream]) < 0) + 1 for stream in streams]
    return [part for stream, at in zip(streams, cuts, strict=True) for part in np.split(stream, at)]


def _truths(
    table: Table, targets: Targets, sensor: SoftSensor, rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    none = np.full(len(rows), np.nan)
    units = [one.unit for one in (sensor.force_in, *sensor.position_in)]
    force, *position = (
        in_unit(table, str(name), unit)[rows] if name in table.columns else none
        for name, unit in zip((targets.force, *targets.position), units, strict=True)
    )
    position = np.array(position).reshape(len(position), len(rows)).T
    return force, places_of(table, targets.place, rows), position


def _faults(sensor: SoftSensor, found: Estimates) -> dict[str, dict[str, int]]:
    """Of each channel, how many rows have which fault."""
    said = Counter(word for words in found["channels"].tolist() for word in words.split(", "))
    counts = {
        name: {s.name: n for s in ChannelStatus if (n := said[f"{name}: {s.name}"])}
        for name, _ in sensor.channels
    }
    return {name: faults for name, faults in counts.items() if faults}


def _swapped(
    sensor: SoftSensor, found: Estimates, readings: np.ndarray, place: np.ndarray
) -> list[str]:
    """Whether presses at known places are likelier with the channels in another order."""
    localizer, count = sensor.localizer, len(sensor.channels)
    if localizer is None or not 2 <= count <= MOST_ORDERS:
        return []
    known = np.isin(place, [*map(str, localizer.names)]) & np.isfinite(readings).all(axis=1)
    odd = int((found["place"] != place)[known].sum())
    if odd < max(3, MANY * known.sum()):
        return []
    zero, scale = np.asarray(sensor.readout.zero), np.asarray(sensor.readout.scale)
    order = localizer.channel_order((readings[known] - zero) / scale, place[known])
    if order == tuple(range(count)):
        return []
    swapped = ", ".join(sensor.channels[k].name for k in order)
    return [
        f"presses are unlike those learnt in {odd} of {known.sum()} rows, and likelier with the channels in"
        f" the order {swapped}: wires swapped?"
    ]


def _write(
    target: Path, sensor: SoftSensor, found: Estimates, line: np.ndarray, time: np.ndarray | None
) -> None:
    columns: dict[str, Iterable[Any]] = {"line": line.tolist()}
    if time is not None:
        columns["time"] = [_digits(t, 12) for t in time]
    for name, column in found.items():
        several = name == "position"
        names = [one.name for one in sensor.position_in] if several else [name]
        columns |= zip(names, column.T if several else [column], strict=True)
    rows = zip(*columns.values(), strict=True)
    shown = ([_digits(x) if isinstance(x, float) else x for x in row] for row in rows)
    write_table(target, columns, shown)


def _digits(x: float, count: int = 6) -> str:
    return f"{x:.{count}g}" if np.isfinite(x) else ""
