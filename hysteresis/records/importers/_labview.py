"""LabVIEW measurement files (.lvm): a header of keys, then segments, each with a header of its own.

The file's header names the separator, the decimal sign and what stands for the clock: `X_Columns` No (a
step `Delta_X` from `X0`), One (one column for all channels) or Multi (one for each). Segments that follow
one another are put under one another and told apart by a column. Format: NI, "Specification for the
LabVIEW Measurement File (.lvm)", tutorial 4139.
"""

import re
from pathlib import Path

import numpy as np

from .._cells import floats
from ._blocks import Block, padded, sheet_of
from ._dialects import OTHER
from ._file import fault
from ._sheet import Sheet, distinct, is_number

MARK, CLOCK = "LabVIEW Measurement", "X_Value"
_END = "***End_of_Header***"


def labview(path: Path, text: str) -> Sheet | None:
    """The table of a LabVIEW measurement file, or None where it is none.

    Raises `InputError` `damaged-file` where its headers do not end, `no-rows` without a row.
    """
    if not text.startswith(MARK):
        return None
    lines = re.split(r"\r\n|\r|\n", text)
    separator = "," if any(re.match(r"Separator,Comma\b", x) for x in lines[:20]) else "\t"
    rows = [(k, [c.strip() for c in line.split(separator)]) for k, line in enumerate(lines, 1)]
    rows = [(k, row) for k, row in rows if any(row)]
    ends = [at for at, (_, row) in enumerate(rows) if row[0] == _END]
    if not ends:
        raise fault("damaged-file", path, f"{_END} is missing.", "export the file again.")
    about = {row[0]: row[1:] for _, row in rows[: ends[0]]}
    decimal = "," if about.get("Decimal_Separator", [])[:1] == [","] else "."
    found: list[Block] = []
    begin = ends[0]
    for number, end in enumerate(ends[1:] or ends, 1):
        about |= {row[0]: row[1:] for _, row in rows[begin:end]}
        inside = range(end + 1, len(rows))
        begin = next((at for at in inside if rows[at][1][0] in ("Channels", _END)), len(rows))
        if block := _block(rows[end + 1 : begin], about, decimal, str(number)):
            found.append(block)
    dialect = OTHER._replace(name="a LabVIEW measurement file", column="segment", decimal=decimal)
    if (sheet := sheet_of(found, dialect, decimal)) is None:
        raise fault("no-rows", path, "headers and no rows.")
    return sheet


def _block(
    rows: list[tuple[int, list[str]]], about: dict[str, list[str]], decimal: str, number: str
) -> Block | None:
    """One segment, None where it has no rows; `about` holds its header, or that of the file."""
    width = max((len(row) for _, row in rows), default=0)
    names = [CLOCK, *(f"channel {k}" for k in range(1, width))]
    if rows and not any(map(is_number, rows[0][1])):
        (_, names), *rows = rows
    if not rows:
        return None
    clocks = [k for k, name in enumerate(names) if name == CLOCK]
    channels = [k for k, name in enumerate(names) if name not in (CLOCK, "Comment", "")]
    labels = [x for x in about.get("Y_Unit_Label", []) if x]
    labels = labels if len(labels) == len(channels) else [""] * len(channels)
    known = zip(channels, distinct([names[k] for k in channels]), labels, strict=True)
    cells = list(zip(*(padded(row, len(names)) for _, row in rows), strict=True))
    seconds = "s" if "Time" in about.get("X_Dimension", ["Time"]) else ""
    found: list[tuple[str, str, tuple[str, ...]]] = []  # name, unit and cells of each column
    if about.get("X_Columns", [])[:1] == ["No"] or not clocks or not any(cells[clocks[0]]):
        start, step = (_first(about.get(key, []), decimal) for key in ("X0", "Delta_X"))
        x = (start or 0.0) + (step or 1.0) * np.arange(len(rows))
        found.append((CLOCK, seconds, tuple(f"{v:.12g}".replace(".", decimal) for v in x)))
        clocks = []
    elif len({cells[k] for k in clocks}) == 1:
        found.append((CLOCK, seconds, cells[clocks[0]]))
        clocks = []
    for k, name, unit in known:
        # Of several clocks each channel has the one before it.
        found += [(f"{CLOCK} {name}", "s", cells[c]) for c in clocks if c < k][-1:]
        found.append((name, unit, cells[k]))
    header, units, columns = zip(*found, strict=True)
    table = [list(row) for row in zip(*columns, strict=True)]
    return Block(header, units, table, [k for k, _ in rows], [[number]], [])


def _first(cells: list[str], decimal: str) -> float | None:
    known = floats(cells, decimal) if cells else np.zeros(0)
    return next(iter(known[~np.isnan(known)].tolist()), None)
