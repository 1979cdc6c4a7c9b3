"""Columns of dates and times of day as seconds from the first row.

Loggers write a clock as a date ("2020-11-05T10:59:58.250", "05.11.2020 10:59:58", "2020/11/5 10:59"), as a
time of day or of a test ("10:59:58.250", "00:01:02", "1:02.5"), as the seconds, milli-, micro- or
nanoseconds since 1970, as the days since 1900 of a spreadsheet, or as what the functions of a
microcontroller count.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import date, datetime
from typing import NamedTuple

import numpy as np

from .._note import Note
from ._table import Table
from ._units import named_unit

DAY = 86_400.0
_TIME = re.compile(r"(\d{1,3}):(\d\d):(\d\d)(?:[.,:](\d{1,9}))?\s*([AaPp]\.?[Mm]\.?)?")
_MINUTES = re.compile(r"(\d{1,4}):(\d\d)(?:[.,](\d{1,9}))?")
_DATE = re.compile(
    r"(?:(\d{1,2})([./-])(\d{1,2})\2(\d{4})|(\d{4})([./-])(\d{1,2})\6(\d{1,2}))[\sT,;]+"
)
_HOUR = re.compile(r"^\d\d?:\d\d(?![:.,])")
_NAMED = re.compile(r"time|stamp|zeit|clock|epoch|date|datum", re.IGNORECASE)
_DATED = re.compile(r"date|datum", re.IGNORECASE)
_SINCE_1970 = {1e9: 1.0, 1e12: 1e-3, 1e15: 1e-6, 1e18: 1e-9}
"""Seconds since 1970 are between one and two thousand millions, from 2001 to 2033, in such steps."""
_DAYS_SINCE_1900 = 36_526.0, 54_789.0
"""Of the years from 2000 to 2049."""
SEVERAL = 3.0
"""Usual steps that a counter goes at most while it turns over."""
_COUNTED = {"millis": "ms", "micros": "us"}
"""Functions of a microcontroller, and the unit of what they return."""


class _Clock(NamedTuple):
    """Seconds from the first row, and what the column held."""

    seconds: np.ndarray
    was: str


def with_clocks(table: Table) -> Table:
    """The table with columns of dates, times of day and times since 1970 as seconds from the first row.

    A column is one if each of its cells is. A time of day that goes back by half a day has passed midnight.
    """
    columns, units, notes = dict(table.columns), dict(table.units), list(table.notes)
    for name, x in table.columns.items():
        if x.dtype.kind != "f":
            found = _stamps(x)
        elif named_unit(name, None, table.units.get(name)) is None:
            if unit := _COUNTED.get(name.strip("() ").lower()):
                columns[name], units[name] = _unwrapped(x), unit
                if columns[name] is not x:
                    notes.append(
                        Note("clock", f"Column {name!r} turned over: read as one that goes on.")
                    )
                continue
            found = _since_a_day(name, x)
        else:
            continue
        if found is not None:
            columns[name], units[name] = found.seconds, "s"
            read = f"Column {name!r} holds {found.was}: read as seconds from the first row."
            notes.append(Note("clock", read))
    return replace(table, columns=columns, units=units, notes=tuple(notes))


def _stamps(cells: np.ndarray) -> _Clock | None:
    """NaN where a cell is empty; None where one is neither date nor time."""
    filled = np.flatnonzero(cells != "")
    if len(filled) < 2 or ":" not in cells[filled[0]] or ":" not in cells[filled[-1]]:
        return None
    words = cells[filled].tolist()
    days, hour = "dates or times of day", "minutes and seconds"
    for read, said in ((_iso, days), (_by_parts, days), (_by_minutes, hour)):
        try:
            seconds = read(words)
        except (ValueError, TypeError):  # no date, or one with a time zone and one without
            continue
        found = np.full(len(cells), np.nan)
        found[filled] = np.round(seconds - seconds[0], 9)
        return _Clock(found, said) if np.ptp(seconds) > 0 else None
    return None


def _iso(words: Sequence[str]) -> np.ndarray:
    first = datetime.fromisoformat(words[0])
    return np.array([(datetime.fromisoformat(w) - first).total_seconds() for w in words])


def _by_parts(words: Sequence[str]) -> np.ndarray:
    """A time of day, perhaps behind a date that begins with its year, its day or, with slashes, perhaps its
    month; behind a date hours and minutes are enough."""
    cut = [_DATE.match(word) for word in words]
    rest = [w[c.end() :] if c else w for w, c in zip(words, cut, strict=True)]
    rest = [_HOUR.sub(r"\g<0>:00", w) if c else w for w, c in zip(rest, cut, strict=True)]
    of_day = np.array([_seconds(w) for w in rest])
    dates = [c for c in cut if c is not None]
    if dates and len(dates) < len(cut):
        raise ValueError("a date is missing")
    if len({c[0] for c in dates}) > 1:
        parts = [(c[1] or c[8], c[3] or c[7], c[4] or c[5]) for c in dates]
        return of_day + _days([(int(a), int(b), int(year)) for a, b, year in parts], dates[0][2])
    if not dates:
        of_day += DAY * np.cumsum(np.diff(of_day, prepend=of_day[0]) < -DAY / 2)
    return of_day


def _by_minutes(words: Sequence[str]) -> np.ndarray:
    """Minutes and seconds, of which some cell has a fraction: without one they may be hours and minutes. A
    spreadsheet's begin again after an hour."""
    parts = [_MINUTES.fullmatch(word.strip()) for word in words]
    if not any(found and found[3] for found in parts):
        raise ValueError("hours and minutes, or minutes and seconds")
    seconds = np.array(
        [60.0 * int(m[1]) + float(f"{m[2]}.{m[3] or 0}") for m in parts if m is not None]
    )
    if len(seconds) < len(words):
        raise ValueError("no minutes and seconds")
    return seconds + 3600 * np.cumsum(np.diff(seconds, prepend=seconds[0]) < -1800)


