"""Verdicts: whether a result can be used, why, and how several verdicts add up."""

from collections.abc import Iterable, Mapping
from typing import Any, Literal, NamedTuple

from ._note import Note

Level = Literal["PASS", "CAUTION", "FAIL"]

LEVELS: tuple[Level, ...] = ("PASS", "CAUTION", "FAIL")
"""From the best to the worst."""


class Verdict(NamedTuple):
    """PASS, CAUTION or FAIL, and why, in sentences.

    - `level`: "PASS": it can be used. "CAUTION": it can be used with care. "FAIL": do not use it.
    - `reasons`: full sentences, the most important one first. Those of hysid are `Note`s: programs read
      their `code`.
    - `best_baseline`: the baseline with the least error on the rows that were judged; "" where none was
      compared.

    **Example:**

        >>> verdict = identify.internal.Verdict("PASS", (hysteresis.Note("error", "The error is 1 %."),))
        >>> verdict = verdict.at_most("CAUTION", hysteresis.Note("no-test", "Nothing was held out."))
        >>> verdict.level, verdict.codes
        ('CAUTION', ('error', 'no-test'))
    """

    level: Level
    reasons: tuple[str, ...]
    best_baseline: str = ""

    @property
    def codes(self) -> tuple[str, ...]:
        """The codes of the reasons, in their order; `remark` for a plain sentence."""
        return tuple(Note.of(reason).code for reason in self.reasons)

    @property
    def document(self) -> dict[str, Any]:
        """Plain data for JSON: level, reasons with code, text and values, and the best baseline or None."""
        notes = map(Note.of, self.reasons)
        reasons = [{"code": x.code, "text": x.text, "values": x.values} for x in notes]
        best = self.best_baseline or None
        return {"level": self.level, "reasons": reasons, "best_baseline": best}

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> "Verdict":
        """The inverse of `document`; files of earlier versions hold sentences without codes."""
        reasons = tuple(
            Note.of(said)
            if isinstance(said, str)
            else Note(said["code"], said["text"], said.get("values"))
            for said in document["reasons"]
        )
        return cls(document["level"], reasons, document.get("best_baseline") or "")

    def at_most(self, level: Level, *reasons: str) -> "Verdict":
        """This verdict, but not better than `level`, with these further reasons."""
        worst = worst_of((self.level, level))
        return self._replace(level=worst, reasons=(*self.reasons, *reasons))


def worst_of(levels: Iterable[str]) -> Level:
    """The worst of several levels; of none, "PASS"."""
    return LEVELS[max(map(LEVELS.index, levels), default=0)]
