"""How many cells a workbook spans: readers keep a place for each between the first cell and the last."""

import io
import re
import zipfile

from ..._limits import check_packed, unpacked
from .._cells import MOST_TEXT
from ._binary_workbook import (
    Extent,
    extents_of_binary,
    extents_of_old,
    old_stream,
    shared_of_binary,
    shared_of_old,
)

MOST_EMPTY = 5_000_000
"""Cells that the sheets of a workbook may span, beyond twice those that are written in them."""

_ITEM, _SHARED = (
    re.compile(rb"<(?:\w+:)?si(?=[\s>]).*?</(?:\w+:)?si>", re.DOTALL),
    re.compile(
        rb"""<(?:\w+:)?c\s[^<>]*\bt\s*=\s*["']s["'][^<>]*>\s*<(?:\w+:)?v>\s*([0-9]{1,9})\s*<"""
    ),
)

_PLACE = re.compile(rb"""\sr\s*=\s*["']([A-Za-z]*)([0-9]+)["']""")
_ROW, _CELL = re.compile(rb"<(?:\w+:)?row(?=[\s/>])"), re.compile(rb"<(?:\w+:)?c(?=[\s/>])")
_REPEATED_ROW = re.compile(rb'<table:table-row[^<>]*?number-rows-repeated="([0-9]+)"')
_VALUE = re.compile(
    rb'<table:(?:covered-)?table-cell(?=[^<>]*value-type)(?:[^<>]*?columns-repeated="([0-9]+)")?'
    rb"(.*?)(?=<table:|</table:|$)",
    re.DOTALL,
)


def check_workbook(data: bytes) -> None:
    """Raise `ValueError` for a workbook that unpacks to more, or spans more, than its size explains."""
    if not data.startswith(b"PK"):
        stream = old_stream(data)
        _check_extents(extents_of_old(stream))
        _check_shared(*shared_of_old(stream))
        return
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        check_packed(archive)
        # Any part may be a sheet: the workbook's list of them names it.
        extents, lengths, used = [], [], []
        for name in archive.namelist():
            if name != "content.xml":
                part = unpacked(archive, name)
                extents.append(_extent(part))
                lengths += [len(found[0]) for found in _ITEM.finditer(part)]
                used += [int(k) for k in _SHARED.findall(part)]
        _check_extents(extents)
        _check_shared(lengths, used)
        _check_extents(extents_of_binary(archive))
        _check_shared(*shared_of_binary(archive))
        for member in archive.infolist():
            if member.filename == "content.xml":
                cells, text = _repeated(unpacked(archive, member.filename))
                _check(cells, MOST_EMPTY + member.file_size)
                _check_text(text - member.file_size)


def _check_extents(extents: list[Extent]) -> None:
    spanned = sum(one.rows * one.columns for one in extents)
    _check(spanned, MOST_EMPTY + 2 * sum(one.cells for one in extents))


def _check(spanned: int, most: int) -> None:
    if spanned > most:
        raise ValueError(f"its sheets span {spanned:,} cells, and the limit is {most:,}")


def _check_shared(lengths: list[int], used: list[int]) -> None:
    """A text that many cells share is stored once, and read as often as it is used."""
    _check_text(sum(lengths[k] for k in used if k < len(lengths)))


def _check_text(held: int) -> None:
    if held > MOST_TEXT:
        raise ValueError(f"its cells hold {held:,} characters, and the limit is {MOST_TEXT:,}")


def _extent(sheet: bytes) -> Extent:
    """Of a sheet of .xlsx. Cells and rows without a place are behind the one before."""
    rows = columns = cells = 0
    for found in _PLACE.finditer(sheet):
        column = 0
        for letter in found[1].upper()[:9]:
            column = 26 * column + letter - 64
        cells += column > 0
        rows, columns = max(rows, int(found[2][:12])), max(columns, column)
    begun = _ROW.split(sheet)
    each = [len(_CELL.findall(row)) for row in begun[1:]]
    return Extent(max(rows, len(each)), max([columns, *each]) if rows else 0, max(cells, sum(each)))


def _repeated(content: bytes) -> tuple[int, int]:
    """Cells with a value of an OpenDocument table and their bytes, each as often as it is repeated."""
    cells = text = 0
    for row in content.split(b"</table:table-row>"):
        again = max([1, *(int(found[1]) for found in _REPEATED_ROW.finditer(row))])
        for found in _VALUE.finditer(row):
            count = again * int(found[1] or 1)
            cells, text = cells + count, text + count * len(found[2])
    return cells, text
