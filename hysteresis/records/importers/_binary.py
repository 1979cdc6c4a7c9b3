"""The table of a file that is not a text of rows: the first reader that knows its first bytes."""

import bz2
import importlib.util
import io
import json
import logging
import re
import sqlite3
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from ..._errors import InputError
from ..._limits import ALWAYS_UNPACKED, DAMAGE, check_shape, most_unpacked
from ..._verdict import Note
from .._arrays import MOST_TEXT, check_room
from ._apart import read_apart
from ._blocks import Block, blocks, nameless, sheet_of
from ._matlab import arrays_file, is_arrays_file
from ._notes import OTHER
from ._sheet import BAG, Sheet, chosen_table, distinct, fault, sheet_of_arrays

# Universal files (UFF, .unv): data sets 58, functions of one channel each, as one table.
#
# A data set stands between two lines of -1. Eleven lines at its head say what kind of function it is, how
# its values are written, and what its axes are. Format: SDRC I-DEAS, "Universal Dataset Number 58:
# Function at Nodal DOF"; 58b has its values in binary.

_HEAD = 12
"""Lines of a data set 58 before its values, the one with its number included."""
_EDGE = re.compile(rb"^[ \t]*-1[ \t]*\r?(?:\n|\Z)", re.MULTILINE)
BEGINS = re.compile(rb"\A\s*-1[ \t]*\r?\n\s*\d+b?\b")
_OVER_TIME, _TIME, _UNKNOWN = 1, 17, 0
"""A function over time, and the kinds of an abscissa that such a function has."""
_BYTES = {2: 4, 4: 8}
"""Bytes of a real number, by its type; others are complex, as those of a spectrum are."""
_EMPTY = ("", "NONE")


class _Record(NamedTuple):
    """A channel over time: name, units of values and clock, times and values (n,)."""

    name: str
    unit: str
    clock_unit: str
    x: np.ndarray
    y: np.ndarray


def universal_file(path: Path, data: bytes, table: int | None = None) -> Sheet | None:
    """The table of a universal file, None without a channel over time.

    Channels over time with one clock are columns beside "time". Of several clocks the one with most
    channels is meant, or `table`.
    """
    found = [_record(head, body) for head, body in _data_sets(data)]
    if not any(found):
        return None
    families: dict[tuple, list[_Record]] = {}
    for one in found:
        if one is not None:
            clock = len(one.x), float(one.x[0]), float(one.x[-1])
            families.setdefault(clock, []).append(one)
    listed = list(families.values())
    kept = listed[chosen_table([*map(len, listed)], table)]
    names = distinct([one.name for one in kept], ["time"])
    notes = [Note("format", f"Read as a UFF file: {len(kept)} data sets 58.")]
    if left := len(found) - len(kept):
        notes.append(Note("skipped", f"Left out {left} data sets of another kind or clock."))
    columns = {"time": kept[0].x} | dict(zip(names, (one.y for one in kept), strict=True))
    units = {"time": kept[0].clock_unit} | dict(zip(names, (one.unit for one in kept), strict=True))
    return Sheet(columns, np.arange(1, len(kept[0].x) + 1), units, tuple(notes))


def _data_sets(data: bytes) -> Iterator[tuple[list[str], bytes]]:
    """The head's lines and the bytes of the values of each data set 58."""
    at = 0
    while (begin := _EDGE.search(data, at)) is not None:
        end = begin.end()
        for _ in range(_HEAD):
            end = data.find(b"\n", end) + 1 or len(data)
        head = data[begin.end() : end].decode("latin-1").splitlines()
        kind = head[0].split()[:1] if head else []
        size = int(head[0][31:43]) if kind == ["58b"] else 0
        close = _EDGE.search(data, end + size if kind in (["58"], ["58b"]) else begin.end())
        stop = len(data) if close is None else close.start()
        if kind in (["58"], ["58b"]) and len(head) == _HEAD:
            yield head, data[end : end + size] if size else data[end:stop]
        at = len(data) if close is None else close.end()


def _record(head: list[str], body: bytes) -> _Record | None:
    """A channel over time, None of any other function. Raises `ValueError` where head and values differ."""
    number, clock, ordinate = head[7].split(), head[8], head[9]
    kind, count, even = (int(word) for word in number[:3])
    over_time = int(head[6][:5]) == _OVER_TIME and int(clock[:10]) in (_TIME, _UNKNOWN)
    if not over_time or kind not in _BYTES:
        return None
    if head[0].split()[0] == "58b":
        order = "<" if int(head[0][7:13]) == 1 else ">"
        wide = f"{order}f{_BYTES[kind]}"
        if even:
            values = np.frombuffer(body, wide).astype(float)
        else:  # times are always numbers of four bytes
            both = np.frombuffer(body, [("x", f"{order}f4"), ("y", wide)])
            values = np.stack([both["x"], both["y"]], axis=1).astype(float).ravel()
    else:
        values = _fields(body.decode("latin-1"), 13 if kind == 2 else 20)
    wanted = count if even else 2 * count
    if count < 2 or len(values) < wanted:
        raise ValueError(f"a channel of {count:,} values has {len(values):,} numbers")
    if even:
        start, step = (float(word.replace("D", "E")) for word in number[3:5])
        x, y = start + step * np.arange(count), values[:count]
    else:
        x, y = values[:wanted:2], values[1:wanted:2]
    said = [head[6][31:41].strip(), *(line.strip() for line in (*head[1:3], *head[4:6]))]
    name = next((word for word in said if word not in _EMPTY), "")
    return _Record(name, _unit(ordinate), _unit(clock) or "s", x, y)


