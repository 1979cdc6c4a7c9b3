"""What an importer hands on: named columns of cells, and what there is to say about them."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..._note import Note
from .._units import bare_unit, is_unit, spelled

_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][+-]?\d+)?|nan", re.IGNORECASE)


class Layout(NamedTuple):
    """How the rows of a text go on below the last one: cells between `separator`, "" for blanks.

    `plain`: they are those of a header and rows, so that empty cells and comments may come too.
    """

    separator: str
    plain: bool


@dataclass(frozen=True)
class Sheet:
    """The columns of a file before anything is made of them.

    **Arguments:**

    - `columns`: the cells of each, by name, all of one length n; numbers where the file has them.
    - `line`: (n,) the line of each row, from 1.
    - `units`: by column, where the file says them beside the header, as the file writes them; "" where it
      says that there is none.
    - `notes`: one for each thing that was done.
    - `decimal`: the sign its numbers are written with.
    - `layout`: how rows would go on, None where more than rows like these may follow.
    - `clock`: the time of the first row and from row to row, in seconds, and what says so.
    """

    columns: Mapping[str, Sequence[str] | np.ndarray]
    line: np.ndarray
    units: Mapping[str, str]
    notes: tuple[Note, ...]
    decimal: str = "."
    layout: Layout | None = None
    clock: tuple[float, float, str] | None = None


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with either decimal sign."""
    return _NUMBER.fullmatch(cell.strip()) is not None


def units_of(cells: Sequence[str]) -> list[str] | None:
    """A row of units as written, one for each cell and "" for none, or None where it is no such row.

    Most of them are known, or all stand in brackets.
    """
    bare = [bare_unit(cell) for cell in cells]
    named = [unit for unit in bare if spelled(unit) != "1"]
    if not named or any(is_number(unit) for unit in named):
        return None
    known = sum(map(is_unit, named))
    bracketed = all(cell.strip()[:1] in "([" for cell in cells if cell.strip())
    return bare if 3 * known >= 2 * len(named) or (bracketed and len(named) > 1) else None


def distinct(names: Sequence[str], taken: Collection[str] = ()) -> list[str]:
    """Names of columns: numbered where empty, with a number behind where there twice."""
    found: list[str] = []
    for k, name in enumerate(names, 1):
        stem = " ".join(name.split()) or f"column {k}"
        other, n = stem, 1
        while other in found or other in taken:
            n += 1
            other = f"{stem} {n}"
        found.append(other)
    return found


def decimal_of(cells: Sequence[str]) -> str:
    """The decimal sign of these cells: a comma where some have one and none has a point."""
    commas = sum("," in cell for cell in cells if is_number(cell))
    return "," if commas and not any("." in cell for cell in cells if is_number(cell)) else "."
