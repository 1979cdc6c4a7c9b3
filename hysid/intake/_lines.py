"""Ranges of lines of a file, as the options `--exclude-lines` and `--test-lines` have them."""

import re
from collections.abc import Sequence

import numpy as np

from hysteresis import InputError, Table


def check_lines(ranges: Sequence[str], table: Table) -> None:
    """Raise `InputError` `no-match` where a range of lines holds no row of a table."""
    for one in ranges:
        if not on_lines(table.line, [one]).any():
            raise InputError(
                "no-match",
                f"No row of the file is on lines {one}.",
                place=table.path,
                fix=f"The rows are on lines {table.line.min()} to {table.line.max()}.",
            )


def on_lines(line: np.ndarray, ranges: Sequence[str]) -> np.ndarray:
    """Which rows, whose lines (n,) are given, are on one of these ranges, `FIRST-LAST` or one number.

    Raises `InputError` `bad-option`.
    """
    found = np.zeros(len(line), bool)
    for one in ranges:
        match = re.fullmatch(r"\s*(\d{1,18})(?:\s*-\s*(\d{1,18}))?\s*", one)
        first, last = (int(x or match[1]) for x in match.groups()) if match else (1, 0)
        if last < first:
            raise InputError(
                "bad-option",
                f"{one!r} is not a range of lines.",
                fix="Write the first and the last line of the file: 120-340.",
            )
        found |= (line >= first) & (line <= last)
    return found


def as_ranges(line: np.ndarray, chosen: np.ndarray) -> list[str]:
    """The ranges of lines that hold the chosen rows and no others; the inverse of `on_lines`.

    Lines between neighbouring rows, such as comments, are taken along.
    """
    order = np.argsort(line, kind="stable")
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen[order].astype(int), [0]])))
    first, last = line[order][edges[::2]], line[order][edges[1::2] - 1]
    return [f"{a}-{b}" for a, b in zip(first.tolist(), last.tolist(), strict=True)]
