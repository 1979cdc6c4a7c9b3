"""Self-recalibration on measured runs, against the same compensator left as it was fitted.

python -m benchmarks._deployment.measured_drift [--quick] [--json]

A model is fitted to the first half of a long run, or to one run of two, and its compensator runs over the
rest. In two of twenty cycles the input is given as a reference; in runs of less than twenty, in the first
cycle and the middle one. Errors are those of the cycles without a reference.
"""

import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from compensate import adaptive, invert
from hysid.intake._selection import Selection
from hysteresis import Record
from identify import fit

from .. import _measured_data as data
from .._measure import Row, judged, noted, options, report
from ..accuracy import FOAM, data_folder

BLOCK = "foam-instron-cyclic/tidy.csv"
PIEZO = "piezo-manipulator/tidy.csv"
LAMINATE = "gfrp-fatigue-loops/tidy.csv"


class Rig(NamedTuple):
    """What is estimated from what, and how often a row is taken."""

    what: str
    file: str | Callable[[Path, Path], Path]
    selection: Selection
    every: int = 1
    runs: bool = False


RIGS = (
    Rig("foam, force -> compression", FOAM,
        Selection("compression_mm", "force_N", "time_s", each="sample")),
    Rig("block, force -> compression", BLOCK, Selection("displacement (mm)", "force (N)", "time (s)"), 4),
    Rig("laminate, displacement -> force", LAMINATE,
        Selection("force (kN)", "displacement (mm)", dt=1.0, each="specimen")),
    Rig("piezo, position -> command", PIEZO, Selection("command (V)", "position (um)", "time (s)"), 2),
    Rig("eFlesh, main channel -> load, next run", data.eflesh_loads,
        Selection("load", "main", "time (s)", group=("run",)), runs=True),
)  # fmt: skip


def measured_drift_rows(quick: bool) -> list[Row]:
    """Of each rig: the rms error with references over that without, as a mean over its specimens."""
    rows = []
    for rig in RIGS:
        what = f"{rig.what}: rms error self-recalibrated over frozen"
        if quick and rig.what.split(",")[0] not in ("block", "piezo"):
            rows.append(noted(what, np.nan, reason="left to the full run: fits take minutes"))
            continue
        with tempfile.TemporaryDirectory() as out:
            place = data_folder() / rig.file if isinstance(rig.file, str) else data_folder()
            if not place.exists():
                rows.append(noted(what, np.nan, reason="the data are not here"))
                continue
            found = list(_errors(rig, place, Path(out)))
        ratio = float(np.sqrt(np.mean([(a / f) ** 2 for _, f, a, _ in found])))
        rows.append(judged(what, ratio, 1.0))
        for name, frozen, own, unit in found:
            said = f"    {name}: rms frozen {frozen:.3g} {unit}, self-recalibrated"
            rows.append(noted(said, own))
    return rows


def _errors(rig: Rig, place: Path, out: Path) -> Iterator[tuple[str, float, float, str]]:
    file = place if isinstance(rig.file, str) else rig.file(place, out)
    records, _ = rig.selection.records(rig.selection.read(file))
    for name, (record, _) in records.items():
        frozen, own = _of_one(record, rig)
        yield name or record.input_name, frozen, own, record.input_unit


def _of_one(record: Record, rig: Rig) -> tuple[float, float]:
    if rig.runs:
        first, second = (record.take_sequences([label]) for label in record.labels)
        fitted, stream, later = fit(first), second, np.ones(len(second), bool)
    else:
        cut = record.cycle <= record.n_cycles // 2
        rows = np.arange(len(record)) % rig.every == 0
        fitted = fit(_thinned(record, rows & cut))
        stream = _thinned(record, rows)
        later = stream.cycle > record.n_cycles // 2
    number = stream.cycle - stream.cycle[later].min()
    count = int(number.max()) + 1
    period = 10 if count >= 20 else max(count // 2, 2)
    known = later & (number % period == 0)
    references = np.where(known, stream.input, np.nan)
    frozen = np.asarray(invert(fitted.model).simulate(stream.time, stream.output).value)
    own = adaptive(fitted.model, fitted.train)
    found = np.asarray(own.follow(stream.time, stream.output, references)[1].value)
    counted = later & ~known & np.isfinite(frozen)
    return _rms(frozen, stream, counted), _rms(found, stream, counted)


def _thinned(record: Record, rows: np.ndarray) -> Record:
    time = None if record.time is None else record.time[rows]
    return Record.from_arrays(record.input[rows], record.output[rows], time)


def _rms(value: np.ndarray, record: Record, rows: np.ndarray) -> float:
    return float(np.sqrt(np.mean((value - record.input)[rows] ** 2)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit every rig and print the table."""
    chosen = options("benchmarks._deployment.measured_drift", __doc__, arguments)
    jax.config.update("jax_enable_x64", True)
    report(measured_drift_rows(chosen.quick), chosen.json)


if __name__ == "__main__":
    main(sys.argv[1:])