def _fields(text: str, width: int) -> np.ndarray:
    """Numbers between blanks, or, where they touch one another, in fields of one width."""
    text = text.replace("D", "E")
    try:
        return np.array(text.split(), float)
    except ValueError:
        lines = [line.rstrip() for line in text.splitlines()]
        fields = [s[k : k + width] for s in lines for k in range(0, len(s), width)]
        return np.array(fields, float)


def _unit(axis: str) -> str:
    """The unit of an axis, which stands behind its label."""
    word = axis[47:67].strip()
    return "" if word in _EMPTY else word


# ROS bags through rosbags (an extra: pip install 'hysid[ros]'): .bag files, folders of the second ROS.

_LEAST, _MESSAGE = 3, 16
"""Messages of a topic that is read; bytes that each takes beside its content."""


def ros_bag(path: Path, data: bytes, table: int | None = None) -> Sheet | None:
    """The numbers of a bag's topics, None where no topic holds numbers.

    The topic with most messages, or `table`, gives the rows and the clock: the times at which its messages
    were recorded, from the first on. Numbers of the other topics are interpolated linearly to these times,
    which a note says, with how many messages each of them has.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    topics: dict[str, dict[str, list[float]]] = {}
    times: dict[str, list[int]] = {}
    known = get_typestore(Stores.LATEST)  # of bags that do not hold the types of their messages
    most = left = most_unpacked(len(data))
    for part in path.glob("*.db3"):
        _check_plain_tables(part)
    with (
        _unpacking_at_most(ALWAYS_UNPACKED),
        AnyReader([path], default_typestore=known) as reader,
    ):
        for connection, stamp, raw in reader.messages():
            if (left := left - len(raw) - _MESSAGE) < 0:
                raise ValueError(f"its messages have more than {most:,} bytes")
            fields = dict(_message_numbers("", reader.deserialize(raw, connection.msgtype)))
            kept = topics.setdefault(connection.topic, {key: [] for key in fields})
            if fields.keys() == kept.keys() and fields:
                times.setdefault(connection.topic, []).append(stamp)
                for key, value in fields.items():
                    kept[key].append(value)
    usable = [topic for topic, stamps in times.items() if len(stamps) >= _LEAST]
    if not usable:
        return None
    usable.sort(key=lambda topic: -len(times[topic]))
    main = usable[0 if table is None else min(table, len(usable)) - 1]
    start = times[main][0]
    clock = (np.array(times[main]) - start) / 1e9
    columns = {"time": clock}
    for topic in (main, *(t for t in usable if t != main)):
        own = (np.array(times[topic]) - start) / 1e9
        for key, values in topics[topic].items():
            x = np.array(values)
            columns[f"{topic}.{key}"] = x if topic == main else np.interp(clock, own, x)
    sheet = sheet_of_arrays({main: columns}, {"time": "s"}, "a ROS bag")
    assert sheet is not None  # it has a clock
    counts = ", ".join(f"{topic} ({len(times[topic])})" for topic in usable if topic != main)
    if not counts:
        return sheet
    said = (
        f"Rows are the messages of {main} ({len(clock)}). Those of {counts} are interpolated linearly to"
        " their times. --table N takes the N-th topic instead, in the order of their messages."
    )
    return replace(sheet, notes=(*sheet.notes, Note("one-clock", said)))


def _message_numbers(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """The numbers within a message, by their path; vectors of at most 32, without its header."""
    if isinstance(value, bool | int | float | np.number):
        yield name, float(value)
    elif isinstance(value, np.ndarray) and value.ndim == 1 and len(value) <= 32:
        for k, one in enumerate(value.tolist()):
            yield from _message_numbers(f"{name}[{k}]", one)
    elif is_dataclass(value):
        for key in (field.name for field in fields(value)):
            if key != "header" and not key.startswith("__"):
                yield from _message_numbers(f"{name}.{key}" if name else key, getattr(value, key))


def _check_plain_tables(file: Path) -> None:
    """Raise `ValueError` for a database that computes what is read from it, which may have no end."""
    if file.is_symlink():
        raise ValueError(f"{file.name} is a link to another place")
    with closing(
        sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
    ) as base:
        for kind, name, said in base.execute(
            "select type, name, sql from sqlite_master"
        ).fetchall():
            columns = base.execute("select hidden from pragma_table_xinfo(?)", (name,)).fetchall()
            virtual = (said or "").lstrip().lower().startswith("create virtual")
            if kind not in ("table", "index") or virtual or any(hidden for (hidden,) in columns):
                raise ValueError(f"{name} in {file.name} holds no data of its own")


@contextmanager
def _unpacking_at_most(most: int) -> Iterator[None]:
    """Let rosbags unpack no chunk, message or file to more bytes: its own ways have no limit."""
    import lz4.frame
    from rosbags.rosbag1 import reader as first
    from rosbags.rosbag2 import reader as second
    from rosbags.rosbag2 import storage_mcap

    own_module: Any = second
    zstd = own_module.zstd
    tables: tuple[Any, ...] = (first.decompressors, storage_mcap.DECOMPRESSORS)

    def limited(begin: Callable[[], Any]) -> Callable[..., bytes]:
        def unpack(packed: bytes, *_: int) -> bytes:
            one = begin()
            found = one.decompress(packed, max_length=most)
            if not one.eof or one.unused_data:
                raise ValueError(f"a part of it unpacks to more than {most:,} bytes")
            return found

        return unpack

    ways = {
        "bz2": limited(bz2.BZ2Decompressor), "lz4": limited(lz4.frame.LZ4FrameDecompressor),
        "zstd": limited(zstd.ZstdDecompressor),
    }  # fmt: skip
    own = SimpleNamespace(
        decompress=ways["zstd"], open=lambda file, _: io.BytesIO(ways["zstd"](file.read()))
    )
    with ExitStack() as after:
        for table in tables:
            after.callback(table.update, dict(table))
            table.update({name: way for name, way in ways.items() if name in table})
        after.callback(setattr, own_module, "zstd", zstd)
        own_module.zstd = own
        yield


# Files that packages of extras read: TDMS by npTDMS, workbooks by python-calamine, Parquet by pyarrow.

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


class _Reader(NamedTuple):
    """Files of one kind: what they are called, whether bytes are one, and what makes a table of them.

    - `none`, `fix`: what is said of one without a table.
    - `package`, `extra`: what has to be installed for it, if anything; `instead`: how to do without.
    """

    what: str
    knows: Callable[[bytes], bool]
    read: Callable[[Path, bytes, int | None], Sheet | None]
    none: str
    fix: str = ""
    package: str = ""
    extra: str = ""
    instead: str = ""


_READERS = (
    _Reader(
        "TDMS file", lambda data: data[:4] == TDMS, tdms, "no channel holds numbers.",
        package="npTDMS", extra="rigs", instead="export the file as text (.lvm, .csv)",
    ),
    _Reader(
        "workbook", is_workbook, workbook, "no sheet holds a table: a header and rows of numbers.",
        package="python-calamine", extra="rigs", instead="export the sheet as CSV",
    ),
    _Reader(
        "file of arrays", is_arrays_file, arrays_file,
        "it holds no vector of numbers; tables and time series of MATLAB are objects of its own.",
        "save them as vectors: s = table2struct(T, 'ToScalar', true).",
    ),
    _Reader(
        "Parquet file", lambda data: data[:4] == data[-4:] == PARQUET, parquet, "a header and no rows.",
        package="pyarrow", extra="parquet", instead="export the table as CSV",
    ),
    _Reader(
        "ROS bag", lambda data: data.startswith(BAG), ros_bag, "no topic holds numbers.",
        package="rosbags", extra="ros",
        instead="print the topics as CSV (rostopic echo -b FILE -p TOPIC)",
    ),
    _Reader(
        "UFF file", lambda data: BEGINS.match(data[:400]) is not None, universal_file,
        "this is a UFF file without a record over time: values over frequency, or no data set 58.",
        "export values over time.",
    ),
)  # fmt: skip


def binary(path: Path, data: bytes, table: int | None = None) -> Sheet | None:
    """The table of such a file, None where it is a text of rows or of a kind that no reader knows.

    `table`: which of several tables, from 1.

    Raises `InputError` `missing-extra`, `damaged-file`, `no-rows`, and `bad-option` without such a table.
    """
    reader = next((one for one in _READERS if one.knows(data)), None)
    if reader is None:
        return None
    what, module = reader.what, reader.package.lower().replace("-", "_")
    if module and importlib.util.find_spec(module) is None:
        raise fault(
            "missing-extra", path, f"{what}s are read by {reader.package}, which is not installed.",
            f"pip install 'hysid[{reader.extra}]', or {reader.instead}.",
        )  # fmt: skip
    try:
        sheet = reader.read(path, data, table)
    except (KeyboardInterrupt, SystemExit, GeneratorExit, InputError):
        raise
    except BaseException as error:  # whatever readers meet, and a panic of Rust is no `Exception`
        error.__traceback__ = None  # an object of HDF5 in its frames must not outlive the library
        raise fault("damaged-file", path, f"this {what} is damaged: {error}.") from None
    if sheet is None:
        raise fault("no-rows", path, reader.none, reader.fix)
    return sheet
