"""Measured soft sensors: force from readings, learnt from some presses and judged on others.

What is learnt and what it is judged on are as in `benchmarks.accuracy`. All settings but one are the
package's own: eGaIn presses come in five speeds, and what is held out inside the training is a speed.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from compensate.microchannel import Localizer
from hysid.soft_sensor._force_records import ForceRecord
from hysid.soft_sensor._force_training import ForceTraining, train_force
from hysteresis import read_table

from .._measure import Row, judged, noted
from ..accuracy import data_folder

EGAIN = "egain-microfluidic-pressure/tidy.csv"
EFLESH = "eflesh-magnetic-tactile/tidy_normal.csv"
VELOSTAT = "velostat-press-hold/tidy.csv"
EGAIN_DT, VELOSTAT_EVERY, VELOSTAT_LEARNT = 0.05, 5, 0.6
CHANNELS = tuple(f"s{k:02d}" for k in range(15))
QUICK = "few updates: without --quick"


class Press(NamedTuple):
    """A record, the place it was pressed at, how fast, and whether it is to be judged on."""

    record: ForceRecord
    place: str
    speed: str
    judged: bool


def learnt_rows(quick: bool) -> list[Row]:
    """Forces of the three sensors, and the place of a press on eGaIn."""
    rows = []
    for part in (_egain_rows, _eflesh_rows, _velostat_rows):
        rows += part(data_folder(), quick)
    return rows


def _size(quick: bool, updates: int) -> dict[str, Any]:
    return {"updates": 600, "members": 2, "skip": 0.0} if quick else {"updates": updates}


def _judged(what: str, value: float, bar: float, quick: bool) -> Row:
    """A quick training that is good enough is good enough; one that is not says nothing."""
    if quick and not value <= bar:
        return Row(what, value, bar, reason=QUICK)
    return judged(what, value, bar)


def _missing(what: str, bar: float | None = None) -> Row:
    return Row(what, float("nan"), bar, reason="the data are not here")


def _error(training: ForceTraining, records: Sequence[ForceRecord]) -> tuple[float, float]:
    """RMSE in per cent of the range of the records' forces, and the part of rows in 90 % bands."""
    length, off, forces = max(len(one.time) for one in records), [], []
    for t, y, F in records:
        # Repeated at the end, so that one length is compiled.
        more = length - len(t)
        padded = np.pad(y, ((0, more), *((0, 0),) * (y.ndim - 1)), mode="edge")
        found = training.estimator.simulate(np.pad(t, (0, more), mode="edge"), padded)
        known = np.isfinite(F)
        off.append((np.asarray(found.value)[: len(F)] - F)[known])
        forces.append(F[known])
    errors, spread = np.concatenate(off), np.ptp(np.concatenate(forces))
    held = np.abs(errors) < 1.645 * float(training.estimator.deviation)
    return 100 * float(np.sqrt(np.mean(errors**2)) / spread), 100 * float(held.mean())


def _columns(file: Path, *names: str) -> list[np.ndarray]:
    table = read_table(file)

    def number(cell: str) -> float:
        return float(cell) if cell else np.nan

    return [np.array([number(cell) for cell in table.text[name]]) for name in names]


# eGaIn: presses of many depths and speeds on two places


def _egain_rows(folder: Path, quick: bool) -> list[Row]:
    network = "eGaIn, voltage -> force, networks, NRMSE, %"
    structured = "eGaIn, voltage -> force, fitted model as readings come, NRMSE, %"
    if not (folder / EGAIN).exists():
        return [_missing(network, 2.5), _missing(structured, 3.0), _missing("eGaIn, place")]
    presses = _egain(folder / EGAIN)
    found = [_egain_place(presses, place, "network", quick) for place in _places(presses)]
    error, held = np.mean(found, axis=0)
    rows = [
        _judged(network, float(error), 2.5, quick),
        noted("    of test readings within 90 % bands, %", float(held)),
    ]
    if quick:
        rows.append(Row(structured, float("nan"), 3.0, reason="minutes: without --quick"))
    else:
        found = [_egain_place(presses, place, "structured", quick) for place in _places(presses)]
        rows.append(judged(structured, float(np.mean(found, axis=0)[0]), 3.0))
    return [*rows, _egain_located(presses)]


