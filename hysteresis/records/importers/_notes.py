"""What the lines above a table say of its columns: their names, their units, and the clock of its rows."""

import re
from collections.abc import Collection, Iterable, Sequence

from ..._unit_words import SAID
from .._column_quantity import kind_of
from .._units import UNITS, is_unit, name_and_unit, spelled, written_unit
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
