"""Rows of a large text by NumPy's compiled parser, block by block.

The careful reader makes a Python string of every cell. It reads the head of a large file and says how its
rows are laid out; the rows below are read here, several times as fast and one block at a time. Cells become
text only where text is asked for. A file with rows of another kind is read carefully.
"""

import csv
import io
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from mmap import mmap
from typing import Any

import numpy as np

from ._arrays import LONG_CELL, MISSING, MOST_TEXT, marked
from .importers._sheet import Layout

BLOCK = 2**22
"""Bytes of a block; as strings and numbers its cells take some ten times as much memory."""


_ROW = re.compile(r"[^#]")
"""What a line begins with that is neither blank nor a comment."""


class OddRowsError(Exception):
    """Rows that are not laid out as those of the head."""


@dataclass(frozen=True)
class CompiledRows:
    """The rows of `data` from byte `start` on, which is line `first`, laid out as `layout` says.

    `numbers` reads the columns of numbers, `words` the cells of one column. Both raise `OddRowsError`.
    """

    data: bytes | mmap
    start: int
    first: int
    layout: Layout
    decimal: str
    na_values: tuple[str, ...]

    @cached_property
    def _missing(self) -> re.Pattern[str]:
        known = sorted({*MISSING, *self.na_values}, key=len)[::-1]
        words = "|".join(re.escape(word.strip()) for word in known)
        end = f"\n{re.escape(self.layout.separator)}"
        return re.compile(rf"([{end}]) *(?:{words}) *(?=[{end}])", re.IGNORECASE)

    def numbers(self, begun: Mapping[str, np.ndarray]) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """The columns (n,) of numbers, each behind the rows that have `begun` it, and the line (n,) of each
        row, 0 of those begun."""
        if self.layout.separator == self.decimal:
            raise OddRowsError
        rows, first = len(next(iter(begun.values()))), self.first
        # One array that every block is put into: blocks that are joined in the end take twice the memory.
        room = rows + 1 + sum(self.data[part].count(b"\n") for part in self._blocks())
        numeric = [x.dtype.kind == "f" for x in begun.values()]
        found = {name: np.append(x, np.empty(room - rows))
                 for (name, x), number in zip(begun.items(), numeric, strict=True) if number}  # fmt: skip
        lines = np.zeros(room, np.int32)
        for text in map(self._text, self._blocks()):
            line = np.arange(first, first + text.count("\n"), dtype=np.int32)
            first += len(line)
            if _has_others(text):
                line = line[[bool(_ROW.match(row)) for row in text.split("\n")[:-1]]]
            parts = self._parsed(text, len(line), numeric)
            if (stop := rows + len(line)) > room:  # ends of lines of several kinds
                raise OddRowsError
            lines[rows:stop] = line
            for column, part in zip(found.values(), parts, strict=True):
                column[rows:stop] = part
            rows = stop
        for x in found.values():
            x.flags.writeable = False  # so records need no copy
        if not found or all(np.isnan(x[rows - 1]) for x in found.values()):
            raise OddRowsError  # perhaps empty rows at the end, which are no rows
        return {name: x[:rows] for name, x in found.items()}, lines[:rows]

    def words(self, at: int) -> np.ndarray:
        """The cells of column `at` (n,) str, without the blanks around each."""
        texts = map(self._text, self._blocks())
        parts = [np.char.strip(self._loaded(text, str, usecols=at)) for text in texts]
        longest = max(part.dtype.itemsize // 4 for part in parts)
        if longest > LONG_CELL and 4 * longest * sum(map(len, parts)) > MOST_TEXT:
            raise OddRowsError
        return np.concatenate(parts)

    def _blocks(self) -> Iterator[slice]:
        """Pieces of whole lines."""
        start = self.start
        while start < len(self.data):
            stop = len(self.data)
            if start + BLOCK < stop:
                stop = self.data.rfind(b"\n", start, start + BLOCK) + 1
                if stop <= start:
                    raise OddRowsError
            yield slice(start, stop)
            start = stop

    def _text(self, place: slice) -> str:
        """A block in ASCII, each line ended by a line feed alone. Raises `OddRowsError` for any other."""
        block = self.data[place]
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

    def _parsed(self, text: str, count: int, numeric: list[bool]) -> list[np.ndarray]:
        """The columns of numbers of a block of so many rows; of words it is read that they are there."""
        separator, width = self.layout.separator, len(numeric)
        if self.decimal == ",":
            if "." in text:
                raise OddRowsError
            text = text.replace(",", ".")
        if separator and text[: text.index("\n")].count(separator) == width:
            text = text.replace(f"{separator}\n", "\n")  # rows that end with a separator
        if '"' in text and re.search(f'{re.escape(separator)} +"', text):
            raise OddRowsError  # the parser knows a quotation mark at the beginning of a cell alone
        fields = [(f"f{k}", "f8" if number else "U1") for k, number in enumerate(numeric)]
        try:
            found = self._loaded(text, fields)
        except OddRowsError:
            if not self.layout.plain:
                raise
            found = self._loaded(self._missing.sub(r"\1nan", f"\n{text}")[1:], fields)
        numbers = [np.ascontiguousarray(found[name]) for name, kind in fields if kind == "f8"]
        if len(found) != count or not (self.layout.plain or np.isfinite(numbers).all()):
            raise OddRowsError  # cells of several lines, or gaps
        gone = marked(self.na_values, self.decimal)
        for x in numbers if np.isfinite(gone).any() else ():
            x[np.isin(x, gone)] = np.nan
        return numbers

    def _loaded(self, text: str, dtype: Any, **options: Any) -> np.ndarray:
        """Rows of a text, without those that are none."""
        if _has_others(text):
            if not self.layout.plain:
                raise OddRowsError
            text = "\n".join(filter(_ROW.match, text.split("\n")))
        quote, options = '"' if '"' in text else None, {"ndmin": 1, "comments": None} | options
        separator = self.layout.separator or None
        try:
            return np.loadtxt(
                io.StringIO(text), dtype, delimiter=separator, quotechar=quote, **options
            )
        except ValueError:
            raise OddRowsError from None


def _has_others(text: str) -> bool:
    """Whether there are blank lines or comments."""
    return text[0] in "#\n" or "\n#" in text or "\n\n" in text