def _days(parts: Sequence[tuple[int, int, int]], sign: str | None) -> np.ndarray:
    """Seconds of days; of two readings of a date the one that goes on, and then the shorter one."""
    orders: list[Callable[[int, int, int], date]] = [lambda a, b, year: date(year, b, a)]
    if sign == "/":
        orders.append(lambda a, b, year: date(year, a, b))
    found: list[tuple[bool, float, int, np.ndarray]] = []
    for k, order in enumerate(orders):
        try:
            days = np.array([order(*one).toordinal() for one in parts], float)
        except ValueError:  # there is no month 13
            continue
        back = bool((np.diff(days) < 0).any())
        found.append((back, float(np.ptp(days)), k, days))
    if not found:
        raise ValueError("no calendar has these dates")
    return DAY * min(found, key=lambda one: one[:3])[3]


def _seconds(word: str) -> float:
    found = _TIME.fullmatch(word.strip())
    if found is None:
        raise ValueError(word)
    hours, minutes, seconds, fraction, half = found.groups()
    h = int(hours)
    if half:
        h = h % 12 + (12 if half[0] in "pP" else 0)
    return (
        3600.0 * h + 60 * int(minutes) + int(seconds) + (float(f"0.{fraction}") if fraction else 0)
    )


def _unwrapped(x: np.ndarray) -> np.ndarray:
    """A counter of 16 or 32 bits that has turned over, as one that goes on."""
    good = np.flatnonzero(np.isfinite(x))
    step = np.diff(x[good], prepend=x[good[:1]])
    back, usual = step < 0, np.median(np.abs(step))
    for bits in (16, 32):
        turned = back & (np.abs(step + 2.0**bits) <= SEVERAL * usual)
        if turned.any() and (turned == back).all():
            x = x.copy()
            x[good] += 2.0**bits * np.cumsum(turned)
    return x


def _since_a_day(name: str, x: np.ndarray) -> _Clock | None:
    """A clock whose values are those of the years from 2001 to 2033 since 1970; or in days since 1900,
    where it is named a date, or moves by less than one: a clock in seconds may pass through such values."""
    good = np.isfinite(x)
    if not _NAMED.search(name) or good.sum() < 2:
        return None
    low, high = float(x[good].min()), float(x[good].max())
    step = next((s for least, s in _SINCE_1970.items() if least <= low < high < 2 * least), None)
    was = "times since 1970"
    in_days = _DAYS_SINCE_1900[0] <= low < high < _DAYS_SINCE_1900[1]
    if in_days and (_DATED.search(name) or high - low < 1):
        step, was = DAY, "days since 1900"
    return None if step is None else _Clock(np.round((x - x[good][0]) * step, 9), was)
