"""A sentence for people with a code for programs: what was done to data, and what is wrong with them."""

from typing import Any


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
