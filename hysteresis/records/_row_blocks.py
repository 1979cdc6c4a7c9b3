"""Columns of a file that is larger than memory, block by block."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from jaxtyping import Float

from .._errors import InputError


def row_blocks(
    path: str | Path, columns: tuple[str, ...], rows: int = 1_000_000
) -> Iterator[tuple[Float[np.ndarray, " rows"], ...]]:
    """Columns of a Parquet, NumPy or CSV file in blocks of rows, for `identify.fit_density_in_blocks`.

    No more than a block is in memory. Nothing is guessed or repaired: a CSV file has commas, a header in
    its first line and numbers below; a `.npy` file holds a structured array, whose fields are the columns.

    **Arguments:**

    - `columns`: their names.
    - `rows`: of a block, at most.

    Raises `InputError`: `no-column`; `not-numbers` for a cell of a CSV file; `missing-extra` for Parquet
    without pyarrow; `unreadable-file` for another kind of file.

    **Example:**

        >>> for u, y in hysteresis.row_blocks("long.parquet", ("H (A/m)", "B (T)")):  # doctest: +SKIP
        ...     print(len(u))
    """
    path = Path(path)
    readers = {".parquet": _parquet, ".npy": _npy, ".csv": _csv}
    if path.suffix.lower() not in readers:
        raise InputError(
            "unreadable-file",
            f"{path.name} is not read in blocks.",
            fix=f"give a file that ends in {', '.join(readers)}.",
        )
    yield from readers[path.suffix.lower()](path, columns, rows)


def _parquet(path: Path, columns: tuple[str, ...], rows: int) -> Iterator[tuple[np.ndarray, ...]]:
    try:
        # An extra.
        import pyarrow.parquet as pq
    except ImportError:
        raise InputError(
            "missing-extra",
            "Parquet files are read by pyarrow, which is not installed.",
            fix="pip install 'hysid[parquet]', or export the table as CSV.",
        ) from None
    with pq.ParquetFile(path) as file:
        _check(path, columns, file.schema_arrow.names)
        for batch in file.iter_batches(rows, columns=list(columns)):
            yield tuple(
                np.asarray(batch.column(name).to_numpy(zero_copy_only=False), float)
                for name in columns
            )


def _npy(path: Path, columns: tuple[str, ...], rows: int) -> Iterator[tuple[np.ndarray, ...]]:
    table = np.load(path, mmap_mode="r")
    _check(path, columns, list(table.dtype.names or ()))
    for begin in range(0, len(table), rows):
        block = table[begin : begin + rows]
        yield tuple(np.asarray(block[name], float) for name in columns)


def _csv(path: Path, columns: tuple[str, ...], rows: int) -> Iterator[tuple[np.ndarray, ...]]:
    with path.open(encoding="utf-8-sig") as file:
        names = [name.strip().strip('"') for name in next(file, "").split(",")]
        _check(path, columns, names)
        used = [names.index(name) for name in columns]
        while lines := list(islice(file, rows)):
            try:
                block = np.loadtxt(lines, delimiter=",", usecols=used, ndmin=2)
            except ValueError as error:
                raise InputError("not-numbers", f"{path.name}: {error}.") from None
            yield tuple(block.T.copy())


def _check(path: Path, columns: tuple[str, ...], names: list[str]) -> None:
    for name in columns:
        if name not in names:
            raise InputError(
                "no-column", f"{path.name} has no column {name!r}; have {', '.join(names)}."
            )
