"""What a fit says of the specimen: stiffness, loop width, energy, relaxation time, softening, zero drift.

The parts of a composition and the weights of a grid are not separable, so that their numbers mean little
one by one. What the model does over the motion that it was trained on is determined, and can be laid beside
the measured loops.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Float

from hysteresis import Record
from hysteresis._format import ends, number_of
from hysteresis.records._loop_table import LoopTable, loop_table

from .._levels import FEWEST, HELD, LITTLE, SURE

ALIKE = 0.5
"""Of the largest change in a hold: holds that change by so much are compared."""

Rows = Float[np.ndarray, " rows"]


class Characteristic(NamedTuple):
    """A figure of the specimen, from the model's output over the fitted rows.

    - `value`: None where the record does not tell it; `reason` then says why.
    - `error`: how far the model's figure is from the measured one, rms over the same cycles or holds; of a
      change rms over all pairs of cycles.
    - `basis`: which cycles or holds; "" without a value.
    """

    name: str
    value: float | None
    error: float | None
    unit: str
    basis: str = ""
    reason: str = ""

    @property
    def cells(self) -> tuple[str, ...]:
        """Name, value with error, unit and basis of one that has a value."""
        error = "" if self.error is None else f" +- {self.error:.2g}"
        unit = "" if self.unit == "1" else self.unit
        return f"  {self.name}", f"{self.value:.4g}{error}", unit, self.basis


TOLD = (
    "stiffness", "slope", "loop width", "energy lost", "loop area", "damping ratio", "coercive field",
    "bias field", "remanence", "saturation", "squareness", "loss a cycle and volume", "loss a cycle",
)  # fmt: skip
"""Figures of the table of loops that are told of a specimen."""


def fitted_loops(
    record: Record, residuals: Float[np.ndarray, " samples"], used: Bool[np.ndarray, " samples"]
) -> LoopTable:
    """The loops of a record's `used` rows, and beside them those of a model that leaves these residuals."""
    counted = used & np.isfinite(residuals) & np.isfinite(record.output)
    return loop_table(replace(record, mask=counted), model=record.output + residuals)


def characteristics(
    record: Record, residuals: Float[np.ndarray, " samples"], used: Bool[np.ndarray, " samples"]
) -> tuple[Characteristic, ...]:
    """The figures of a record and of a model that leaves these residuals on its `used` rows.

    They are those of the table of loops, over the full ones, and of the holds:

    - stiffness: of the line through the middle of the loop, load over deformation where the units tell
      them apart; otherwise the slope, output over input.
    - loop width: mean distance of the branches. energy lost: the loop's area. damping ratio, and of fields
      coercive field, remanence, saturation, squareness and loss.
    - softening: change of the stiffness from the first of these cycles to the last.
    - zero drift: change of the output at the cycle's lowest input, likewise.
    - relaxation time: mean time of the change in holds, int (y - y_end) dt / (y_start - y_end).
    """
    table = fitted_loops(record, residuals, used)
    assert table.model is not None
    full = np.flatnonzero(table.full)
    run = full[table.run[full] == table.run[full[-1]]] if len(full) else full
    why: str = "no complete cycle counts" if not len(full) else ""
    basis = number_of(len(full), "cycle")
    if len(full):
        least, most = (table[f"{k} input"].value[full].mean() for k in ("lowest", "highest"))
        basis += f" from {ends(least, most, record.input_unit, 3)}"
        for name, unit in record.conditions.items():
            counted = record.columns[name][used]
            basis += f", at {ends(counted.min(), counted.max(), unit, 3)}"
    found = []
    for name in (name for name in TOLD if name in table.names):
        reason = why or str(table[name].reason[full[0]])
        found.append(_mean(name, _pairs(table, name)[full], table[name].unit, basis, reason))
    if table.kind in ("mechanical", "plain"):
        if not why and len(run) < 2:
            why = "one complete cycle in a row"
        why = why or str(max(table["softening"].reason[run[1:]]))
        basis = f"from the first to the last of {number_of(len(run), 'cycle')}"
        stiff = _pairs(table, found[0].name)[run]
        softer = -100 * stiff / stiff[:1, :1]
        feet = _pairs(table, "output at lowest input")[run]
        found += [
            _change("softening", softer, "percent", basis, why),
            _change("zero drift", feet, record.output_unit, basis, why),
        ]
    counted = used & np.isfinite(residuals) & np.isfinite(record.output)
    outputs = np.stack([record.output + residuals, record.output])
    return (*found, _relaxation(record, outputs, counted))


def _pairs(table: LoopTable, name: str) -> Float[np.ndarray, "cycles 2"]:
    """A figure of the model and of the readings."""
    assert table.model is not None
    return np.column_stack([table.model[name].value, table[name].value])


