"""Virtual rigs under motions that their makers did not choose: what other histories do to a fit.

A record that repeats one loop tells little of smaller ones, and one at a single rate little of others.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from jaxtyping import Float
from scipy.stats import gmean

import identify

from .. import _other_rigs as rigs
from .._measure import Row, noted
from .verdicts import Judged, calibration

OTHER = "virtual rigs under other motions"
"""What `--only` has to be part of for these rows."""

CYCLE = 120
"""Samples of a cycle, where nothing else is said."""

Samples = Float[np.ndarray, " samples"]


class Path:
    """An input that grows at its end, from the low end of its range: 0, or -1 where it goes `both` ways."""

    def __init__(self, both: bool) -> None:
        self.both, self.random = both, np.random.default_rng(0)
        self.parts: list[Samples] = []
        self.at = self.low(1.0)

    def low(self, height: float) -> float:
        return -height if self.both else 0.0

    def cycles(
        self, heights: Sequence[float], rows: Sequence[int] = (CYCLE,), even: bool = False
    ) -> "Path":
        """Up to each height and down again, smoothly or at an `even` rate, in so many rows by turns."""
        for k, height in enumerate(heights):
            x = np.arange(n := rows[k % len(rows)]) / n
            risen = 1 - np.abs(1 - 2 * x) if even else (1 - np.cos(2 * np.pi * x)) / 2
            begin = np.where(x < 0.5, self.at, self.low(height))
            self.parts.append(begin + (height - begin) * risen)
            self.at = self.low(height)
        return self

    def walk(self, rows: int) -> "Path":
        """From one random place to the next, in 15 to 59 rows each, for so many rows or some more."""
        count = 0
        while count < rows:
            to, n = self.random.uniform(self.low(1.0), 1.0), int(self.random.integers(15, 60))
            self.parts.append(np.linspace(self.at, to, n, endpoint=False))
            self.at, count = to, count + n
        return self


Move = Callable[[Path], Path]
SMALLER = (0.8, 0.6, 0.4, 0.2, 0.5, 0.9)
MOTIONS: dict[str, tuple[Move, Move]] = {
    "one amplitude, then smaller ones": (
        lambda path: path.cycles((1,) * 6), lambda path: path.cycles(SMALLER)
    ),
    "one amplitude at three rates, then smaller ones": (
        lambda path: path.cycles((1,) * 8, (60, 120, 240)), lambda path: path.cycles(SMALLER)
    ),
    "six amplitudes, then a random path": (
        lambda path: path.cycles((1, 0.8, 0.6, 0.4, 0.2, 1, 0.5), even=True), lambda path: path.walk(600)
    ),
    "a random path, then another": (
        lambda path: path.cycles((1,), even=True).walk(1000), lambda path: path.walk(500)
    ),
    "three amplitudes, then smaller ones": (
        lambda path: path.cycles((1, 0.5, 1, 0.5, 0.9, 0.5)),
        lambda path: path.cycles((0.75, 0.3, 0.75, 0.3), (90,)),
    ),
    "rates, then faster and slower ones": (
        lambda path: path.cycles((1, 0.7, 0.9, 0.5, 1), (160, 120, 200, 120, 160)),
        lambda path: path.cycles((1, 0.7, 1, 0.8), (60, 60, 400, 400)),
    ),
}  # fmt: skip
"""How the trained rows move, and the tested ones after them."""


def rows() -> Iterator[Row]:
    """Of each motion the errors of all rigs and of their best baselines; then what verdicts are worth."""
    every: list[Judged] = []
    for motion, moves in MOTIONS.items():
        found = [_judged(f"{name}, {motion}", rig, moves) for name, rig in rigs.RIGS.items()]
        ours, others = gmean([one.error for one in found]), gmean([one.other for one in found])
        what = f"{OTHER}: {motion}: geometric mean of the errors, per cent (best baselines {others:.2g})"
        yield noted(what, float(ours))
        every += found
    for row in calibration(every):
        yield row._replace(what=f"{OTHER}: {row.what}")


def _judged(what: str, rig: rigs.Rig, moves: tuple[Move, Move]) -> Judged:
    path = Path(both=min(low for low, _ in rig.swings) < 0)
    trained, tested = moves
    count = sum(map(len, trained(path).parts))
    u = np.concatenate(tested(path).parts)
    low, high = np.min(rig.swings), np.max(rig.swings)
    if low > 0:  # a range that does not begin at zero
        u = low + (high - low) * u
    fit = identify.fit(rigs.reading_of(rig, u, seed=1), test_tail=1 - count / len(u))
    return rigs.judged_fit(what, fit)
