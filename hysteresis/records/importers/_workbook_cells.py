"""The cells of a workbook as JSON: a program of its own, which `_binary` starts by `_apart`.

A reader makes room for all cells between the first and the last, and for a text that is stored once as
often as it is used.
"""

import io
import json
from datetime import date, datetime, time, timedelta
from typing import Any


def read(file: bytes, limit: int) -> bytes:
    """The rows that are not empty of each sheet, at most so many characters in all."""
    from python_calamine import CalamineWorkbook

    book = CalamineWorkbook.from_filelike(io.BytesIO(file))
    sheets: dict[str, list[tuple[int, list[str]]]] = {}
    held = 0
    for name in book.sheet_names:
        rows = sheets.setdefault(name, [])
        for k, row in enumerate(book.get_sheet_by_name(name).to_python(False), 1):
            if row.count("") == len(row):
                continue
            cells = [_cell(value) for value in row]
            held += sum(map(len, cells))
            if held > limit:
                raise ValueError(f"its cells hold more than {limit:,} characters")
            if any(cells):
                rows.append((k, cells))
    return json.dumps(sheets).encode()


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return str(value)
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    if isinstance(value, datetime | date | time):
        return value.isoformat()
    if isinstance(value, timedelta):
        return repr(value.total_seconds())
    return " ".join(str(value).split())
