"""What is said when the user's data or settings are at fault."""

from functools import partial
from typing import Any


class InputError(ValueError):
    """The user's data or settings are at fault: say where, what, why, and how to mend it.

    **Arguments:**

    - `code`: a short stable name of the kind of fault, for scripts and for searching.
    - `problem`: what is wrong, in one sentence.
    - `place`: file, line, column: wherever the user has to look.
    - `cause`: what most likely brought it about.
    - `fix`: what to do now.

    `str(error)` is one paragraph: `place: problem Cause: ... Fix: ... [code]`.
    """

    code: str
    problem: str
    place: str
    cause: str
    fix: str

    def __init__(self, code: str, problem: str, *, place: str = "", cause: str = "", fix: str = ""):
        self.code, self.problem, self.place, self.cause, self.fix = code, problem, place, cause, fix
        super().__init__(self._text())

    @property
    def document(self) -> dict[str, str]:
        """The five as plain data, as `--json` prints them."""
        return {
            "code": self.code, "message": self.problem, "where": self.place, "cause": self.cause,
            "fix": self.fix,
        }  # fmt: skip

    def __reduce__(self) -> tuple[Any, ...]:  # between processes
        return partial(type(self), **vars(self)), ()

    def _text(self) -> str:
        text = f"{self.place}: {self.problem}" if self.place else self.problem
        if self.cause:
            text += f" Likely cause: {self.cause}"
        if self.fix:
            text += f" Fix: {self.fix}"
        return f"{text} [{self.code}]"
