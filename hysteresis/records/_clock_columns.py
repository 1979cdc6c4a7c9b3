"""Columns of dates and times of day as seconds from the first row.

Loggers write a clock as a date ("2020-11-05T10:59:58.250", "05.11.2020 10:59:58", "2020/11/5 10:59"), as a
time of day or of a test ("10:59:58.250", "00:01:02", "1:02.5"), as the seconds, milli-, micro- or
nanoseconds since 1970, as the days since 1900 of a spreadsheet, or as what the functions of a
microcontroller count.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import date

import numpy as np

from .._verdict import Note
from ._table import Table, rows_of
from ._units import kind_of, named_unit

DAY = 86_400.0
_STAMP = re.compile(
    r"(?:(?P<a>\d{1,4})(?P<sign>[./-])(?P<b>\d{1,2}|[A-Za-z]{3})(?P=sign)(?P<c>\d{1,4})[\sT,;]+)?"
    r"(?P<h>\d{1,4}):(?P<m>\d\d)(?::(?P<s>\d\d))?(?:(?:[.,]|(?<=:\d\d:\d\d):)(?P<f>\d{1,9}))?"
    r"\s*(?:(?P<half>[AaPp])\.?[Mm]\.?)?(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?"
)
"""A date, which begins with its year or ends with it, and a time of day; or minutes and seconds alone."""
_DATED = re.compile(r"date|datum", re.IGNORECASE)
_MONTHS = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"]
_SINCE_1970 = {1e9: 1.0, 1e12: 1e-3, 1e15: 1e-6, 1e18: 1e-9}
"""Seconds since 1970 are between one and two thousand millions, from 2001 to 2033, in such steps."""
_DAYS_SINCE_1900 = 36_526.0, 54_789.0
"""Of the years from 2000 to 2049."""
SEVERAL = 3.0
"""Usual steps that a counter goes at most while it turns over; runs that begin again stop elsewhere."""
_COUNTED = {"millis": "ms", "micros": "us"}
"""Functions of a microcontroller, and the unit of what they return."""
_TURNS = (2.0**16, 2.0**32, 2.0**32 / 1e3, 2.0**32 / 1e6)
"""Where counters turn over: of 16 and 32 bits, and of microseconds told as milliseconds and as seconds."""


def with_clocks(table: Table) -> Table:
    """The table with columns of dates, times of day and times since 1970 as seconds from the first row.

    A column is one if each of its cells is. A time of day that goes back by half a day has passed midnight.
    Where every clock falls, the newest row stands first, as databases write it: the rows are turned round.
    """
    columns, units, notes = dict(table.columns), dict(table.units), list(table.notes)
    stamps, ways = [], []
    for name, x in table.columns.items():
        unit = named_unit(name, None, table.units.get(name))
        counted = None if unit else _COUNTED.get(name.strip("() ").lower())
        if x.dtype.kind != "f":
            found = _stamps(x)
        else:
            found = None if unit or counted else _since_a_day(name, x)
        if found is not None:
            columns[name], was = found
            units[name] = "s"
            stamps.append(name)
            read = f"Column {name!r} holds {was}: read as seconds from the first row."
            notes.append(Note("clock", read))
        elif x.dtype.kind == "f" and kind_of(name, unit or "1").name == "time":
            columns[name] = _unwrapped(x)
            if counted:
                units[name] = counted
            if columns[name] is not x:
                read = f"Column {name!r} turned over: read as one that goes on."
                notes.append(Note("clock", read))
        else:
            continue
        ways.append(_way(columns[name]))
    found = replace(table, columns=columns, units=units, notes=tuple(notes))
    if -1 not in ways or 1 in ways:
        return found
    note = Note("clock", "The newest row stands first: read from the last one on.")
    turned = rows_of(found, np.arange(len(table.line))[::-1])
    columns = {name: x - x[0] if name in stamps else x for name, x in turned.columns.items()}
    return replace(turned, columns=columns, notes=(*notes, note), row=None)


def _way(x: np.ndarray) -> int:
    """1 where a clock rises somewhere, -1 where it falls all along, of three rows and more, 0 of others."""
    step = np.diff(x[np.isfinite(x)])
    return 1 if (step > 0).any() else -1 if (step < 0).sum() > 1 else 0


def _stamps(cells: np.ndarray) -> tuple[np.ndarray, str] | None:
    """Seconds from the first row, NaN where a cell is empty, and what the column held; None where a cell is
    neither date nor time.

    Behind a date hours and minutes are enough; without one these may be minutes and seconds, which they are
    if some cell has a fraction. A spreadsheet's minutes begin again after an hour.
    """
    filled = np.flatnonzero(cells != "")
    if len(filled) < 2 or ":" not in cells[filled[0]] + cells[filled[-1]]:
        return None
    # A workbook writes midnight as the date alone.
    words = [word if ":" in word else f"{word}T00:00" for word in cells[filled].tolist()]
    found = [_STAMP.fullmatch(word) for word in words]
    parts = [one.groupdict("") for one in found if one is not None]
    dated, whole, fine = ([bool(one[key]) for one in parts] for key in "asf")
    minutes = not (any(dated) or any(whole))
    alone = any(fine) if minutes else all(whole) and not any(dated)
    if len(parts) < len(filled) or not (alone or all(dated)):
        return None
    seconds = np.array([_seconds(one) for one in parts]) / (60 if minutes else 1)
    if any(dated):
        try:
            seconds += _days(parts)
        except ValueError:  # no calendar has these dates
            return None
    else:
        turn = 3600 if minutes else DAY
        seconds += turn * np.cumsum(np.diff(seconds, prepend=seconds[0]) < -turn / 2)
    times = np.full(len(cells), np.nan)
    times[filled] = np.round(seconds - seconds[0], 9)
    said = "minutes and seconds" if minutes else "dates or times of day"
    return (times, said) if np.ptp(seconds) > 0 else None


def _seconds(one: dict[str, str]) -> float:
    hours, fraction = int(one["h"]), float(f"0.{one['f']}")
    if one["half"]:
        hours = hours % 12 + 12 * (one["half"] in "pP")
    if not one["s"]:  # of minutes and seconds a sixtieth is meant
        fraction *= 60
    zone = one["zone"] if one["zone"] not in ("Z", "UTC") else ""
    off = int(f"{zone[:1]}1") * (60 * int(zone[1:3]) + int(zone[-2:])) if zone else 0
    return 3600.0 * hours + 60 * (int(one["m"]) - off) + int(one["s"] or 0) + fraction


def _days(parts: Sequence[dict[str, str]]) -> np.ndarray:
    """Seconds of days from the first one; of two readings of a date the one that goes on, and then the
    shorter one. Raises `ValueError` where no calendar has them."""
    first = parts[0]
    orders = (
        ["abc"] if len(first["a"]) == 4 else ["cba", "cab"] if first["sign"] == "/" else ["cba"]
    )
    found: list[np.ndarray] = []
    for order in orders:
        try:
            days = [date(*(_calendar(one[key]) for key in order)).toordinal() for one in parts]
        except ValueError:  # there is no month 13
            continue
        found.append(np.array(days, float) - days[0])
    return DAY * min(found, key=lambda days: (bool((np.diff(days) < 0).any()), np.ptp(days)))


def _calendar(word: str) -> int:
    """A year, a month or a day; MATLAB writes Mar. Raises `ValueError` where it is neither."""
    return int(word) if word.isdecimal() else _MONTHS.index(word.capitalize()) + 1


def _unwrapped(x: np.ndarray) -> np.ndarray:
    """A counter of 16 or 32 bits that has turned over, as one that goes on."""
    good = np.flatnonzero(np.isfinite(x))
    step = np.diff(x[good], prepend=x[good[:1]])
    back, usual = step < 0, np.median(np.abs(step)) if step.size else 0.0
    for size in _TURNS if back.any() else ():
        turned = back & (step + size > 0) & (step + size <= SEVERAL * usual)
        if (turned == back).all():
            x = x.copy()
            x[good] += size * np.cumsum(turned)
    return x


def _since_a_day(name: str, x: np.ndarray) -> tuple[np.ndarray, str] | None:
    """A clock whose values are those of the years from 2001 to 2033 since 1970; or in days since 1900,
    where it is named a date, or moves by less than one: a clock in seconds may pass through such values."""
    good = np.isfinite(x)
    dated = _DATED.search(name)
    if not (dated or kind_of(name, "1").name == "time") or good.sum() < 2:
        return None
    low, high = float(x[good].min()), float(x[good].max())
    step = next((s for least, s in _SINCE_1970.items() if least <= low < high < 2 * least), None)
    was = "times since 1970"
    in_days = _DAYS_SINCE_1900[0] <= low < high < _DAYS_SINCE_1900[1]
    if in_days and (dated or high - low < 1):
        step, was = DAY, "days since 1900"
    return None if step is None else (np.round((x - x[good][0]) * step, 9), was)
