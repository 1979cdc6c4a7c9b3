"""What the lines above a table say of its columns: their names, their units, and the clock of its rows."""

import re
import tomllib
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from ..._errors import InputError
from ..._format import SAID
from .._units import UNITS, is_unit, kind_of, name_and_unit, spelled, written_unit
from ._sheet import is_number

Lines = Sequence[tuple[int, str]]
"""Lines that are not blank, each with its number."""

_NUMBERED = re.compile(
    r"""(?ix)^[\s\#%;"'/*]*((?P<word>[a-z]+?)[\s_\[(\#.-]*)?(?P<number>\d+)[\s_\])]*
    (?P<what>[a-z]*)\s*([:=]|\s-\s|(?(word)[,;\t]|(?!)))\s*(?P<value>.+?)[\s"';,]*$"""
)
_SAID = re.compile(
    r"""(?x)^[\s\#%;"'/*]*(?P<key>[^\W\d_][^:=;\n]*?)[\s"]*[:=,;\t ][\s"]*
    (?P<value>[+-]?(\d+([.,]\d+)?|\.\d+)([eE][+-]?\d+)?)[\s,;"]*(?P<unit>[^\s,;"]*)[\s,;"]*$"""
)
_STEPS, _RATES, _STARTS, _SECONDS, _HERTZ = (
    SAID["clock"][name] for name in ("steps", "rates", "starts", "seconds", "hertz")
)
_HINT = re.compile(r"(?i)inc|dt|interval|period|sampl|step|delta")
LONGEST = 300
"""Characters of a note that are read."""
_UNIT = re.compile(r"(?i)\b(units?|einheit(en)?|unit[ée]s?|unidad(es)?)\b")
_OF = re.compile(r"(?i)\b(of|for|the|de|der)\b")
_MEANT = ("force", "displacement", "time")
"""Quantities whose unit a note tells without their name."""


