"""Hysteresis removed on measured data: the loop's width after an estimator over that before it.

python -m benchmarks._compensation.removed [--quick] [--json]

Each specimen is fitted on its training part, from its reading to what is to be estimated: the model itself
is the estimator. Without --quick also the other way round, run backwards by its compensator.
"""

import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from compensate import estimate, invert
from compensate._qualification import loop_widths
from hysid.intake._selection import Selection
from hysteresis import InputError, Record
from identify import FitResult, fit

from .. import _measured_data as data
from .._measure import Row, judged, noted, options, report
from ..accuracy import EFLESH_TEST, EGAIN, EGAIN_SPLIT, FOAM, data_folder

BAR = 0.25


class Sensor(NamedTuple):
    """A reading and what is to be estimated from it; `one` of its specimens stands for all when quick."""

    what: str
    file: str | Callable[[Path, Path], Path]
    selection: Selection
    one: str = ""


SENSORS = (
    Sensor(
        "foam, force -> compression", FOAM,
        Selection("force_N", "compression_mm", "time_s", each="sample", test_cycles=3),
        "leap-comp-3",
    ),
    Sensor(
        "eGaIn, voltage -> force", EGAIN,
        Selection("voltage", "force_pos", **EGAIN_SPLIT, test_where=("split=test",)),
        "0",
    ),
    Sensor(
        "eFlesh, main channel -> load", data.eflesh_loads,
        Selection("main", "load", "time (s)", group=("run",), test_where=EFLESH_TEST),
    ),
)  # fmt: skip


def removed_rows(quick: bool) -> list[Row]:
    """Of each sensor: the mean over its specimens, held-out cycles alone, against the bar.

    A cycle is one of what is estimated. Where a whole run is held out its first cycle has no like in the
    fit, which leaves conditioning out: without it there is a row for the record.
    """
    found = []
    for sensor in SENSORS:
        with tempfile.TemporaryDirectory() as out:
            found += _of_one(sensor, data_folder(), Path(out), quick)
    return found


def _of_one(sensor: Sensor, folder: Path, out: Path, quick: bool) -> list[Row]:
    place = folder / sensor.file if isinstance(sensor.file, str) else folder
    if not place.exists():
        return [noted(sensor.what, float("nan"), reason="the data are not here")]
    file = place if isinstance(sensor.file, str) else sensor.file(folder, out)
    table = sensor.selection.read(file)
    records, _ = sensor.selection.records(table)
    if quick and sensor.one:
        records = {sensor.one: records[sensor.one]}
    model = "Composition" if quick else "auto"
    ratios, later, backwards, names = [], [], [], []
    for train, test in records.values():
        assert test is not None
        fitted = fit(train, model, test=test)
        names.append(fitted.name)
        truth, predicted = _turned(test), fitted.predict(test)
        ratios.append(loop_widths(truth, predicted).ratio)
        conditioned = replace(truth, mask=truth.mask & (truth.cycle > 1))
        later.append(loop_widths(conditioned, predicted).ratio)
        if not quick:
            backwards.append(_backwards(_turned(train), truth, model))
    who = f"{len(records)} specimens" if len(records) > 1 else "one specimen"
    said = f"{sensor.what}, width left ({who}; {', '.join(dict.fromkeys(names))})"
    found = [judged(said, float(np.mean(ratios)), BAR)]
    if later != ratios and np.isfinite(later).all():
        found.append(noted(f"{sensor.what}, after the first cycle", float(np.mean(later))))
    if backwards:
        what = f"{sensor.what}, fitted the other way round and inverted"
        found.append(noted(what, float(np.mean(backwards))))
    return found


def _turned(record: Record) -> Record:
    """Input and output exchanged: what is estimated drives, the reading answers."""
    return replace(
        record, input=record.output, output=record.input,
        input_name=record.output_name, output_name=record.input_name,
        input_unit=record.output_unit, output_unit=record.input_unit,
    )  # fmt: skip


def _backwards(train: Record, test: Record, model: str) -> float:
    try:
        fitted: FitResult = fit(train, model, test=test)
        compensator = invert(fitted.model)
    except InputError:
        return float("nan")
    found = np.asarray(estimate(compensator, test).value)
    return loop_widths(test, fitted.clocks.undone(test, found)).ratio


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit every sensor and print the table."""
    chosen = options("benchmarks._compensation.removed", __doc__, arguments)
    jax.config.update("jax_enable_x64", True)
    report(removed_rows(chosen.quick), chosen.json)


if __name__ == "__main__":
    main(sys.argv[1:])
