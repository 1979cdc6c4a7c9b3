"""One number that a paper prints, how a virtual laboratory measures it, and how the two compare."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy

Measure = Callable[[Any, bool], float | None]
"""Of one laboratory, by the paper's method or by ours; None where it has not made that experiment."""

TUNED, INFERRED, PREDICTED, UNPRINTED, NOT_COMPARABLE = (
    "tuned to this number", "inferred", "predicted", "not printed", "not comparable",
)  # fmt: skip
"""What a row is worth: the virtual rig was chosen so that the number comes out; the number itself is
an inference from the paper; nothing was chosen for it; the paper shows no number; or it depends on
something else, as a time does on the computer."""

COVERAGE = 0.95
"""Of the interval of a count."""


class Published(NamedTuple):
    """One number of a paper, or None for a quantity of which the paper prints no number.

    - `where`: it is printed.
    - `half_digit`: what its printing leaves open: half of its last digit, or of the step it was read in.
    - `measure`: the same number, of one virtual laboratory. `both`: our method has one, too.
    - `label`: `TUNED`, `INFERRED`, `PREDICTED` or `UNPRINTED`.
    - `differs`: how the virtual rig differs from the paper's, for this number.
    - `repeats`: the number counts successes in so many of the paper's own trials.
    - `percent`: it is the percentage of them.
    - `at_most`: the paper says no more than that it is not exceeded.
    - `judged`: whether the virtual rig can be within or outside; a time on another computer is neither.
    """

    key: str
    what: str
    where: str
    unit: str
    value: float | None
    half_digit: float
    measure: Measure
    label: str
    differs: str
    repeats: int = 0
    percent: bool = False
    at_most: bool = False
    judged: bool = True
    both: bool = False

    def tolerance(self) -> tuple[float, float] | None:
        """What the paper's own repeats, or else its printed digits, leave open.

        Of a count it is Clopper and Pearson's interval of the chance, times the trials. The spread of
        the virtual rigs is not in it, so a worse rig does not pass more easily.
        """
        if self.value is None or not self.judged:
            return None
        if self.at_most:
            return -np.inf, self.value + self.half_digit
        if not self.repeats:
            return self.value - self.half_digit, self.value + self.half_digit
        scale = (100 if self.percent else self.repeats) / self.repeats
        seen = round(self.value / scale)
        interval = scipy.stats.binomtest(seen, self.repeats).proportion_ci(COVERAGE)
        return interval.low * self.repeats * scale, interval.high * self.repeats * scale


def compared(
    published: Sequence[Published],
    laboratories: Sequence[Any],
    with_ours: bool,
    progress: Callable[[int], None] = lambda done: None,
) -> list[dict[str, Any]]:
    """One row for each number, which `with_ours` has the same by our method beside it."""
    methods = (False, True) if with_ours else (False,)
    found: dict[tuple[str, bool], list[float]] = {}
    for n, laboratory in enumerate(laboratories):
        for ours in methods:
            for p in published:
                if (p.both or not ours) and (value := p.measure(laboratory, ours)) is not None:
                    found.setdefault((p.key, ours), []).append(value)
        progress(n + 1)
    return [row_of(p, found[p.key, False], found.get((p.key, True))) for p in published]


def row_of(of: Published, found: list[float], ours: list[float] | None) -> dict[str, Any]:
    """The number beside those of the laboratories, by the paper's method and by ours.

    `within`: the laboratories' mean is within the tolerance.
    """
    mean, sd = _spread(found)
    tolerance = of.tolerance()
    named = ("key", "what", "where", "unit", "at_most", "half_digit", "repeats", "label", "differs")
    row = {name: getattr(of, name) for name in named} | {"published": of.value}
    row |= {"reproduced": mean, "sd": sd, "count": len(found)}
    row["ours"], row["ours_sd"] = _spread(ours) if ours else (None, None)
    row["tolerance"] = None if tolerance is None else [float(x) for x in tolerance]
    row["within"] = None if tolerance is None else bool(tolerance[0] <= mean <= tolerance[1])
    return row


def finding(published: str, reproduced: str, holds: Any) -> dict[str, Any]:
    """What a paper says in words, and whether the sentence is literally true here."""
    return {"published": published, "reproduced": reproduced, "holds": bool(holds)}


def _spread(values: list[float]) -> tuple[float, float]:
    return float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