def _plain(text: str) -> str:
    """The words of a key, in small letters: SAMPLE_TIME, sampleTime and "Sample Time" have the same."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    return " ".join(re.sub(r"[\W_]+", " ", text).casefold().split())


def is_numbered(note: str) -> bool:
    """Whether a line is one of a list by number, as in `NAME0 = Force`."""
    found = _NUMBERED.match(note[:LONGEST])
    return found is not None and not is_number(found["value"])


def listed_names(notes: Iterable[str], width: int) -> tuple[list[str], list[str]]:
    """The names of so many columns that notes list by number from 0 or 1, as in `NAME0 = Force`, and the
    units that they list likewise; empty where they list no names."""
    lists: dict[tuple[str, str], dict[int, str]] = {}
    for note in notes:
        if (found := _NUMBERED.match(note[:LONGEST])) and not is_number(found["value"]):
            kind = (found["word"] or "").lower().removesuffix("s"), found["what"].lower()
            lists.setdefault(kind, {}).setdefault(int(found["number"]), found["value"])
    whole = {
        kind: list(values.values()) for kind, values in lists.items()
        if list(values) in ([*range(width)], [*range(1, width + 1)])
    }  # fmt: skip
    units = next((v for kind, v in whole.items() if any(map(_UNIT.fullmatch, kind))), [])
    names = (v for kind, v in whole.items() if not any(map(_UNIT.fullmatch, kind)))
    return next((v for v in names if len(set(v)) == width), []), units


def noted_units(notes: Iterable[str], names: Collection[str]) -> dict[str, str]:
    """The units of columns that notes tell, as in `Travel Unit: mm`, `Units: N` or `Units: s, N, mm`."""
    found: dict[str, str] = {}
    for note in notes:
        key, _, value = re.sub(r"^[\s#%;\"'/*]+", "", note).partition(
            "=" if "=" in note and ":" not in note else ":" if ":" in note else "\t"
        )
        if not value.strip() or not _UNIT.search(key := _plain(key)):
            continue
        value = value.strip(" \t\"',;")
        whose = " ".join(_OF.sub("", _UNIT.sub("", key)).split())
        each = re.split(r"\s*[,;\t]\s*", value)
        named = [
            n for n in names if whose and re.sub(r" \d+$", "", _plain(name_and_unit(n)[0])) == whose
        ]
        if not whose and len(each) == len(names) > 1:
            found |= {n: u for n, u in zip(names, each, strict=True) if is_unit(u)}
            continue
        if not named:  # of a quantity that one column alone measures
            kinds = [kind for kind in _MEANT if spelled(value) in UNITS[kind]]
            named = [n for n in names if kind_of(n, "1").name in kinds]
            named = named if len(named) == 1 else []
        found |= {n: value for n in named if is_unit(value)}
    return {n: unit for n, unit in found.items() if written_unit(n, None) is None}


def units_behind_blanks(names: Collection[str]) -> dict[str, str]:
    """The units that stand behind a blank after most names, as in `Time s`; none where they may be letters
    that tell columns of one name apart."""
    parted = {n: n.rpartition(" ") for n in names if written_unit(n, None) is None}
    stems = [stem for stem, _, _ in parted.values()]
    found = {
        n: u for n, (stem, _, u) in parted.items() if stems.count(stem) == 1 and _is_behind(stem, u)
    }
    return found if len(found) > 1 and 2 * len(found) > len(names) else {}


def _is_behind(stem: str, unit: str) -> bool:
    minimum = unit in ("min", "count", "counts") and kind_of(stem, "1").name != "time"
    return bool(stem) and not minimum and name_and_unit(f"x, {unit}")[1] is not None


def clock_in(notes: Iterable[str]) -> tuple[float, float, str] | None:
    """The even clock that notes tell, as in `SAMPLE_TIME = 5e-5` or `Sampling rate: 20 kHz`: the time of
    the first row and from row to row, in seconds, and the note that says so.

    None where they tell none, or two that differ.
    """
    first, found = 0.0, list[tuple[float, str]]()
    for note in notes:
        said = _SAID.match(note.strip()[:LONGEST])
        if said is None:
            continue
        key, behind = name_and_unit(said["key"].strip())
        value = float(said["value"].replace(",", "."))
        unit = said["unit"].strip("()[].") or behind or ""
        key, (short, _, tail) = _plain(key), _plain(key).rpartition(" ")
        key, unit = (short, unit or tail) if short in (*_STEPS, *_RATES) else (key, unit)
        seconds, hertz = _SECONDS.get(spelled(unit) if unit else ""), _HERTZ.get(unit.casefold())
        if key in _STARTS and seconds:
            first = value * seconds
        elif key in _STEPS and seconds and value > 0:
            found.append((value * seconds, note.strip(" #;,\t")))
        elif key in _RATES and hertz and value > 0:
            found.append((1 / (value * hertz), note.strip(" #;,\t")))
    if not found or max(found)[0] > 1.001 * min(found)[0]:
        return None
    return first, *found[0]


def without_settings(lines: Lines) -> tuple[Lines, list[str]]:
    """Lines without the cells of a header that tell of the clock, and these as notes.

    Oscilloscopes write Start and Increment as names of columns that have a value in the first row alone,
    or `tInc = 2e-9` among the names.
    """
    for k, (_, line) in enumerate(lines[:30]):
        rows = [line, *(text for _, text in lines[k + 1 : k + 4])]
        for separator in ",;\t":
            cells = [[c.strip(' "') for c in row.split(separator)] for row in rows]
            if len(rows) < 4 or len(cells[0]) < 3 or not _HINT.search(line):
                continue
            cells = [[*row, *[""] * (len(cells[0]) - len(row))] for row in cells]
            told = {}
            for at, name in enumerate(cells[0]):
                note = name if any(c in name for c in "=:") else f"{name} = {cells[1][at]}"
                key = _plain(name_and_unit(re.split("[=:]", name)[0].strip())[0])
                alone = not any(row[at] for row in cells[2:])
                if alone and key in (*_STEPS, *_STARTS) and _SAID.match(note):
                    told[at] = note
            if clock_in(told.values()) is None:
                continue
            rest = [
                (n, [c for at, c in enumerate(row.split(separator)) if at not in told])
                for n, row in lines[k:]
            ]
            kept = [(n, separator.join(row)) for n, row in rest if any(row)]
            return [*lines[:k], *kept], [*told.values()]
    return lines, []


# The table of dialects: what programs of rigs write, in `dialects.toml` or a file of the user.

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
