"""How many cells a workbook spans: readers keep a place for each between the first cell and the last."""

import re
import zipfile

from ..._limits import check_packed

MOST_EMPTY = 5_000_000
"""Cells that a workbook may span; more have to be written in it, one by one."""

_PLACE = re.compile(rb"""\sr\s*=\s*["']([A-Za-z]*)([0-9]+)["']""")
_REPEATED_ROW = re.compile(rb'<table:table-row[^<>]*?number-rows-repeated="([0-9]+)"')
_REPEATED_CELL = re.compile(
    rb'<table:(?:covered-)?table-cell(?=[^<>]*value-type)[^<>]*?number-columns-repeated="([0-9]+)"'
)


def check_workbook(archive: zipfile.ZipFile) -> None:
    """Raise `ValueError` for a workbook that unpacks to more, or spans more, than its size explains."""
    check_packed(archive)
    for member in archive.infolist():
        most = MOST_EMPTY + member.file_size
        spanned = 0
        if re.fullmatch(r"xl/worksheets/[^/]*\.xml", member.filename):
            spanned = _spanned(archive.read(member))
        elif member.filename == "content.xml":
            spanned = _repeated(archive.read(member))
        if spanned > most:
            raise ValueError(
                f"{member.filename} spans {spanned:,} cells, and the limit is {most:,}"
            )


def _spanned(sheet: bytes) -> int:
    """Rows times columns up to the last cell of an Excel sheet."""
    rows = columns = 0
    for found in _PLACE.finditer(sheet):
        column = 0
        for letter in found[1].upper()[:9]:
            column = 26 * column + letter - 64
        rows, columns = max(rows, int(found[2])), max(columns, column)
    return rows * columns


def _repeated(content: bytes) -> int:
    """Cells with a value of an OpenDocument table, each as often as it is repeated."""
    total = 0
    for row in content.split(b"</table:table-row>"):
        again = max([1, *(int(found[1]) for found in _REPEATED_ROW.finditer(row))])
        total += again * sum(int(found[1]) for found in _REPEATED_CELL.finditer(row))
    return total
