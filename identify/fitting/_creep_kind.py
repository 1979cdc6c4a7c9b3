"""Creep or relaxation: what is held, by the units of input and output."""

import numpy as np
from jaxtyping import Bool

from hysteresis import InputError, Note, Record
from hysteresis.records._loads import kind_of_units

from .._levels import SURE
from ..spectra._of_record import is_moduli, is_survey
from ..spectra._prony_series import Kind


def kind_of(record: Record) -> Kind:
    """Creep or relaxation, by `kind_of_units`, else by whether the output goes on as the step did.

    Raises `InputError` where the output is on the other side of zero, does not move, or moves in the
    direction in which what is held cannot drive it.
    """
    if is_moduli(record):
        return "relaxation"
    rows = counted(record)
    y = record.output[rows] / record.input[rows]
    if is_survey(record):
        return kind_of_units(record) or ("creep" if _grows(record, rows) else "relaxation")
    if len(y) < 8:
        raise InputError(
            "too-few-rows",
            f"{len(y)} rows count: a spectrum needs at least 8.",
            place=record.source,
        )
    if np.median(y) <= 0:
        raise InputError(
            "not-a-step",
            f"{record.output_name} is on the other side of 0 than the step.",
            place=record.source,
            cause="the sign convention of one of them.",
            fix="turn the step's sign (--step VALUE).",
        )
    tenth = -(-len(y) // 10)
    change = float(np.median(y[-tenth:]) - np.median(y[:tenth]))
    noise = record.summary()["output"]["noise"] / abs(record.input[-1])
    if abs(change) <= SURE * noise:
        raise InputError(
            "no-excitation",
            f"{record.output_name} ends {abs(change * record.input[-1]):.3g} from where it began, about its"
            " noise: neither creep nor relaxation.",
            place=record.source,
            cause="the input was not held but its sensor is dead, or the test is too short.",
            fix="choose another column (--output COL), or measure for longer.",
        )
    moved: Kind = "creep" if change > 0 else "relaxation"
    told = kind_of_units(record)
    if told is not None and told != moved:
        moves = "grows" if change > 0 else "shrinks"
        raise InputError(
            "not-a-step",
            f"{record.output_name} {moves} by {abs(change * record.input[-1]):.3g} {record.output_unit}"
            f" while {record.input_name} is held: neither creep, in which a deformation grows, nor"
            " relaxation, in which a load falls.",
            place=record.source,
            cause="the input was still moving, the specimen swells, shrinks or recovers, or the sensor"
            " drifts.",
            fix="choose rows in which the input is held (--where), or fit the whole motion without --hold.",
        )
    return moved


def _grows(record: Record, rows: np.ndarray) -> bool:
    """Whether most outputs go on as the step did."""
    assert record.time is not None
    changes = [
        np.polyfit(
            record.time[at][rows[at]], record.output[at][rows[at]] / record.input[at][rows[at]], 1
        )[0]
        for _, at in record.sequences()
        if rows[at].sum() > 1
    ]
    return float(np.median(changes)) > 0


def told_by_the_change(record: Record, kind: Kind) -> tuple[Note, ...]:
    """A note that the change alone tells the kind, where the units do not."""
    if is_moduli(record) or kind_of_units(record) is not None:
        return ()
    way = "grows" if kind == "creep" else "shrinks"
    said = (
        f"Taken for {kind} because {record.output_name} {way}: the units ({record.input_unit} and"
        f" {record.output_unit}) do not say whether a load or a deformation is held."
    )
    return (Note("kind-by-change", said),)


def counted(record: Record) -> Bool[np.ndarray, " samples"]:
    """Rows that count and have an output."""
    return record.mask & np.isfinite(record.output)
