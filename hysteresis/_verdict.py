"""Verdicts: whether a result can be used, why, and how several verdicts add up."""

from collections.abc import Iterable, Mapping
from typing import Any, Literal, NamedTuple

# A sentence for people with a code for programs: what was done to data, and what is wrong with them.


class Note(str):
    """A sentence with a stable `code`: people read the sentence, programs read the code and the `values`.

    It is a string, so it prints, joins and saves as one; two notes are equal where their sentences are.

    **Arguments:**

    - `code`: a short stable name of what the sentence says, such as `resampled`.
    - `text`: the sentence.
    - `values`: the numbers and names that it tells, unrounded, by name.

    **Example:**

        >>> import hysteresis
        >>> note = hysteresis.Note("resampled", "Resampled 7 rows to a step of 0.25 s.", {"rows": 7})
        >>> note.code, note.values["rows"]
        ('resampled', 7)
    """

    __slots__ = ("code", "values")
    code: str
    values: dict[str, Any]

    def __new__(cls, code: str, text: str, values: dict[str, Any] | None = None) -> "Note":
        """A note of this code, text and values."""
        note = super().__new__(cls, text)
        note.code, note.values = code, values or {}
        return note

    def __getnewargs__(self) -> tuple[Any, ...]:
        """What a copy is made from."""
        return self.code, self.text, self.values

    @property
    def text(self) -> str:
        """The sentence as a plain string."""
        return str.__str__(self)

    @classmethod
    def of(cls, said: str) -> "Note":
        """A note as it is; of any other string, which is a remark of the user's, one of code `remark`."""
        return said if isinstance(said, cls) else cls("remark", said)


def warning(code: str, text: str, values: dict[str, Any] | None = None) -> Note:
    """A note whose text names its code in brackets at the end, as an error's does."""
    return Note(code, f"{text} [{code}]", values)


class ProgressNote(Note):
    """A note of a long run that says how far it is: `done` of `total` parts."""

    __slots__ = ("done", "total")
    done: int
    total: int

    def __new__(cls, code: str, text: str, done: int, total: int) -> "ProgressNote":
        """A note of this code and text, at this place of a run."""
        note = super().__new__(cls, code, text)
        assert isinstance(note, ProgressNote)  # for type checkers
        note.done, note.total = done, total
        return note

    def __getnewargs__(self) -> tuple[str, str, int, int]:  # type: ignore[override]
        """What a copy is made from."""
        return self.code, self.text, self.done, self.total


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
