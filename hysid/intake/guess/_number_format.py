"""Number format of a file: decimal sign, row of units, words for missing values."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hysteresis import Table, read_table
from hysteresis.records._units import is_unit
from hysteresis.records.importers import is_number

from .._selection_options import OF_READING

HEAD = 2**19
"""Bytes of a large file that are read from its head; eight pieces of all the rest come besides."""
LARGEST = 1e300
"""No measurement is larger."""
Notes = list[tuple[str, str, str]]


def reading(
    file: Path, table: Table | None, given: Mapping[str, Any]
) -> tuple[dict[str, Any], Notes]:
    """Options of `read_table` that make numbers of a file's cells, beside those given; and what was seen.

    `table`: as read without options; None where only a decimal comma can be read.
    """
    options = {k: given[k] for k in OF_READING if given.get(k)}
    notes: Notes = []
    if table is None:
        options.setdefault("decimal", ",")
        table = read_table(file, **options, most=HEAD)
    # The text of columns that are numbers already takes a while to make, and says no more.
    texts = [table.text[name] for name, x in table.columns.items() if x.dtype.kind != "f"]
    commas = [x for x in texts if _share(x, ",") > 0.8 and _share(x, ".") < 0.8]
    if commas and "decimal" not in options and table.decimal == ".":
        options["decimal"] = ","
        why = f"{len(commas)} columns contain numbers with a decimal comma"
        notes.append(("decimal", ",", why))
    decimal = options.get("decimal", table.decimal)
    odd: Counter[str] = Counter()
    for name, x in table.columns.items():
        if x.dtype.kind == "f" and (large := np.abs(x) > LARGEST).any():  # or infinite
            odd.update(table.text[name][large].tolist())
    for cells in texts:
        if _share(cells[1:], decimal) >= 0.5:
            odd.update(c for c in cells.tolist() if c and not _good(c, decimal))
    if "units_row" not in options and _is_units(table, texts, decimal):
        options["units_row"] = int(table.line[0])
        notes.append(("units_row", str(table.line[0]), "a row of units under the header"))
        odd.subtract(Counter(cells[0] for cells in texts))
    words = [w for w, n in odd.most_common(6) if n > 0 and "," not in w]
    if words and "na_values" not in options:
        options["na_values"] = tuple(words)
        why = "words among the numbers, read as missing values"
        notes.append(("na_values", ", ".join(words), why))
    return options, notes


def _is_units(table: Table, texts: list[np.ndarray], decimal: str) -> bool:
    """Whether the first row has words where all others have numbers."""
    if table.units or len(table.line) < 3:
        return False
    first = [cells[0] for cells in texts if _share(cells[1:], decimal) > 0.8]
    words = [c for c in first if c and not _good(c, decimal)]
    named = 2 * sum(map(is_unit, words)) >= len(words)
    alone = len(texts) == len(table.columns) and len(words) == len(first)
    return len(words) > 1 and (named or alone)


def _share(cells: np.ndarray, decimal: str) -> float:
    """The share of numbers among the cells that are not empty, of at most a thousand."""
    some = [c for c in cells[:: max(1, len(cells) // 1000)].tolist() if c]
    return sum(_good(c, decimal) for c in some) / len(some) if some else 0.0


def _good(cell: str, decimal: str) -> bool:
    other = "," if decimal == "." else "."
    return is_number(cell) and other not in cell
