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
from ._blocks import Block, sheet_of
from ._dialects import OTHER
from ._file import fault
from ._sheet import Sheet, distinct, is_number

MARK = "LabVIEW Measurement"
_END = "***End_of_Header***"
_KEYS = ("Channels", "Samples", "Date", "Time", "X_Dimension", "X0", "Delta_X", "Y_Unit_Label",
         "Y_Dimension", "X_Unit_Label", "Test_Name", "Notes")  # fmt: skip


def labview(path: Path, text: str) -> Sheet | None:
    """The table of a LabVIEW measurement file, or None where it is none.

    Raises `InputError` `damaged-file` where its headers do not end, `no-rows` without a row.
    """
    if not text.startswith(MARK):
        return None
    lines = re.split(r"\r\n|\r|\n", text)
    comma = any(re.fullmatch(r"Separator,Comma\W*", x) for x in lines[:20])
    separator = "," if comma else "\t"
    rows = [[cell.strip() for cell in line.split(separator)] for line in lines]
    ends = [k for k, row in enumerate(rows) if row[0] == _END]
    if not ends:
        raise fault("damaged-file", path, f"{_END} is missing.", "export the file again.")
    said = {row[0]: row[1] for row in rows[: ends[0]] if len(row) > 1}
    decimal = "," if said.get("Decimal_Separator") == "," else "."
    found: list[Block] = []
    for number, end in enumerate(ends[1:] or ends, 1):
        stop = next((k for k in range(end + 1, len(rows)) if rows[k][0] == "Channels"), len(rows))
        about = {row[0]: row[1:] for row in rows[_start(rows, end) : end] if row[0] in _KEYS}
        body = [(k + 1, rows[k]) for k in range(end + 1, stop) if any(rows[k])]
        body = [(k, row) for k, row in body if row[0] != _END and row[0] not in _KEYS]
        width = max((len(row) for _, row in body), default=0)
        header = ["X_Value", *(f"channel {k}" for k in range(1, width))]
        if body and not any(map(is_number, body[0][1])):
            header, body = body[0][1], body[1:]
        if not body:
            continue
        part, units = _segment(header, [r for _, r in body], about, said, decimal)
        cells = [list(row) for row in zip(*part.values(), strict=True)]
        line, own = [k for k, _ in body], tuple(units.get(name, "") for name in part)
        found.append(Block(tuple(part), own, cells, line, [[str(number)]], []))
    dialect = OTHER._replace(name="a LabVIEW measurement file", column="segment", decimal=decimal)
    if (sheet := sheet_of(found, dialect, decimal)) is None:
        raise fault("no-rows", path, "headers and no rows.")
    return sheet


def _start(rows: list[list[str]], end: int) -> int:
    """Where the header that ends at `end` begins."""
    return next((k for k in range(end - 1, -1, -1) if rows[k][0] in ("Channels", MARK)), 0)


def _segment(
    header: list[str], rows: list[list[str]], about: dict, said: dict, decimal: str
) -> tuple[dict[str, list[str]], dict[str, str]]:
    """Columns of one segment, and their units."""
    kind = said.get("X_Columns", "One")
    width = len(header)
    rows = [[*row[:width], *[""] * (width - len(row))] for row in rows]
    kept = [k for k, name in enumerate(header) if name and name != "Comment"]
    clocks = [k for k in kept if header[k] == "X_Value"]
    channels = [k for k in kept if k not in clocks]
    labels = [x for x in about.get("Y_Unit_Label", []) if x]
    whole = len(labels) == len(channels)
    cells = {k: [row[k] for row in rows] for k in kept}
    columns: dict[str, list[str]] = {}
    units: dict[str, str] = {}
    if kind == "No" or not clocks or not any(cells[clocks[0]]):
        start, step = (_first(about.get(key, []), decimal) for key in ("X0", "Delta_X"))
        x = (start or 0.0) + (step or 1.0) * np.arange(len(rows))
        columns["X_Value"] = [f"{v:.12g}".replace(".", decimal) for v in x]
        clocks = []
    elif len({tuple(cells[k]) for k in clocks}) == 1:
        columns["X_Value"] = cells[clocks[0]]
        clocks = []
    if "X_Value" in columns and "Time" in about.get("X_Dimension", ["Time"]):
        units["X_Value"] = "s"
    for name, k in zip(distinct([header[k] for k in channels]), channels, strict=True):
        own = max((c for c in clocks if c < k), default=None)
        if own is not None:  # every channel has a clock of its own
            columns[f"X_Value {name}"] = cells[own]
            units[f"X_Value {name}"] = "s"
        columns[name] = cells[k]
        if whole:
            units[name] = labels[channels.index(k)]
    return columns, units


def _first(cells: list[str], decimal: str) -> float | None:
    known = floats(cells, decimal) if cells else np.zeros(0)
    return next(iter(known[~np.isnan(known)].tolist()), None)
