"""One number that a paper prints, how a virtual laboratory measures it, and how the two compare."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

Measure = Callable[[Any], float | None]
"""Of one laboratory; None where it has not made that experiment."""


class Published(NamedTuple):
    """One number of a paper, or None for one that a figure shows and no text prints.

    - `half_digit`: what its printing leaves open: half of its last digit, or of the step it was read in.
    - `measure`: the same number, of one virtual laboratory.
    - `why`: of a deviation.
    - `at_most`: the paper says no more than that it is not exceeded.
    """

    key: str
    what: str
    where: str
    unit: str
    value: float | None
    half_digit: float
    measure: Measure
    why: str = ""
    at_most: bool = False


def compared(
    published: Sequence[Published],
    better: Mapping[str, Measure],
    laboratories: Sequence[Any],
    progress: Callable[[int], None],
) -> list[dict[str, Any]]:
    """One row for each number. `within_two_sd`: |published - mean| <= 2 sd + half_digit.

    `better`: the same numbers by our method, by their keys.
    """
    found: dict[str, list[float]] = {p.key: [] for p in published}
    ours: dict[str, list[float]] = {key: [] for key in better}
    measures = {p.key: p.measure for p in published}
    for n, laboratory in enumerate(laboratories):
        for into, how in ((found, measures), (ours, better)):
            for key, measure in how.items():
                value = measure(laboratory)
                into[key] += [] if value is None else [value]
        progress(n + 1)
    return [row_of(p, found[p.key], ours.get(p.key)) for p in published]


def row_of(of: Published, found: list[float], ours: list[float] | None) -> dict[str, Any]:
    """The number beside those of the laboratories, by the paper's method and by ours."""
    mean, sd = _spread(found)
    row: dict[str, Any] = {"key": of.key, "what": of.what, "where": of.where, "unit": of.unit}
    row |= {"published": of.value, "at_most": of.at_most, "half_digit": of.half_digit}
    row |= {"reproduced": mean, "sd": sd, "count": len(found)}
    row["ours"], row["ours_sd"] = _spread(ours) if ours else (None, None)
    if of.value is None:
        return row | {"within_two_sd": None, "deviation": ""}
    off = max(mean - of.value, 0) if of.at_most else abs(mean - of.value)
    row["within_two_sd"] = off <= 2 * sd + of.half_digit
    return row | {"deviation": of.why if off > max(of.half_digit, 0.5 * sd) else ""}


def finding(published: str, reproduced: str, holds: Any) -> dict[str, Any]:
    """What a paper says in words, and whether it holds here."""
    return {"published": published, "reproduced": reproduced, "holds": bool(holds)}


def _spread(values: list[float]) -> tuple[float, float]:
    return float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
