"""The cells of a workbook as JSON: a program of its own, which `_excel` starts with little memory.

A reader makes room for all cells between the first and the last, and for a text that is stored once as
often as it is used: a workbook of 9 kB may span 17 thousand million cells. What a file asks for is not
known before it is read, so it is read where memory has an end.

    python _workbook_cells.py MEMORY CHARACTERS < workbook > {sheet: [[row number, [cell, ...]], ...]}
"""

import contextlib
import io
import json
import sys
from datetime import date, datetime, time, timedelta
from typing import Any


def main(memory: int, limit: int) -> dict[str, list[tuple[int, list[str]]]]:
    """The rows that are not empty of each sheet, at most so many characters in all."""
    with contextlib.suppress(ImportError, ValueError):
        import resource  # Windows has none

        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    from python_calamine import CalamineWorkbook

    book = CalamineWorkbook.from_filelike(io.BytesIO(sys.stdin.buffer.read()))
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
    return sheets


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


if __name__ == "__main__":
    try:
        json.dump(main(*map(int, sys.argv[1:])), sys.stdout)
    except MemoryError:
        sys.exit(2)
    except BaseException as error:  # a panic of Rust is no Exception
        sys.exit(f"{error}" or type(error).__name__)
