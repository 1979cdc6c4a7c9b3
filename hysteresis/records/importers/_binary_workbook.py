"""Cells that binary workbooks span: sheets of .xls are BIFF8 records in a compound file, of .xlsb BIFF12.

Sources: Microsoft, MS-CFB (sectors and directory), MS-XLS (records), MS-XLSB (records).
"""

import re
import struct
import zipfile
from collections.abc import Iterator
from typing import NamedTuple

from ..._limits import unpacked

_FREE, _ENTRY = 0xFFFFFFFA, 128
"""Sector numbers from here on end a chain; bytes of an entry of the directory."""

# Records of .xls: cells with a value, several in a row, what a sheet declares, where a sheet is, its end.
_CELLS = {0x0006, 0x0203, 0x0204, 0x0205, 0x0207, 0x027E, 0x00FD, 0x00D6}
_SEVERAL, _OLD_EXTENT, _SHEET, _END = 0x00BD, 0x0200, 0x0085, 0x000A
# Shared texts, what goes on behind them, a cell with one of them.
_OLD_TEXTS, _MORE, _OLD_SHARED_CELL = 0x00FC, 0x003C, 0x00FD
OLD_ROWS, OLD_COLUMNS = 65_536, 256

# Records of .xlsb: a row, cells with a value, what a sheet declares.
_ROW, _FIRST, _LAST, _EXTENT, _SHARED_CELL, _TEXT = 0, 2, 11, 148, 7, 19
ROWS, COLUMNS = 1_048_576, 16_384


class Extent(NamedTuple):
    """Rows and columns up to the last cell of a sheet, and how many cells are written in it."""

    rows: int = 0
    columns: int = 0
    cells: int = 0

    def with_cell(self, row: int, column: int, count: int = 1) -> "Extent":
        """The same with a cell more, or several of a row up to a column."""
        return Extent(max(self.rows, row + 1), max(self.columns, column + 1), self.cells + count)


def old_stream(data: bytes) -> bytes:
    """The records of a .xls file. Raises `ValueError` or `struct.error` where it is damaged."""
    return _CompoundFile(data).stream(("Workbook", "Book"))


def extents_of_old(stream: bytes) -> list[Extent]:
    """Of each sheet of a .xls file, by its records. Raises `ValueError` or `struct.error`, too."""
    return [_old_extent(stream, at) for at in _old_sheets(stream)]


def shared_of_old(stream: bytes) -> tuple[list[int], list[int]]:
    """Characters of each shared text of a .xls file, and which of them each cell uses."""
    texts: list[bytes] = []
    for kind, part in _old_records(stream, 0):
        if kind == _OLD_TEXTS or (texts and kind == _MORE):
            texts.append(part[8:] if kind == _OLD_TEXTS else part)
        elif texts:
            break
    used = [
        struct.unpack_from("<I", part, 6)[0]
        for at in _old_sheets(stream)
        for kind, part in _old_records(stream, at)
        if kind == _OLD_SHARED_CELL and len(part) >= 10
    ]
    return [*_old_lengths(texts)], used


def _old_sheets(stream: bytes) -> list[int]:
    sheets = [struct.unpack_from("<I", part)[0] for kind, part in _old_records(stream, 0)
              if kind == _SHEET]  # fmt: skip
    if len({*sheets}) < len(sheets):
        raise ValueError("two sheets are at one place")
    return sheets


def _old_lengths(parts: list[bytes]) -> Iterator[int]:
    """Of texts in records that follow each other. A piece that goes on begins with its width anew."""
    following = iter(parts)
    rest = next(following, b"")
    while len(rest) >= 3 or len(rest := next(following, b"")) >= 3:
        count, flags = struct.unpack_from("<HB", rest)
        yield count
        behind, at = 0, 3  # fonts and readings of a text stand behind it
        if flags & 8:
            behind, at = 4 * struct.unpack_from("<H", rest, at)[0], at + 2
        if flags & 4:
            behind, at = behind + struct.unpack_from("<I", rest, at)[0], at + 4
        rest, wide = rest[at:], flags & 1
        while count > len(rest) >> wide:
            count -= len(rest) >> wide
            if not (rest := next(following, b"")):
                return
            rest, wide = rest[1:], rest[0] & 1
        rest = rest[count << wide :]
        while behind > len(rest):
            behind -= len(rest)
            if not (rest := next(following, b"")):
                return
        rest = rest[behind:]


