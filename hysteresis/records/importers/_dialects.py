"""The table of dialects: what programs of rigs write, in `dialects.toml` or a file of the user."""

import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from ..._errors import InputError

_OWN = Path(__file__).with_name("dialects.toml")


class Dialect(NamedTuple):
    """What a program writes. `dialects.toml` says what each field is.

    `decimal`: the decimal sign where the file says it, else "".
    """

    name: str
    signature: re.Pattern[str]
    sure: bool = True
    begins: re.Pattern[str] | None = None
    column: str = "block"
    label: re.Pattern[str] | None = None
    listed: re.Pattern[str] | None = None
    names: tuple[str, ...] = ()
    units: tuple[tuple[re.Pattern[str], tuple[str, ...]], ...] = ()
    blank: bool = False
    joined: bool = False
    refuse: str = ""
    decimal: str = ""

    def label_of(self, above: list[list[str]]) -> str:
        """The name of a table from the rows of text above it, "" for none."""
        text = "\n".join("\t".join(cell for cell in row if cell) for row in above)
        found = self.label.search(text) if self.label is not None else None
        return " ".join(found["label"].split()) if found else ""


OTHER = Dialect(
    "a table with notes above it", re.compile(""), label=re.compile(r"(?P<label>\S.*)"), sure=False
)


def dialect_of(text: str, own: str | Path | None = None) -> Dialect:
    """The dialect of a file by its first lines; those of the file `own` come first.

    Raises `InputError` as `dialects_in` does.
    """
    for dialect in (*(dialects_in(Path(own)) if own else ()), *dialects_in(_OWN)):
        if found := dialect.signature.search(text):
            sign = found.groupdict().get("decimal") or ""
            # The lines above a table may list its columns.
            listed = dialect.listed.finditer(text) if dialect.listed else ()
            names = tuple(one["name"] for one in listed) or dialect.names
            return dialect._replace(names=names, decimal=sign)
    return OTHER


def maker_of(text: str) -> str:
    """The maker that the first lines of a file name, "" for none."""
    return next((name for name, signature in _makers() if signature.search(text)), "")


def dialects_in(file: Path) -> tuple[Dialect, ...]:
    """The dialects that a TOML file lists.

    Raises `InputError` `unreadable-file`, and `bad-config` for what is not TOML, an unknown key, a missing
    one, a wrong kind of value or a bad expression.
    """
    try:
        return _dialects(file.read_text("utf-8"))
    except OSError as error:
        said = f"The dialects cannot be read: {error.strerror or error}."
        mend = "Name a TOML file (--dialects FILE)."
        raise InputError("unreadable-file", said, place=str(file), fix=mend) from None
    except (re.error, TypeError, ValueError) as error:  # of UTF-8 and of TOML, too
        where = f" in {error.pattern!r}" if isinstance(error, re.error) else ""
        said = f"This is not TOML of dialects: {error}{where}."
        mend = 'Write dialects = [{name = "a rig file", signature = "^RIG"}], a line each.'
        raise InputError("bad-config", said, place=str(file), fix=mend) from None


@cache
def _dialects(text: str) -> tuple[Dialect, ...]:
    listed = tomllib.loads(text).get("dialects")
    if not isinstance(listed, list):
        raise ValueError("it has no list `dialects`")
    return tuple(map(_dialect, listed))


@cache
def _makers() -> tuple[tuple[str, re.Pattern[str]], ...]:
    listed = tomllib.loads(_OWN.read_text("utf-8"))["makers"]
    return tuple((maker["name"], re.compile(maker["signature"])) for maker in listed)


def _dialect(said: Any) -> Dialect:
    kinds = {"name": str, "signature": str, "sure": bool, "begins": str, "column": str, "label": str,
             "listed": str, "names": list, "units": list, "blank": bool, "joined": bool,
             "refuse": str}  # fmt: skip
    if not isinstance(said, Mapping) or not {"name", "signature"} <= set(said):
        raise ValueError(f"{said!r} has no name or no signature")
    if odd := [key for key, value in said.items() if not isinstance(value, kinds.get(key, ()))]:
        raise ValueError(f"{odd[0]!r} = {said[odd[0]]!r} is none of {', '.join(kinds)}")
    groups = {"signature": "", "begins": "", "label": "label", "listed": "name"}
    found: dict[str, Any] = {**said} | {key: re.compile(said[key]) for key in groups if key in said}
    for key, group in groups.items():
        if group and key in said and group not in found[key].groupindex:
            raise ValueError(f"{key} = {said[key]!r} has no group (?P<{group}>...)")
    found["names"] = tuple(map(str, said.get("names", ())))
    found["units"] = tuple(
        (re.compile(expression), tuple(map(str, units)))
        for expression, units in said.get("units", ())
    )
    return Dialect(**found)
