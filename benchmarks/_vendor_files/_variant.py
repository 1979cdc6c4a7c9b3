"""One file, what is right for it, and the numbers that all of them are written with."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

N = 160
TIME = 0.05 * np.arange(N)
DRIVE = 4.0 - np.abs((np.arange(N) + 40) % 80 - 40.0) / 10  # two triangles, from 0 to 4
RISING = np.gradient(DRIVE) > 0
ANSWER = 1.5 * DRIVE**1.3 + np.where(RISING, 0.0, 0.35) * DRIVE * (4 - DRIVE)
"""An answer that lags, so that its loop is open."""
SWING = 2.0 * (DRIVE - 2.0)
"""A drive of both signs, as a field is."""
SWITCHED = np.tanh(SWING - np.where(RISING, 0.8, -0.8))


class Variant(NamedTuple):
    """A file and the right answer.

    - `content`: its text or bytes, or what writes it at a path.
    - `units`: of the columns that matter, as the file writes them; "" where it has none.
    - `time`: the clock's column, None where there is none.
    - `pair`: drive and answer; None where no column drives another.
    - `rows`: of the main table, None where it is not judged.
    - `refused`: the right answer is a refusal.
    """

    content: str | bytes | Callable[[Path], object]
    units: Mapping[str, str] = {}
    time: str | None = None
    pair: tuple[str, str] | None = None
    suffix: str = ".csv"
    encoding: str = "utf-8"
    rows: int | None = N
    refused: bool = False

    def write(self, file: Path) -> None:
        """Write it there."""
        if isinstance(self.content, str):
            file.write_bytes(self.content.encode(self.encoding))
        elif isinstance(self.content, bytes):
            file.write_bytes(self.content)
        else:
            self.content(file)


Cells = Iterable[object] | np.ndarray


def table(
    *columns: Cells, sep: str = ",", comma: bool = False, quote: str = "", form: str = "{:.4f}"
) -> str:
    """Rows of a text: numbers by `form`, with a decimal comma if wanted; words as they are."""
    lines = []
    for row in zip(*columns, strict=True):
        cells = [form.format(v) if isinstance(v, float) else str(v) for v in row]
        cells = [
            c.replace(".", ",") if comma and isinstance(v, float) else c
            for c, v in zip(cells, row, strict=True)
        ]
        lines.append(sep.join(f"{quote}{c}{quote}" for c in cells))
    return "\n".join(lines) + "\n"


def head(*names: str, sep: str = ",") -> str:
    """A line of names or units."""
    return sep.join(names) + "\n"
