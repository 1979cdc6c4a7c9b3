"""Universal files (UFF, .unv): data sets 58, functions of one channel each, as one table.

A data set stands between two lines of -1. Eleven lines at its head say what kind of function it is, how its
values are written, and what its axes are. Format: SDRC I-DEAS, "Universal Dataset Number 58: Function at
Nodal DOF"; 58b has its values in binary.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..._note import Note
from ._sheet import Sheet, chosen_table, distinct

_HEAD = 12
"""Lines of a data set 58 before its values, the one with its number included."""
_EDGE = re.compile(rb"^[ \t]*-1[ \t]*\r?(?:\n|\Z)", re.MULTILINE)
BEGINS = re.compile(rb"\A\s*-1[ \t]*\r?\n\s*\d+b?\b")
_OVER_TIME, _TIME, _UNKNOWN = 1, 17, 0
"""A function over time, and the kinds of an abscissa that such a function has."""
_BYTES = {2: 4, 4: 8}
"""Bytes of a real number, by its type; others are complex, as those of a spectrum are."""
_EMPTY = ("", "NONE")


class _Record(NamedTuple):
    """A channel over time: name, units of values and clock, times and values (n,)."""

    name: str
    unit: str
    clock_unit: str
    x: np.ndarray
    y: np.ndarray


def universal_file(path: Path, data: bytes, table: int | None = None) -> Sheet | None:
    """The table of a universal file, None without a channel over time.

    Channels over time with one clock are columns beside "time". Of several clocks the one with most
    channels is meant, or `table`.
    """
    found = [_record(head, body) for head, body in _data_sets(data)]
    if not any(found):
        return None
    families: dict[tuple, list[_Record]] = {}
    for one in found:
        if one is not None:
            clock = len(one.x), float(one.x[0]), float(one.x[-1])
            families.setdefault(clock, []).append(one)
    listed = list(families.values())
    kept = listed[chosen_table([*map(len, listed)], table)]
    names = distinct([one.name for one in kept], ["time"])
    notes = [Note("format", f"Read as a UFF file: {len(kept)} data sets 58.")]
    if left := len(found) - len(kept):
        notes.append(Note("skipped", f"Left out {left} data sets of another kind or clock."))
    columns = {"time": kept[0].x} | dict(zip(names, (one.y for one in kept), strict=True))
    units = {"time": kept[0].clock_unit} | dict(zip(names, (one.unit for one in kept), strict=True))
    return Sheet(columns, np.arange(1, len(kept[0].x) + 1), units, tuple(notes))


def _data_sets(data: bytes) -> Iterator[tuple[list[str], bytes]]:
    """The head's lines and the bytes of the values of each data set 58."""
    at = 0
    while (begin := _EDGE.search(data, at)) is not None:
        end = begin.end()
        for _ in range(_HEAD):
            end = data.find(b"\n", end) + 1 or len(data)
        head = data[begin.end() : end].decode("latin-1").splitlines()
        kind = head[0].split()[:1] if head else []
        size = int(head[0][31:43]) if kind == ["58b"] else 0
        close = _EDGE.search(data, end + size if kind in (["58"], ["58b"]) else begin.end())
        stop = len(data) if close is None else close.start()
        if kind in (["58"], ["58b"]) and len(head) == _HEAD:
            yield head, data[end : end + size] if size else data[end:stop]
        at = len(data) if close is None else close.end()


def _record(head: list[str], body: bytes) -> _Record | None:
    """A channel over time, None of any other function. Raises `ValueError` where head and values differ."""
    number, clock, ordinate = head[7].split(), head[8], head[9]
    kind, count, even = (int(word) for word in number[:3])
    over_time = int(head[6][:5]) == _OVER_TIME and int(clock[:10]) in (_TIME, _UNKNOWN)
    if not over_time or kind not in _BYTES:
        return None
    if head[0].split()[0] == "58b":
        order = "<" if int(head[0][7:13]) == 1 else ">"
        wide = f"{order}f{_BYTES[kind]}"
        if even:
            values = np.frombuffer(body, wide).astype(float)
        else:  # times are always numbers of four bytes
            both = np.frombuffer(body, [("x", f"{order}f4"), ("y", wide)])
            values = np.stack([both["x"], both["y"]], axis=1).astype(float).ravel()
    else:
        values = _numbers(body.decode("latin-1"), 13 if kind == 2 else 20)
    wanted = count if even else 2 * count
    if count < 2 or len(values) < wanted:
        raise ValueError(f"a channel of {count:,} values has {len(values):,} numbers")
    if even:
        start, step = (float(word.replace("D", "E")) for word in number[3:5])
        x, y = start + step * np.arange(count), values[:count]
    else:
        x, y = values[:wanted:2], values[1:wanted:2]
    said = [head[6][31:41].strip(), *(line.strip() for line in (*head[1:3], *head[4:6]))]
    name = next((word for word in said if word not in _EMPTY), "")
    return _Record(name, _unit(ordinate), _unit(clock) or "s", x, y)


def _numbers(text: str, width: int) -> np.ndarray:
    """Numbers between blanks, or, where they touch one another, in fields of one width."""
    text = text.replace("D", "E")
    try:
        return np.array(text.split(), float)
    except ValueError:
        lines = [line.rstrip() for line in text.splitlines()]
        fields = [s[k : k + width] for s in lines for k in range(0, len(s), width)]
        return np.array(fields, float)


def _unit(axis: str) -> str:
    """The unit of an axis, which stands behind its label."""
    word = axis[47:67].strip()
    return "" if word in _EMPTY else word