def _old_extent(stream: bytes, at: int) -> Extent:
    found = Extent()
    for kind, part in _old_records(stream, at):
        if kind in _CELLS:
            found = found.with_cell(*struct.unpack_from("<HH", part))
        elif kind == _SEVERAL:
            row, column = struct.unpack_from("<HH", part)
            # Readers go by the size of the record.
            count = max((len(part) - 6) // 6, 1)
            last = struct.unpack_from("<H", part, len(part) - 2)[0]
            found = found.with_cell(row, max(column + count - 1, last), count)
        elif kind == _OLD_EXTENT:
            form = "<IIHH" if len(part) >= 12 else "<HHHH"
            first, rows, begin, columns = struct.unpack_from(form, part)
            _check_declared(max(first, rows), max(begin, columns), OLD_ROWS, OLD_COLUMNS)
    return found


def _check_declared(rows: int, columns: int, most_rows: int, most_columns: int) -> None:
    """Readers make room for what a sheet declares."""
    if rows > most_rows or columns > most_columns:
        raise ValueError(f"a sheet declares {rows:,} rows and {columns:,} columns")


def _old_records(stream: bytes, at: int) -> Iterator[tuple[int, bytes]]:
    """Kinds and contents of records, up to the end of a sheet."""
    while at + 4 <= len(stream):
        kind, size = struct.unpack_from("<HH", stream, at)
        yield kind, stream[at + 4 : at + 4 + size]
        if kind == _END:
            return
        at += 4 + size


class _CompoundFile:
    """The streams of a compound file."""

    def __init__(self, data: bytes):
        shift, small_shift = struct.unpack_from("<HH", data, 0x1E)
        if shift not in (9, 12) or small_shift != 6:
            raise ValueError("its sectors have a size that no program writes")
        self._data, self._size, self._small_size = data, 1 << shift, 1 << small_shift
        (first_entry,) = struct.unpack_from("<I", data, 0x30)
        self._least, first_small, _, first_more, more = struct.unpack_from("<IIIII", data, 0x38)
        tables = [*struct.unpack_from("<109I", data, 0x4C)]
        for _ in range(min(more, len(data) // self._size)):
            if first_more >= _FREE:
                break
            *listed, first_more = self._numbers(self._sector(first_more))
            tables += listed
        self._next = [n for table in tables if table < _FREE
                      for n in self._numbers(self._sector(table))]  # fmt: skip
        directory = self._chain(first_entry)
        self._entries = [directory[k : k + _ENTRY] for k in range(0, len(directory), _ENTRY)]
        self._next_small = self._numbers(self._chain(first_small))

    def stream(self, names: tuple[str, ...]) -> bytes:
        """The first stream with the first of these names that there is."""
        for name in names:
            for entry in self._entries:
                if self._name(entry) == name:
                    return self._content(entry)
        raise ValueError("it holds no workbook")

    def _name(self, entry: bytes) -> str:
        if len(entry) < _ENTRY:
            return ""
        return entry[:64].decode("utf-16-le", "replace").partition("\0")[0]

    def _content(self, entry: bytes) -> bytes:
        first, size = struct.unpack_from("<II", entry, 0x74)
        if size >= self._least:
            return self._chain(first)[:size]
        (place,) = struct.unpack_from("<I", self._entries[0], 0x74)
        small, parts = self._chain(place), []
        for n in self._followed(first, self._next_small):
            parts.append(small[n * self._small_size : (n + 1) * self._small_size])
        return b"".join(parts)[:size]

    def _chain(self, first: int) -> bytes:
        return b"".join(self._sector(n) for n in self._followed(first, self._next))

    def _followed(self, n: int, after: list[int]) -> Iterator[int]:
        for _ in range(len(after)):
            if n >= _FREE:
                return
            yield n
            n = after[n]
        if n < _FREE:
            raise ValueError("a chain of sectors never ends")

    def _sector(self, n: int) -> bytes:
        # A larger sector pushes the header's end out to its own size.
        begin = (n + 1) * self._size
        if begin >= len(self._data):
            raise ValueError(f"sector {n} is beyond the end")
        return self._data[begin : begin + self._size]

    @staticmethod
    def _numbers(content: bytes) -> list[int]:
        return [*struct.unpack(f"<{len(content) // 4}I", content[: len(content) // 4 * 4])]


def shared_of_binary(archive: zipfile.ZipFile) -> tuple[list[int], list[int]]:
    """Bytes of each shared text of a .xlsb file, and which of them each cell uses."""
    texts = [one for one in _binary_parts(archive) if one[:1] == b"\x9f"]  # the list begins
    lengths = [size for part in texts for kind, _, size in _records(part) if kind == _TEXT]
    used = [
        struct.unpack_from("<I", part, at + 8)[0]
        for part in _binary_parts(archive)
        for kind, at, size in _records(part)
        if kind == _SHARED_CELL and size >= 12 and at + size <= len(part)
    ]
    return lengths, used


def extents_of_binary(archive: zipfile.ZipFile) -> list[Extent]:
    """Of each sheet of a .xlsb file; none of other archives."""
    return [_extent(part) for part in _binary_parts(archive)]


def _binary_parts(archive: zipfile.ZipFile) -> list[bytes]:
    """The parts that the workbook of a .xlsb file lists, and its sheets; none of other archives."""
    names = {*archive.namelist()}
    if "xl/workbook.bin" not in names:
        return []
    parts = {name for name in names if name.startswith("xl/worksheets/")}
    if (listed := "xl/_rels/workbook.bin.rels") in names:
        # Sheets may have any name.
        for target in re.findall(rb"""\sTarget\s*=\s*["']([^"']*)""", unpacked(archive, listed)):
            name = target.decode("utf-8", "replace")
            parts |= names & {f"xl/{name}", name.lstrip("/"), name}
    return [content for name in sorted(parts)
            if not (content := unpacked(archive, name)).lstrip().startswith(b"<")]  # fmt: skip


def _extent(content: bytes) -> Extent:
    found, row = Extent(), 0
    for kind, at, size in _records(content):
        if at + size > len(content):
            break
        if kind == _ROW and size >= 4:
            row = struct.unpack_from("<I", content, at)[0]
        elif _FIRST <= kind <= _LAST and size >= 4:
            found = found.with_cell(row, struct.unpack_from("<I", content, at)[0])
        elif kind == _EXTENT and size >= 16:
            first, last, begin, end = struct.unpack_from("<IIII", content, at)
            _check_declared(max(first, last) + 1, max(begin, end) + 1, ROWS, COLUMNS)
    return found


def _records(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Kind, place and size of each record; kinds and sizes have seven bits a byte, the least first."""
    at, end = 0, len(content)
    while at < end:
        kind, at = content[at], at + 1
        if kind & 0x80 and at < end:
            kind, at = kind & 0x7F | (content[at] & 0x7F) << 7, at + 1
        size = 0
        for k in range(4):
            if at >= end:
                return
            more, at = content[at], at + 1
            size |= (more & 0x7F) << 7 * k
            if not more & 0x80:
                break
        yield kind, at, size
        at += size
