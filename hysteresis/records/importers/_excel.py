"""Excel workbooks (.xlsx) through openpyxl (an extra: pip install 'hysid[rigs]')."""

import io
import zipfile
from datetime import datetime, time
from pathlib import Path
from typing import Any

from ._blocks import Block, blocks, sheet_of
from ._dialects import OTHER
from ._file import fault
from ._sheet import Sheet

MARK = b"PK\x03\x04"


def workbook(path: Path, data: bytes) -> Sheet | None:
    """The table of a workbook, or None where the file is none.

    Sheets with the same header are put under one another and told apart by the column "sheet"; of others
    the one with most rows is meant. Values are those that Excel last computed.

    Raises `InputError` `missing-extra` without openpyxl, `binary-file` for other ZIP files, `no-rows`.
    """
    if data[:4] != MARK or not zipfile.is_zipfile(io.BytesIO(data)):
        return None
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        if "xl/workbook.xml" not in archive.namelist():
            return None
    try:
        from openpyxl import load_workbook
    except ImportError:
        raise fault(
            "missing-extra", path, "workbooks are read by openpyxl, which is not installed.",
            "pip install 'hysid[rigs]', or export the sheet as CSV.",
        ) from None  # fmt: skip
    try:
        book = load_workbook(io.BytesIO(data), read_only=True, data_only=True)
        sheets = {
            sheet.title: [[_cell(v) for v in row] for row in sheet.iter_rows(values_only=True)]
            for sheet in book.worksheets
        }
    except Exception as error:  # openpyxl raises what it meets: KeyError, ParseError, BadZipFile
        raise fault("binary-file", path, f"this workbook is damaged: {error}.") from None
    found: list[Block] = []
    for title, rows in sheets.items():
        numbered = [(k, row) for k, row in enumerate(rows, 1) if any(row)]
        pieces = blocks(numbered)
        found += [b._replace(above=[[title]] if len(pieces) == 1 else [[f"{title} {k}"]])
                  for k, b in enumerate(pieces, 1)]  # fmt: skip
    sheet = sheet_of(found, OTHER._replace(name="a workbook", column="sheet"))
    if sheet is None:
        raise fault("no-rows", path, "no sheet holds a table: a header and rows of numbers.")
    return sheet


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, datetime | time):
        return value.isoformat()
    return " ".join(str(value).split())