def _egain(file: Path) -> list[Press]:
    table = read_table(file)
    columns = ("split", "x_location", "trial", "speed")
    labels = list(zip(*(table.text[name].tolist() for name in columns), strict=True))
    y, F = _columns(file, "voltage", "force_pos")
    rows: dict[Any, list[int]] = {}
    for k, label in enumerate(labels):
        rows.setdefault(label, []).append(k)
    return [
        Press(ForceRecord(EGAIN_DT * np.arange(len(at)), y[at], F[at]), place, speed, split == "test")
        for (split, place, _, speed), at in rows.items()
    ]  # fmt: skip


def _places(presses: Sequence[Press]) -> list[str]:
    return list(dict.fromkeys(press.place for press in presses))


def _egain_place(
    presses: Sequence[Press], place: str, kind: str, quick: bool
) -> tuple[float, float]:
    own = [press for press in presses if press.place == place]
    taught = [press for press in own if not press.judged]
    training = train_force(
        [press.record for press in taught], kind=kind, groups=[press.speed for press in taught],
        **_size(quick, 10_000),
    )  # fmt: skip
    return _error(training, [press.record for press in own if press.judged])


def _egain_located(presses: Sequence[Press]) -> Row:
    """Both places share one voltage: only the shape of a press over time could tell them apart."""
    rest = float(np.median([press.record.reading[0] for press in presses if not press.judged]))
    features = np.array([_shape(press.record, rest) for press in presses])
    judged_on = np.array([press.judged for press in presses])
    places = np.array([press.place for press in presses])
    localizer = Localizer.train(
        features[~judged_on], places[~judged_on], method="neighbours", neighbours=15, reject=0.0
    )
    counts = localizer.confusion(features[judged_on], places[judged_on]).counts
    what = "eGaIn, which of two places a press was on, %"
    reason = "no bar: both share one voltage, and at other depths its shape tells no place"
    return noted(what, 100 * float(np.trace(counts) / counts.sum()), reason=reason)


def _shape(record: ForceRecord, rest: float) -> list[float]:
    """Above rest: the peak, the mean, seconds above half the peak, steepest rise and fall; all positive."""
    away = np.maximum(record.reading - rest, 1e-6)
    rate = np.diff(away, prepend=1e-6) / EGAIN_DT
    seconds = EGAIN_DT * (away > 0.5 * away.max()).sum()
    return [away.max(), away.mean(), seconds, max(rate.max(), 1e-6), max(-rate.min(), 1e-6)]


# eFlesh: one run learnt, the other judged


def _eflesh_rows(folder: Path, quick: bool) -> list[Row]:
    bars = {"main channel": 1.3, "all 15 channels": 0.9}
    what = "eFlesh, {} -> load, another run, NRMSE, %"
    if not (folder / EFLESH).exists():
        return [_missing(what.format(name), bar) for name, bar in bars.items()]
    table = read_table(folder / EFLESH)
    runs, main = table.text["run"], CHANNELS.index(table.text["main_channel"][0])
    t, load, *signals = _columns(folder / EFLESH, "time_s", "load_reading", *CHANNELS)
    readings = np.column_stack(signals)
    rows = []
    for name, bar in bars.items():
        y = readings[:, main] if name == "main channel" else readings
        learnt, other = (
            ForceRecord(*(a[runs == run] for a in (t, y, load))) for run in dict.fromkeys(runs)
        )
        training = train_force([learnt], nan="omit", **_size(quick, 20_000))
        error, held = _error(training, [other])
        rows += [
            _judged(what.format(name), error, bar, quick),
            noted("    of its readings within 90 % bands, %", held),
            noted("    presses of the learnt run held out, NRMSE, %", training.nrmse_percent),
        ]
    return rows


# Velostat: press, hold, release; the first part of three runs learnt, the last judged


def _velostat_rows(folder: Path, quick: bool) -> list[Row]:
    what = "Velostat, force under creep, later holds, NRMSE, %"
    if not (folder / VELOSTAT).exists():
        return [_missing(what)]
    runs = read_table(folder / VELOSTAT).text["run"]
    columns = _columns(folder / VELOSTAT, "time_s", "velostat_raw", "force_N_interp")
    records = [
        ForceRecord(*(a[runs == run][::VELOSTAT_EVERY] for a in columns))
        for run in dict.fromkeys(runs)
    ]
    learnt, later = [], []
    for record in records:
        end = int(VELOSTAT_LEARNT * len(record.time))
        learnt.append(ForceRecord(*(part[:end] for part in record)))
        # What came before still drives the memory, and is not judged.
        later.append(
            record._replace(force=np.where(np.arange(len(record.time)) < end, np.nan, record.force))
        )
    training = train_force(learnt, **_size(quick, 10_000))
    error, held = _error(training, later)
    return [noted(what, error), noted("    of its readings within 90 % bands, %", held)]
