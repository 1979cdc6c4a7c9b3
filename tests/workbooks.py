"""Small workbooks of the binary kinds, byte by byte: no library that writes them is needed."""

import io
import struct
import zipfile
from collections.abc import Iterable

Cell = tuple[int, int, float | str]
"""Row and column, from 0, and what is there."""


def old_workbook(cells: Iterable[Cell], declared: tuple[int, int] | None = None) -> bytes:
    """A .xls file of one sheet: BIFF8 records in a compound file. `declared`: rows and columns."""
    begin = _old(0x0809, struct.pack("<HHHHII", 0x0600, 0x0005, 0, 0, 0, 0))
    sheet = _old(0x0809, struct.pack("<HHHHII", 0x0600, 0x0010, 0, 0, 0, 0))
    if declared:
        sheet += _old(0x0200, struct.pack("<IIHHH", 0, declared[0], 0, declared[1], 0))
    for row, column, value in cells:
        at = struct.pack("<HHH", row, column, 0)
        if isinstance(value, str):
            sheet += _old(0x0204, at + struct.pack("<HB", len(value), 0) + value.encode("latin-1"))
        else:
            sheet += _old(0x0203, at + struct.pack("<d", value))
    sheet += _old(0x000A)
    name = _old(0x0085, struct.pack("<IBBBB", 0, 0, 0, 1, 0) + b"s")
    place = len(begin) + len(name) + 4
    name = name[:4] + struct.pack("<I", place) + name[8:]
    stream = (begin + name + _old(0x000A) + sheet).ljust(4096, b"\0")
    return _compound(stream)


def _old(kind: int, content: bytes = b"") -> bytes:
    return struct.pack("<HH", kind, len(content)) + content


def _compound(stream: bytes) -> bytes:
    """A compound file of one stream "Workbook", of 4096 bytes at least: its table, directory, and it."""
    sectors = -(-len(stream) // 512)
    tables = -(-(sectors + 1) // 127)
    free, end, first = 0xFFFFFFFF, 0xFFFFFFFE, tables + 1
    after = [*[0xFFFFFFFD] * tables, end, *range(first + 1, first + sectors), end]
    table = struct.pack(f"<{128 * tables}I", *after, *[free] * (128 * tables - len(after)))
    entries = [("Root Entry", 5, 1, end, 0), ("Workbook", 2, free, first, len(stream))]
    directory = b"".join(
        name.encode("utf-16-le").ljust(64, b"\0")
        + struct.pack("<HBBIII", 2 * len(name) + 2, kind, 1, free, free, child)
        + bytes(36)
        + struct.pack("<IQ", first, size)
        for name, kind, child, first, size in entries
    )
    head = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(16)
    numbers = (0x3E, 3, 0xFFFE, 9, 6, 0, tables, tables, 0, 4096, end, 0, end, 0)
    head += struct.pack("<HHHHH6xIIIIIIIII", *numbers)
    head += struct.pack("<109I", *range(tables), *[free] * (109 - tables))
    return head + table + directory.ljust(512, b"\0") + stream.ljust(512 * sectors, b"\0")


def binary_workbook(cells: Iterable[Cell], declared: tuple[int, int] = (1, 1)) -> bytes:
    """A .xlsb file of one sheet: BIFF12 records in a ZIP archive. `declared`: rows and columns."""
    extent = struct.pack("<IIII", 0, declared[0] - 1, 0, declared[1] - 1)
    sheet = _new(129) + _new(148, extent) + _new(145)
    before = -1
    for row, column, value in cells:
        if row != before:
            sheet += _new(0, struct.pack("<I", row) + bytes(13))
            before = row
        at = struct.pack("<II", column, 0)
        if isinstance(value, str):
            sheet += _new(6, at + _text(value))
        else:
            sheet += _new(5, at + struct.pack("<d", value))
    sheet += _new(146) + _new(130)
    bundle = _new(156, struct.pack("<II", 0, 1) + _text("rId1") + _text("s"))
    relations = (
        '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
        '<Relationship Id="rId1" Type="http://schemas.openxmlformats.org/officeDocument/2006/'
        'relationships/worksheet" Target="worksheets/sheet1.bin"/></Relationships>'
    )
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/workbook.bin", _new(131) + _new(143) + bundle + _new(144) + _new(132))
        archive.writestr("xl/_rels/workbook.bin.rels", relations)
        archive.writestr("xl/worksheets/sheet1.bin", sheet)
    return packed.getvalue()


def _new(kind: int, content: bytes = b"") -> bytes:
    begun = bytes([kind]) if kind < 128 else bytes([kind & 0x7F | 0x80, kind >> 7])
    size, rest = b"", len(content)
    while True:
        size += bytes([rest & 0x7F | (0x80 if rest > 0x7F else 0)])
        if not (rest := rest >> 7):
            return begun + size + content


def _text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode("utf-16-le")
