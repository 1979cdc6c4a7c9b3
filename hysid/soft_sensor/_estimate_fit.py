"""`hysid microchannel estimate` of a plain fit: forces from readings by its model, or by its inverse."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

import identify
from compensate import Quantity, Status, estimate, invert
from compensate.microchannel import export_force
from compensate.microchannel._force import BackwardsModel, ForceEstimator
from compensate.uncertainty._calibrated import CalibratedCompensator
from hysteresis import InputError, Record
from hysteresis._atomic_file import write_table
from hysteresis._quantities import conversion
from hysteresis.models._conditioned import with_condition
from identify.internal import metrics
from identify.results._metrics import Metrics

from .._invert import error_of, longest_sequence
from .._invert import invert as invert_fit
from ..intake._columns import for_new_file, selection_of_fit
from ..intake._folders import folders_of

NEWTON = "N"


def estimate_by_fit(
    folder: Path, file: Path, target: Path | None = None, runtime: Path | None = None, *,
    where: tuple[str, ...] = (), na_values: tuple[str, ...] = (),
) -> dict[str, Any]:  # fmt: skip
    """Run a fit over a file as a force sensor: forces in N, with deviations and statuses, to a table.

    A fit from force to reading is inverted, with the deviation of `hysid.invert`; of a fit from reading to
    force it is that of the rows that the fit held out. The forces are limited to those of its training; a
    lag between reading and force is taken out as in the fit. `runtime`: a file for
    `compensate.runtime.load_force`, which estimates at once and knows no lag.

    Raises `InputError` where neither quantity of the fit is a force, it has no inverse, or the file lacks
    its columns.
    """
    document = identify.internal.read_document(folder)
    asked = selection_of_fit(document)
    if list(folders_of(folder, document)) != [""]:
        raise InputError(
            "several-fits", "This folder has several fits.", place=str(folder),
            fix="Name the folder of one of them.",
        )  # fmt: skip
    fitted = identify.load(folder)
    inverse = _is_inverse(fitted, folder)
    selection = replace(asked, na_values=(*asked.na_values, *na_values)).without_hold_out()
    if where:
        selection = replace(selection, where=where)
    source = selection.read(file)
    selection, compared, said = for_new_file(selection, source, inverse)
    record = selection.records(source)[0][""][0]
    held_out = fitted.train if fitted.test is None else fitted.test
    own = "The fit held out no rows, so the deviation is that of its own: too small for new ones."
    said += [own] if fitted.test is None and not inverse else []
    newtons = conversion(fitted.train.input_unit if inverse else fitted.train.output_unit, NEWTON)
    assert newtons is not None
    value, deviation, status = _found(fitted, record, inverse)
    if inverse:
        coverage = error_of(fitted).coverage
        held = f"{100 * coverage:.3g} % of the rows that the fit held out"
        said.append(f"The 90 % band holds {held if np.isfinite(coverage) else 'an unknown share'}.")
    wanted = record.input if inverse else record.output
    figures: dict[str, Any] = dict.fromkeys(Metrics._fields)
    known = record.mask & np.isfinite(wanted) & np.isfinite(value)
    if compared and known.any():
        figures = metrics(newtons * wanted[known], newtons * value[known])._asdict()
    target = target or folder / f"estimated-{file.stem}.csv"
    words = [Status(int(s)).name for s in status]
    time = [""] * len(record) if record.time is None else record.time.tolist()
    rows = zip(record.line, time, newtons * value, newtons * deviation, words, strict=True)
    write_table(target, ("line", "time", "force", "force_sd", "force_status"), rows)
    done = {}
    if runtime is not None:
        done = {"runtime": str(_exported(fitted, held_out, inverse, runtime))}
        lag = f"The lag of {fitted.clocks.lag:.3g} {record.time_unit} is not in {runtime.name}."
        said += [lag] if fitted.clocks.lag else []
    return {
        **figures, "flagged": sum(word != "OK" for word in words), "rows": len(record),
        "statuses": {"force_status": {word: words.count(word) for word in dict.fromkeys(words)}},
        "channels_at_fault": {}, "notes": said, "file": str(target), **done,
    }  # fmt: skip


def _is_inverse(fitted: identify.FitResult, folder: Path) -> bool:
    """Whether the force is the fit's input."""
    record = fitted.train
    if conversion(record.output_unit, NEWTON) is not None:
        return False
    if conversion(record.input_unit, NEWTON) is not None and fitted.channels is None:
        return True
    raise InputError(
        "wrong-unit",
        f"This fit leads from {record.input_unit} to {record.output_unit}: neither is a force.",
        place=str(folder),
        fix="fit a record whose force has a unit (--input-unit, --output-unit).",
    )


def _found(
    fitted: identify.FitResult, record: Record, inverse: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forces, deviations and statuses of every row, in the fit's unit and on the record's clock."""
    if inverse:
        unit = fitted.train.output_unit
        identify.internal.check_unit(record.output_name, record.output_unit, unit)
        band = invert_fit(fitted)
        assert isinstance(band, CalibratedCompensator)
        found = estimate(band, record)
        value = fitted.clocks.undone(record, np.asarray(found.value))
        return value, np.asarray(found.deviation), np.asarray(found.status)
    figures = fitted.metrics["test"] or fitted.metrics["train"]
    assert figures is not None
    used = fitted.train.output[fitted.train.mask]
    free = fitted.predict(record)
    value = np.clip(free, min(0.0, used.min()), used.max())
    status = np.where(fitted.beyond(record), int(Status.EXTRAPOLATED), int(Status.OK))
    status = np.where(free > used.max(), int(Status.SATURATED), status)
    return value, np.full(len(value), figures.rmse), status


def _exported(fitted: identify.FitResult, held_out: Record, inverse: bool, file: Path) -> Path:
    """The estimator without JAX."""
    record = fitted.train
    model: Any = BackwardsModel(invert(fitted.model)) if inverse else fitted.model
    readings, forces = (record.output, record.input) if inverse else (record.input, record.output)
    newtons = conversion(record.input_unit if inverse else record.output_unit, NEWTON) or 1.0
    value = _found(fitted, held_out, inverse)[0]
    known = held_out.mask & np.isfinite(value)
    truth = (held_out.input if inverse else held_out.output)[known]
    off = newtons * float(np.sqrt(np.mean((value[known] - truth) ** 2)))
    used = record.mask & np.isfinite(readings)
    rows = longest_sequence(record, used)
    estimator = ForceEstimator(
        model, jnp.asarray(off), newtons * float(forces[used].max()),
        float(readings[used].min()), float(readings[used].max()),
    )  # fmt: skip
    name, unit = (
        (record.output_name, record.output_unit) if inverse
        else (record.input_name, record.input_unit)
    )  # fmt: skip
    return export_force(
        estimator, file, with_condition(fitted.model, record, readings)[rows],
        times=None if record.time is None else record.time[rows],
        channels=(Quantity(name, unit),), title=fitted.name,
    )  # fmt: skip