def _relaxation(
    record: Record, outputs: Float[np.ndarray, "2 samples"], counted: Bool[np.ndarray, " samples"]
) -> Characteristic:
    def none(why: str) -> Characteristic:
        return Characteristic("relaxation time", None, None, record.time_unit, "", why)

    if record.time is None:
        return none("the record has no clock")
    held = (rows[counted[rows]] for rows in holds_of(record))
    holds = [rows for rows in held if len(rows) >= FEWEST]
    if not holds:
        return none("the input is never held")
    ends = [_ends(record.time[rows], outputs[:, rows]) for rows in holds]
    changes = np.array([start - end for start, end in ends])
    size = np.abs(changes[:, 0])
    alike = np.flatnonzero(size >= ALIKE * size.max())
    # What the model misses the change by, and what chance would have it miss.
    wrong = np.sqrt(np.mean((changes[alike, 0] - changes[alike, 1]) ** 2))
    if not size.max() > SURE * wrong:
        return none("no hold shows a change that the model meets")
    times = []
    for k in alike:
        t, y, (start, end) = record.time[holds[k]], outputs[:, holds[k]], ends[k]
        with np.errstate(divide="ignore", invalid="ignore"):
            times.append(np.trapezoid(y - end[:, None], t, axis=1) / (start - end))
    longest = max(float(np.ptp(record.time[holds[k]])) for k in alike)
    basis = f"{number_of(len(alike), 'hold')} of up to {longest:.3g} {record.time_unit}"
    return _mean("relaxation time", np.array(times), record.time_unit, basis, "")


def holds_of(record: Record) -> list[np.ndarray]:
    """Rows of each stretch in which the input stays where it is: a smooth turn is slow, but moves on."""
    assert record.time is not None
    found, t = [], record.time
    span = float(np.ptp(record.input[record.mask])) if record.mask.any() else 0.0
    for _, where in record.sequences():
        u = record.input[where]
        if len(u) < FEWEST:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(u, FEWEST)
        moves, steps = np.abs(np.diff(u)), np.diff(t[where])
        # Along its path, so that rests do not slow it down.
        pace = float(np.sum(moves**2 / steps) / moves.sum()) if moves.any() else 0.0
        still = np.flatnonzero(np.ptp(windows, axis=1) <= HELD * span)
        for run in np.split(still, np.flatnonzero(np.diff(still) > 1) + 1):
            if not len(run):
                continue
            rows = np.arange(run[0], run[-1] + FEWEST)
            # Where it arrives and leaves it still moves: from the first row at the level to the last.
            away = np.abs(u[rows] - np.median(u[rows]))
            scatter = np.median(away) / scipy.special.ndtri(0.75)
            at = np.flatnonzero(away <= max(SURE * scatter, LITTLE * span))
            rows = rows[at[0] : at[-1] + 1]
            moved = np.ptp(u[rows])
            # Of the way that it goes in the time of a hold where it moves: more is a slow turn.
            if moved <= HELD * span and moved <= HELD * pace * np.ptp(t[where][rows]):
                found.append(where.start + rows)
    return found


def _ends(
    t: Float[np.ndarray, " rows"], y: Float[np.ndarray, "2 rows"]
) -> tuple[np.ndarray, np.ndarray]:
    """Output at the beginning and at the end of a hold: a tenth of its rows, in a tenth of its time."""
    last = max(1, len(t) // 10)
    late = t[-last:] >= t[-1] - np.ptp(t) / 10
    return y[:, 0], y[:, -last:][:, late].mean(1)


def _mean(
    name: str, values: Float[np.ndarray, "cases 2"], unit: str, basis: str, why: str
) -> Characteristic:
    """The model's mean, and how far it is from the readings' figure."""
    values = values[np.isfinite(values).all(1)]
    if not len(values):
        return Characteristic(name, None, None, unit, "", why or "not a finite number")
    error = float(np.sqrt(np.mean((values[:, 0] - values[:, 1]) ** 2)))
    return Characteristic(name, float(values[:, 0].mean()), error, unit, basis)


def _change(
    name: str, values: Float[np.ndarray, "cases 2"], unit: str, basis: str, why: str
) -> Characteristic:
    """The model's change from the first to the last, and by how much it differs from the readings'.

    Not between these two alone, which may agree by chance, but rms between any two.
    """
    if why or not np.isfinite(values).all():
        return Characteristic(name, None, None, unit, "", why or "not a finite number")
    error = float(np.sqrt(2) * np.std(values[:, 0] - values[:, 1], ddof=1))
    return Characteristic(name, float(values[-1, 0] - values[0, 0]), error, unit, basis)
