"""Files that packages of extras read: TDMS by npTDMS, workbooks by python-calamine, Parquet by pyarrow."""

import io
import json
import logging
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from ..._limits import DAMAGE, check_shape, most_unpacked
from .._cells import MOST_TEXT, check_room
from ._apart import read_apart
from ._blocks import Block, blocks, nameless, sheet_of
from ._dialects import OTHER
from ._sheet import Sheet, distinct, sheet_of_arrays

TDMS, PARQUET = b"TDSm", b"PAR1"
"""Their first bytes."""
_ZIP, _OLD = b"PK\x03\x04", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
_INSIDE = ("xl/workbook.xml", "xl/workbook.bin", "content.xml")


def tdms(path: Path, data: bytes, table: int | None = None) -> Sheet | None:
    """The table of a TDMS file, LabVIEW's binary one, None where no channel holds numbers.

    The channels of a group are its columns, with "time" from their step where they have one; groups with
    the same channels are put under one another. Channels of another length than most are left out, and
    named.
    """
    from nptdms import TdmsFile
    from nptdms.log import log_manager

    log_manager.set_level(logging.ERROR)  # a damaged file is said in our own words
    units: dict[str, str] = {}
    arrays = {
        group.name: _columns(group.channels(), units, len(data))
        for group in TdmsFile.read(io.BytesIO(data)).groups()
    }
    return sheet_of_arrays(arrays, units, "a TDMS file", table=table)


def _columns(channels: list[Any], units: dict[str, str], held: int) -> dict[str, np.ndarray]:
    """The channels of one group; their units go to `units`.

    Raises `ValueError` where they declare more samples than the `held` bytes of the file can be.
    """
    filled = [c for c in channels if len(c)]
    if (declared := sum(map(len, filled))) > held:
        raise ValueError(f"it declares {declared:,} samples, and has {held:,} bytes")
    found: dict[str, np.ndarray] = {}
    names = distinct([c.name for c in filled])
    if filled and (step := filled[0].properties.get("wf_increment")):
        start, step = float(filled[0].properties.get("wf_start_offset", 0.0)), float(step)
        (clock,) = distinct(["time"], names)
        found[clock] = start + step * np.arange(len(filled[0]))
        units[clock] = "s"
    for name, channel in zip(names, filled, strict=True):
        x = np.asarray(channel[:])
        found[name] = x
        if unit := channel.properties.get("unit_string"):
            units[name] = str(unit)
    return found


def workbook(path: Path, data: bytes, table: int | None = None) -> Sheet | None:
    """The table of a workbook (.xlsx, .xls, .xlsb, .ods), None where no sheet holds one.

    Sheets with the same header are put under one another and told apart by the column "sheet"; of others
    the one with most rows is meant, or `table`. Values are those that the spreadsheet last computed.
    """
    read = json.loads(read_apart("_workbook_cells", data, MOST_TEXT))
    numbered = {name: [(k, row) for k, row in rows] for name, rows in read.items()}
    found: list[Block] = []
    for title, rows in numbered.items():
        pieces = blocks(rows)
        found += [b._replace(above=[[title]] if len(pieces) == 1 else [[f"{title} {k}"]])
                  for k, b in enumerate(pieces, 1)]  # fmt: skip
    if not found:
        found = [b for rows in numbered.values() for b in nameless(rows, OTHER, "", "")]
    return sheet_of(found, OTHER._replace(name="a workbook", column="sheet"), table=table)


def is_workbook(data: bytes) -> bool:
    """Whether bytes are those of a workbook."""
    if data.startswith(_OLD):
        # Word and others are in the same container: the stream of a workbook has one of these names.
        return any(name.encode("utf-16-le") in data for name in ("Workbook", "Book"))
    if not data.startswith(_ZIP) or not zipfile.is_zipfile(io.BytesIO(data)):
        return False
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return bool({*_INSIDE} & {*archive.namelist()})
    except DAMAGE:
        return False


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
        if x.dtype.kind == "m":
            columns[name], units[name] = x / np.timedelta64(1, "s"), "s"
        if x.dtype == object:
            said = ["" if v is None else str(v) for v in x]
            check_room(path, {name: said}, np.arange(1, len(said) + 1))
            columns[name] = np.array(said)
    return sheet_of_arrays({"": columns}, units, "a Parquet file", table=table)


def _is_plain(pa: Any, kind: Any) -> bool:
    """Whether values have a fixed size, and no others within them."""
    return pa.types.is_primitive(kind) or pa.types.is_dictionary(kind) or pa.types.is_nested(kind)
