"""Rows of a large text by NumPy's compiled parser, block by block.

The careful reader makes a Python string of every cell. It reads the head of a large file and says how its
rows are laid out; the rows below are read here, several times as fast and one block at a time. Cells become
text only where text is asked for. A block with rows of another kind is read carefully, or else the whole
file is.
"""

import csv
import io
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from mmap import mmap
from typing import Any

import numpy as np

from ._cells import LONG_CELL, MISSING, MOST_TEXT, floats, parsed
from .importers._sheet import Layout

BLOCK = 2**22
"""Bytes of a block; as strings and numbers its cells take some ten times as much memory."""

CarefulRows = Callable[[str, int], tuple[Sequence[Sequence[str]], np.ndarray]]
"""Columns of cells of a block's text, whose first line is given, and the line of each row."""


class OddRowsError(Exception):
    """Rows that are not laid out as those of the head."""


@dataclass(frozen=True)
class CompiledRows:
    """The rows of `data` from byte `start` on, which is line `first`, laid out as `layout` says.

    `columns` reads all numbers, `words` the cells of one. `careful` reads blocks that the compiled parser
    does not; without it there may be none. Both raise `OddRowsError`.
    """

    data: bytes | mmap
    start: int
    first: int
    layout: Layout
    decimal: str
    na_values: tuple[str, ...]
    careful: CarefulRows | None
    blocks: list[tuple[slice, int, bool]] = field(default_factory=list)
    """Each with its first line, and whether it was read carefully."""

    @cached_property
    def _missing(self) -> re.Pattern[str]:
        known = sorted({*MISSING, *self.na_values}, key=len)[::-1]
        words = "|".join(re.escape(word.strip()) for word in known)
        end = f"\n{re.escape(self.layout.separator)}"
        return re.compile(rf"([{end}]) *(?:{words}) *(?=[{end}])", re.IGNORECASE)

    def columns(self, numeric: list[bool]) -> tuple[list[list[np.ndarray]], list[np.ndarray]]:
        """The numbers of each column, and the line of each row, block by block.

        `numeric`: which columns hold numbers alone. One that turns out to hold words becomes False.
        """
        if self.layout.separator == self.decimal:
            raise OddRowsError
        columns, lines, first = (
            [list[np.ndarray]() for _ in numeric],
            list[np.ndarray](),
            self.first,
        )
        for place in _blocks(self.data, self.start):
            text = _text(self.data[place])
            count = text.count("\n")
            parts = self._compiled(text, count, numeric)
            line = np.arange(first, first + count, dtype=np.int32)
            self.blocks.append((place, first, parts is None))
            if parts is None:
                parts, line = self._carefully(text, first, numeric)
            for column, part in zip(columns, parts, strict=True):
                column.append(part)
            lines.append(line)
            first += count
        ends = [x[-1][-1] for x, number in zip(columns, numeric, strict=True) if number]
        if not ends or np.isnan(ends).all():
            raise OddRowsError  # perhaps empty rows at the end, which are no rows
        return columns, lines

    def words(self, at: int) -> np.ndarray:
        """The cells of column `at` (n,) str, without the blanks around each."""
        parts: list[np.ndarray] = []
        for place, first, odd in self.blocks:
            text = _text(self.data[place])
            if odd and self.careful is not None:
                cells = np.array(self.careful(text, first)[0][at], str)
            else:
                options = self._options(text)
                cells = np.loadtxt(io.StringIO(text), str, usecols=at, ndmin=1, **options)
            parts.append(np.char.strip(cells))
        longest = max(part.dtype.itemsize // 4 for part in parts)
        if longest > LONG_CELL and 4 * longest * sum(map(len, parts)) > MOST_TEXT:
            raise OddRowsError
        return np.concatenate(parts)

    def _compiled(self, text: str, count: int, numeric: list[bool]) -> list[np.ndarray] | None:
        """The columns of a block, None where the parser cannot read it as the layout says."""
        separator, width = self.layout.separator, len(numeric)
        if text.startswith("#") or "\n#" in text:
            return None
        if self.decimal == ",":
            if "." in text:
                return None
            text = text.replace(",", ".")
        if separator and text[: text.index("\n")].count(separator) == width:
            text = text.replace(f"{separator}\n", "\n")  # rows that end with a separator
        if '"' in text and re.search(f'{re.escape(separator)} +"', text):
            return None  # the parser knows a quotation mark at the very beginning of a cell alone
        # Of a column of words no more is read than that it is there.
        fields = [(f"f{k}", "f8" if number else "U1") for k, number in enumerate(numeric)]
        options: dict[str, Any] = {"dtype": fields, "ndmin": 1, **self._options(text)}
        found: Any
        try:
            found = np.loadtxt(io.StringIO(text), **options)
        except ValueError:
            if self.careful is None:
                return None
            text = self._missing.sub(r"\1nan", f"\n{text}")[1:]
            try:
                found = np.loadtxt(io.StringIO(text), **options)
            except ValueError:
                return None
        if len(found) != count:  # blank lines, or cells of several lines
            return None
        columns = [np.ascontiguousarray(found[name]) for name, _ in fields]
        gone = floats([*self.na_values], self.decimal)
        if self.careful is None and not all(
            np.isfinite(x).all() for x in columns if x.dtype == float
        ):
            return None
        if np.isfinite(gone).any():
            columns = [
                np.where(np.isin(x, gone), np.nan, x) if x.dtype == float else x for x in columns
            ]
        return columns

    def _carefully(
        self, text: str, first: int, numeric: list[bool]
    ) -> tuple[list[np.ndarray], np.ndarray]:
        if self.careful is None:
            raise OddRowsError
        cells, line = self.careful(text, first)
        columns = []
        for k, column in enumerate(cells):
            x = parsed(np.char.strip(np.array(column, str)), self.decimal, self.na_values)
            numeric[k] &= x.dtype.kind == "f"
            columns.append(x)
        return columns, line

    def _options(self, text: str) -> dict[str, Any]:
        quote = '"' if '"' in text else None
        return {"delimiter": self.layout.separator or None, "comments": None, "quotechar": quote}


def _blocks(data: bytes | mmap, start: int) -> Iterator[slice]:
    """Pieces of whole lines."""
    while start < len(data):
        stop = len(data)
        if start + BLOCK < stop:
            stop = data.rfind(b"\n", start, start + BLOCK) + 1
            if stop <= start:
                raise OddRowsError
        yield slice(start, stop)
        start = stop


def _text(block: bytes) -> str:
    """A block in ASCII, each line ended by a line feed alone. Raises `OddRowsError` for any other."""
    if not block.isascii() or b"\0" in block or block.count(b'"') % 2:
        raise OddRowsError
    if b"\r" in block:
        block = block.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    block = block if block.endswith(b"\n") else block + b"\n"
    ends = np.flatnonzero(np.frombuffer(block, np.uint8) == 10)
    longest = int(np.diff(ends, prepend=-1).max())
    # The text of a column gives each cell the room of the longest one, which is within a line.
    if longest > csv.field_size_limit() or longest > LONG_CELL + 16 * len(block) / len(ends):
        raise OddRowsError
    return block.decode("ascii")
