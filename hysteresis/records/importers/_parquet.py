"""Parquet files through pyarrow (an extra: pip install 'hysid[parquet]')."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from ..._limits import check_shape, most_unpacked
from .._cells import check_room
from ._sheet import Sheet, sheet_of_arrays

MARK = b"PAR1"


def parquet(path: Path, data: bytes, table: int | None = None) -> Sheet | None:
    """The table of a Parquet file, None without rows. Units are metadata `unit` of fields."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = pq.ParquetFile(io.BytesIO(data))
    words = [f.name for f in file.schema_arrow if not _is_plain(pa, f.type)]
    # A text that repeats is kept once, as it is stored.
    file = pq.ParquetFile(io.BytesIO(data), read_dictionary=words)
    # A column of one value takes a few bytes, whatever its length.
    shape = file.metadata.num_rows, file.metadata.num_columns
    check_shape(shape, np.dtype(float), most_unpacked(len(data)))
    found = file.read()
    columns = {name: found.column(name).to_numpy() for name in found.column_names}
    units = {}
    for field in found.schema:
        said = field.metadata or {}
        if unit := said.get(b"unit", said.get(b"units")):
            units[field.name] = unit.decode("utf-8", "replace")
    for name, x in columns.items():
        if x.dtype == object:
            said = ["" if v is None else str(v) for v in x]
            check_room(path, {name: said}, np.arange(1, len(said) + 1))
            columns[name] = np.array(said)
    return sheet_of_arrays({"": columns}, units, "a Parquet file", table=table)


def _is_plain(pa: Any, kind: Any) -> bool:
    """Whether values have a fixed size, and no others within them."""
    return pa.types.is_primitive(kind) or pa.types.is_dictionary(kind) or pa.types.is_nested(kind)
