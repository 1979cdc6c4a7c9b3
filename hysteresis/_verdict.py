"""Verdicts: whether a result can be used, why, and how several verdicts add up."""

from collections.abc import Iterable
from typing import Literal, NamedTuple

Level = Literal["PASS", "CAUTION", "FAIL"]

LEVELS: tuple[Level, ...] = ("PASS", "CAUTION", "FAIL")
"""From the best to the worst."""


class Verdict(NamedTuple):
    """PASS, CAUTION or FAIL, and why, in sentences.

    - `level`: "PASS": it can be used. "CAUTION": it can be used with care. "FAIL": do not use it.
    - `reasons`: full sentences; the first one is the most important.

    **Example:**

        >>> verdict = identify.Verdict("PASS", ("The error is 1 %.",))
        >>> verdict.at_most("CAUTION", "Nothing was held out.").level
        'CAUTION'
    """

    level: Level
    reasons: tuple[str, ...]

    def at_most(self, level: Level, *reasons: str) -> "Verdict":
        """This verdict, but not better than `level`, with these further reasons."""
        return Verdict(worst_of((self.level, level)), (*self.reasons, *reasons))


def worst_of(levels: Iterable[str]) -> Level:
    """The worst of several levels; of none, "PASS".

    **Example:**

        >>> worst_of(["PASS", "FAIL", "CAUTION"])
        'FAIL'
    """
    return LEVELS[max(map(LEVELS.index, levels), default=0)]
