"""Records of moduli over frequency, and of several temperatures: responses, and answers on their rows.

Such a record is long: storage and loss moduli are sequences of their own, "storage" and "loss", and with a
temperature every run at one is a sequence: "storage 3" and "loss 3", or "3" of relaxation or creep.
"""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Bool, Float
from scipy.constants import zero_Celsius

from hysteresis import InputError, Record
from hysteresis._quantities import conversion

from ._prony_series import Input, Kind
from ._response import Response
from ._superposition import Shifts

MODULI, RUNS = "moduli", "runs"
"""Codes of the notes in the history of a record of moduli, and of one of several temperatures."""
PARTS = ("storage", "loss")

Rows = Float[np.ndarray, " samples"]


def is_moduli(record: Record) -> bool:
    """Whether the rows are moduli, over a frequency as input."""
    return any(note.code == MODULI for note in record.history)


def is_survey(record: Record) -> bool:
    """Whether the record has several responses, or moduli: no clock of a model runs through its rows."""
    return any(note.code in (MODULI, RUNS) for note in record.history)


def responses_of(
    record: Record, kind: Kind, rows: Bool[np.ndarray, " samples"]
) -> list[tuple[Response, float]]:
    """The response of every run, of those rows, and its temperature in degC, NaN where there is none."""
    runs: dict[str, dict[str, slice]] = {}
    for label, at in record.sequences():
        part, _, run = label.partition(" ")
        runs.setdefault(run if is_moduli(record) else label, {})[part] = at
    found = []
    for parts in runs.values():
        at = {part: np.arange(s.start, s.stop)[rows[s]] for part, s in parts.items()}
        every = np.concatenate([*at.values()])
        if not len(every):
            continue
        temperature = _temperature(record, every)
        if not is_moduli(record):
            assert record.time is not None
            order = every[np.argsort(record.time[every], kind="stable")]
            y = record.output[order] / record.input[order]
            own = Response(record.time[order], y, kind)
            found.append((weighed(own, record, np.abs(record.input[order]), order), temperature))
            continue
        frequency, place = np.unique(record.input[every], return_inverse=True)
        is_loss = np.concatenate([np.full(len(one), part == PARTS[1]) for part, one in at.items()])
        y = [
            _means(place[own], record.output[every[own]], len(frequency))
            for own in (~is_loss, is_loss)
        ]
        modulus = np.empty(len(frequency), complex)
        modulus.real, modulus.imag = y
        own = Response(frequency * angular(record.input_unit), modulus, "modulus")
        weight = _means(place, record.weights[every], len(frequency))
        found.append((weighed(own, record, weight), temperature))
    return found


def weighed(
    response: Response, record: Record, weight: Rows, rows: np.ndarray | None = None
) -> Response:
    """With errors weighed by the record's sigma, where it has one, instead of by 1 / |y|.

    `weight` times that of the record in `rows`, if any, is that of the response.
    """
    if record.sigma is None:
        return response
    size, every = (
        np.sqrt(np.mean(np.abs(np.nan_to_num(y)) ** 2))
        for y in (response.y, record.output[record.mask])
    )
    weight = weight if rows is None else weight * record.weights[rows]
    return response._replace(weight=weight * size / every, relative=False)


def answers_on(
    record: Record, kind: Kind, answer: Callable[[Input], np.ndarray], shifts: Shifts | None
) -> Rows:
    """The outputs of a survey's rows, by the answer to a unit input."""
    found = np.full(len(record), np.nan)
    for part, at, _, factor in runs_of(record, shifts):
        if is_moduli(record):
            omega = record.input[at] * angular(record.input_unit) * factor
            both = answer(Input(kind, omega, oscillation=True)).reshape(2, -1)
            found[at] = both[int(part == PARTS[1])]
        else:
            assert record.time is not None
            found[at] = record.input[at] * answer(Input(kind, record.time[at] * factor))
    return found


def runs_of(record: Record, shifts: Shifts | None) -> Iterator[tuple[str, slice, float, float]]:
    """Of every sequence its part, rows and temperature, and the factor of its clock at the reference."""
    for label, at in record.sequences():
        temperature = _temperature(record, np.arange(at.start, at.stop))
        a = 1.0 if shifts is None else 10.0 ** shifts.at(temperature)
        moduli = is_moduli(record)
        yield label.partition(" ")[0] if moduli else "", at, temperature, a if moduli else 1 / a


def sizes_of(record: Record, rows: Bool[np.ndarray, " samples"]) -> Rows:
    """By what an error is divided: the reading, of a modulus the size of the complex one."""
    found = np.abs(record.output)
    if not is_moduli(record):
        return found
    names = np.array([label.partition(" ") for label in record.labels])
    part, _, run = np.repeat(names, np.diff([*record.starts, len(record)]), axis=0).T
    numbered = np.stack([np.unique(run, return_inverse=True)[1], record.input])
    place = np.unique(numbered, axis=1, return_inverse=True)[1].ravel()
    squares = np.zeros(len(found))
    for one in np.unique(part):  # a frequency that was passed twice has the mean of both
        own = rows & (part == one)
        squares += np.nan_to_num(_means(place[own], found[own] ** 2, len(found)))
    size = np.sqrt(squares[place])
    return np.where(size > 0, size, np.nan)


def angular(unit: str) -> float:
    """Radians per unit of time in one of these frequencies. Raises `InputError` for no frequency."""
    turns = not any(word in unit for word in ("rad", "rpm", "rev"))
    factor = conversion(unit, "1/s")
    if factor is None:
        raise InputError(
            "wrong-unit",
            f"{unit!r} is not a unit of frequency.",
            fix="give Hz or rad/s (--input-unit Hz).",
        )
    return float(factor * (2 * np.pi if turns else 1.0))


def _temperature(record: Record, rows: np.ndarray) -> float:
    if not record.conditions:
        return float("nan")
    (name, unit), *more = record.conditions.items()
    if more:
        raise InputError(
            "several-conditions", f"{len(record.conditions)} conditions, and one temperature shifts times.",
            fix="name the temperature alone (--condition COL).",
        )  # fmt: skip
    value = float(np.mean(record.columns[name][rows]))
    word = unit.replace("°", "deg").replace("Δ", "delta_").removeprefix("delta_").lower()
    if word in ("k", "kelvin"):
        return value - zero_Celsius
    return (value - 32) / 1.8 if word in ("degf", "fahrenheit", "f") else value


def _means(place: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Of the values at each place; NaN where there is none."""
    times = np.bincount(place, minlength=count)
    with np.errstate(invalid="ignore"):
        return np.bincount(place, values, count) / times
