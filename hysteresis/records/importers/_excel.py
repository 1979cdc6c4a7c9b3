"""Spreadsheets (.xlsx, .xls, .xlsb, .ods) through python-calamine (an extra: pip install 'hysid[rigs]')."""

import io
import json
import zipfile
from pathlib import Path

from ..._limits import DAMAGE
from .._cells import MOST_TEXT
from ._apart import read_apart
from ._blocks import Block, blocks, nameless, sheet_of
from ._dialects import OTHER
from ._sheet import Sheet

_ZIP, _OLD = b"PK\x03\x04", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
_INSIDE = ("xl/workbook.xml", "xl/workbook.bin", "content.xml")


def workbook(path: Path, data: bytes, table: int | None = None) -> Sheet | None:
    """The table of a workbook, None where no sheet holds one.

    Sheets with the same header are put under one another and told apart by the column "sheet"; of others
    the one with most rows is meant, or `table`. Values are those that the spreadsheet last computed.
    """
    read = json.loads(read_apart("_workbook_cells", data, MOST_TEXT))
    numbered = {name: [(k, row) for k, row in rows] for name, rows in read.items()}
    found: list[Block] = []
    for title, rows in numbered.items():
        pieces = blocks(rows)
        found += [b._replace(above=[[title]] if len(pieces) == 1 else [[f"{title} {k}"]])
                  for k, b in enumerate(pieces, 1)]  # fmt: skip
    if not found:
        found = [b for rows in numbered.values() for b in nameless(rows, OTHER, "", "")]
    return sheet_of(found, OTHER._replace(name="a workbook", column="sheet"), table=table)


def is_workbook(data: bytes) -> bool:
    """Whether bytes are those of a workbook."""
    if data.startswith(_OLD):
        # Word and others are in the same container: the stream of a workbook has one of these names.
        return any(name.encode("utf-16-le") in data for name in ("Workbook", "Book"))
    if not data.startswith(_ZIP) or not zipfile.is_zipfile(io.BytesIO(data)):
        return False
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return bool({*_INSIDE} & {*archive.namelist()})
    except DAMAGE:
        return False
