"""ROS bags through rosbags (an extra: pip install 'hysid[ros]'): .bag files, folders of the second ROS."""

import bz2
import io
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..._limits import ALWAYS_UNPACKED, most_unpacked
from ..._note import Note
from ._sheet import Sheet, sheet_of_arrays

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
            fields = dict(_numbers("", reader.deserialize(raw, connection.msgtype)))
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


def _numbers(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """The numbers within a message, by their path; vectors of at most 32, without its header."""
    if isinstance(value, bool | int | float | np.number):
        yield name, float(value)
    elif isinstance(value, np.ndarray) and value.ndim == 1 and len(value) <= 32:
        for k, one in enumerate(value.tolist()):
            yield from _numbers(f"{name}[{k}]", one)
    elif is_dataclass(value):
        for key in (field.name for field in fields(value)):
            if key != "header" and not key.startswith("__"):
                yield from _numbers(f"{name}.{key}" if name else key, getattr(value, key))


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
