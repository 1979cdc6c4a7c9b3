"""Small files that unpack, repeat or declare much, and damaged files of makers: memory and time of each."""

import bz2
import io
import json
import os
import re
import sqlite3
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from pathlib import Path

import numpy as np

from .._measure import Row, judged, noted

SECONDS, LARGEST_MB = 5.0, 1000
"""Of one file: processor time, and the memory of the process, Python and our own modules included."""

_READ = """
import json, resource, sys, time
from hysteresis import InputError, read_table
resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
with open("/proc/self/statm") as file:
    now = int(file.read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (now + 6_000_000_000,) * 2)
for line in sys.stdin:
    with open("/proc/self/clear_refs", "w") as file:
        file.write("5")  # the peak begins anew
    begin = time.process_time()
    try:
        said = f"read, {len(read_table(line.rstrip()).line):,} rows"
    except InputError as error:
        said = error.code
    except BaseException as error:
        said = f"! {type(error).__name__} {error}"
    # ru_maxrss would count what the parent has, as long as this process shared its memory.
    with open("/proc/self/status") as status:
        peak = next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1e3
    print(json.dumps([said, time.process_time() - begin, peak]), flush=True)
"""
"""Reads the tables whose paths stand on stdin: how each ended, its seconds, its peak of memory."""


def read_apart(paths: list[Path]) -> list[tuple[str, float, float]]:
    """How each file ends that is read by a process of its own, which is another one after a death."""
    found: list[tuple[str, float, float]] = []
    while len(found) < len(paths):
        names = "".join(f"{path}\n" for path in paths[len(found) :])
        done = subprocess.run(
            [sys.executable, "-c", _READ], input=names, text=True, capture_output=True, check=False
        )
        found += [tuple(json.loads(line)) for line in done.stdout.splitlines()]
        if len(found) < len(paths):
            found.append((f"! the process died: {done.stderr[-300:]}", SECONDS, 0.0))
    return found


def _zip(members: dict[str, bytes | str]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return packed.getvalue()


_ODS = (
    '<office:document-content xmlns:office="urn:oasis:names:tc:opendocument:xmlns:office:1.0"'
    ' xmlns:table="urn:oasis:names:tc:opendocument:xmlns:table:1.0"'
    ' xmlns:text="urn:oasis:names:tc:opendocument:xmlns:text:1.0"><office:body><office:spreadsheet>'
    '<table:table table:name="a">{}</table:table></office:spreadsheet></office:body>'
    "</office:document-content>"
)
_CELL = (
    '<table:table-cell office:value-type="{}" {} table:number-columns-repeated="{}"><text:p>{}</text:p>'
    "</table:table-cell>"
)


def _ods(rows: str) -> bytes:
    mime = "application/vnd.oasis.opendocument.spreadsheet"
    said = '<manifest:manifest xmlns:manifest="urn:oasis:names:tc:opendocument:xmlns:manifest:1.0">'
    said += f'<manifest:file-entry manifest:full-path="/" manifest:media-type="{mime}"/>'
    said += "</manifest:manifest>"
    return _zip({"mimetype": mime, "META-INF/manifest.xml": said, "content.xml": _ODS.format(rows)})


def ods_numbers() -> bytes:
    """Numbers, repeated over columns and rows, a thousand times beyond the limit."""
    cell = _CELL.format("float", 'office:value="1"', 16_384, "1")
    return _ods(f'<table:table-row table:number-rows-repeated="1048576">{cell}</table:table-row>')


def ods_empty() -> bytes:
    """Empty cells, repeated, with a number at the far end."""
    cell = '<table:table-cell table:number-columns-repeated="1000000"/>' + _CELL.format(
        "float", 'office:value="1"', 1, "1"
    )
    row = f"<table:table-row>{cell}</table:table-row>"
    return _ods(f'<table:table-row table:number-rows-repeated="1000000"/>{row * 20}')


def ods_words() -> bytes:
    """A long text, repeated within what is allowed for cells."""
    cell = _CELL.format("string", "", 16_000, "x" * 30_000)
    return _ods(f'<table:table-row table:number-rows-repeated="300">{cell}</table:table-row>')


_MAIN = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
_REL = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
_PACK = "http://schemas.openxmlformats.org/package/2006"


def xlsx(sheet: str, strings: str = "") -> bytes:
    """A workbook of one sheet with these rows and shared texts."""
    types = "application/vnd.openxmlformats-officedocument.spreadsheetml"
    return _zip({
        "[Content_Types].xml": f'<Types xmlns="{_PACK}/content-types">'
        f'<Override PartName="/xl/workbook.xml" ContentType="{types}.sheet.main+xml"/></Types>',
        "_rels/.rels": f'<Relationships xmlns="{_PACK}/relationships"><Relationship Id="r1"'
        f' Type="{_REL}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": f'<workbook {_MAIN} xmlns:r="{_REL}"><sheets>'
        '<sheet name="a" sheetId="1" r:id="r1"/></sheets></workbook>',
        "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{_PACK}/relationships">'
        f'<Relationship Id="r1" Type="{_REL}/worksheet" Target="worksheets/sheet1.xml"/>'
        f'<Relationship Id="r2" Type="{_REL}/sharedStrings" Target="sharedStrings.xml"/></Relationships>',
        "xl/sharedStrings.xml": f"<sst {_MAIN}>{strings}</sst>",
        "xl/worksheets/sheet1.xml": f"<worksheet {_MAIN}><sheetData>{sheet}</sheetData></worksheet>",
    })  # fmt: skip


def xlsx_words(rows: int = 1000) -> bytes:
    """One long shared text in a hundred cells of each row."""
    row = "<row>" + '<c t="s"><v>0</v></c>' * 100 + "</row>"
    return xlsx(row * rows, f"<si><t>{'x' * 1_000_000}</t></si>")


def parquet_words() -> bytes:
    """A column of one long text."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    words = pa.DictionaryArray.from_arrays(
        pa.array(np.zeros(2_000_000, np.int32)), pa.array(["x" * 20_000])
    )
    table = pa.table({"t": np.arange(2_000_000.0), "y": np.zeros(2_000_000), "w": words})
    out = io.BytesIO()
    pq.write_table(table, out)
    return out.getvalue()


def parquet_rows() -> bytes:
    """Forty million rows of one number."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    out, table = io.BytesIO(), pa.table({"u": np.zeros(5_000_000), "y": np.zeros(5_000_000)})
    with pq.ParquetWriter(out, table.schema) as writer:
        for _ in range(8):
            writer.write_table(table)
    return out.getvalue()


def bag_packed(size: int = 2_000_000_000) -> bytes:
    """A bag of the first ROS whose chunk holds 2 GB of nothing."""
    packer, packed = bz2.BZ2Compressor(9), io.BytesIO()
    for _ in range(size // 10_000_000):
        packed.write(packer.compress(bytes(10_000_000)))
    packed.write(packer.flush())

    def record(fields: dict[str, bytes], data: bytes) -> bytes:
        head = b"".join(
            struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v
            for k, v in fields.items()
        )
        return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data

    said = struct.pack("<I", size)
    chunk = record({"op": b"\5", "compression": b"bz2", "size": said}, packed.getvalue())
    mark, begin = b"#ROSBAG V2.0\n", 13 + 4096
    named = {"topic": b"/a", "type": b"std_msgs/Float64", "md5sum": b"fdb28210bfa9d7c91146260178d9a584",
             "message_definition": b"float64 data"}  # fmt: skip
    said = b"".join(
        struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v for k, v in named.items()
    )
    connection = record({"op": b"\7", "conn": struct.pack("<I", 0), "topic": b"/a"}, said)
    none, ones = struct.pack("<I", 0), struct.pack("<I", 1)
    index = record(
        {"op": b"\4", "ver": ones, "conn": none, "count": ones}, struct.pack("<III", 1, 0, 0)
    )
    info = record(
        {"op": b"\6", "ver": ones, "chunk_pos": struct.pack("<Q", begin), "count": ones,
         "start_time": struct.pack("<II", 1, 0), "end_time": struct.pack("<II", 2, 0)},
        struct.pack("<II", 0, 1),
    )  # fmt: skip
    at = struct.pack("<Q", begin + len(chunk) + len(index))
    head = record({"op": b"\3", "index_pos": at, "conn_count": ones, "chunk_count": ones}, b"")
    return mark + head.ljust(4096, b" ") + chunk + index + connection + info


_METADATA = """rosbag2_bagfile_information:
  version: 5
  storage_identifier: {kind}
  relative_file_paths: [{file}]
  duration: {{nanoseconds: 100}}
  starting_time: {{nanoseconds_since_epoch: 1}}
  message_count: 10
  topics_with_message_count:
    - message_count: 10
      topic_metadata:
        {{name: /a, type: std_msgs/msg/Float64, serialization_format: cdr, offered_qos_profiles: ''}}
  compression_format: '{packed}'
  compression_mode: '{mode}'
"""


def _rosbag(
    folder: Path, file: str, content: bytes, kind: str, packed: str = "", mode: str = ""
) -> Path:
    folder.mkdir()
    (folder / file).write_bytes(content)
    words = _METADATA.format(kind=kind, file=file, packed=packed, mode=mode)
    (folder / "metadata.yaml").write_text(words)
    return folder


def _database(folder: Path, script: str) -> bytes:
    place = folder.parent / f"{folder.name}.db3"
    with sqlite3.connect(place) as base:
        base.executescript(script)
    base.close()
    return place.read_bytes()


_TOPICS = (
    "create table topics(id integer primary key, name text, type text, serialization_format text,"
    " offered_qos_profiles text);"
    "insert into topics values(1, '/a', 'std_msgs/msg/Float64', 'cdr', '');"
)
_ENDLESS = (
    "with recursive n(k) as (select 1 union all select k + 1 from n) select k as id, 1 as topic_id,"
    " k as timestamp, zeroblob(12) as data from n"
)


def db3_view(folder: Path) -> Path:
    """A view without end beside the messages, which a column of theirs cannot reach."""
    script = _TOPICS + "create table messages(id integer primary key, topic_id integer, timestamp"
    script += " integer, data blob generated always as (zeroblob(900000000)) virtual);"
    script += "".join(
        f"insert into messages(topic_id, timestamp) values(1, {k});" for k in range(10)
    )
    return _rosbag(folder, "a.db3", _database(folder, script), "sqlite3")


def db3_messages(folder: Path) -> Path:
    """The messages are a view that never ends."""
    script = f"{_TOPICS}create view messages as {_ENDLESS};"
    return _rosbag(folder, "a.db3", _database(folder, script), "sqlite3")


def db3_zstd(folder: Path) -> Path:
    """Messages of 500 MB, each packed into some kilobytes."""
    packed = _zstd(500_000_000)
    place = folder.parent / f"{folder.name}.db3"
    with sqlite3.connect(place) as base:
        base.executescript(_TOPICS)
        base.execute("create table messages(id integer primary key, topic_id, timestamp, data)")
        for k in range(5):
            base.execute("insert into messages values(?, 1, ?, ?)", (k, k, packed))
    base.close()
    return _rosbag(folder, "a.db3", place.read_bytes(), "sqlite3", "zstd", "message")


def _zstd(size: int) -> bytes:
    try:
        from compression import zstd  # type: ignore[import-not-found]
    except ImportError:
        from backports import zstd
    return zstd.compress(bytes(size))


def mcap_packed(folder: Path, size: int = 2_000_000_000) -> Path:
    """A chunk of 2 GB of nothing."""
    import lz4.frame

    packed = lz4.frame.compress(bytes(size))
    body = struct.pack("<QQQI", 1, 2, size, 0) + struct.pack("<I", 3) + b"lz4"
    body += struct.pack("<Q", len(packed)) + packed
    mark = b"\x89MCAP0\r\n"
    head = b"\1" + struct.pack("<Q", 12) + struct.pack("<I", 4) + b"ros2" + bytes(4)
    chunk = b"\6" + struct.pack("<Q", len(body)) + body
    end = b"\x0f" + struct.pack("<Q", 4) + bytes(4)
    foot = b"\2" + struct.pack("<Q", 20) + bytes(20)
    return _rosbag(folder, "a.mcap", mark + head + chunk + end + foot + mark, "mcap")


def lvm_endless() -> bytes:
    """A LabVIEW file whose header never ends."""
    return b"LabVIEW Measurement\t\nSeparator\tTab\n" + b"Channels\t2\t\t\nX0\t0\t0\n" * 400_000


def uff_declared() -> bytes:
    """A binary data set that declares more than it holds."""
    head = "    -1\n    58b     1     2          11    1999999999     0     0           0           0\n"
    return (head + "a\n" * 11).encode() + bytes(2000) + b"\n    -1\n"


def json_wide() -> bytes:
    """Objects that have no key in common."""
    return b"".join(b'{"k%d": 1}\n' % k for k in range(200_000))


VENDOR = Path(__file__).resolve().parents[3] / "shared" / "vendor"
"""Files of makers, which may not be handed on."""
AT_ONCE, EACH = 500, 125
"""Files that lie on the disk together, and those that one process reads."""


def mutated(quick: bool, count: int = 5000) -> list[Row]:
    """Files of makers with bytes changed, cut and repeated, lines swapped and lengths changed."""
    if not VENDOR.is_dir():
        return [noted("files of makers, damaged", 0, reason="needs ../shared/vendor")]
    count, random = 25 if quick else count, np.random.default_rng(5)
    good = {
        f.name: f.read_bytes() for f in sorted(VENDOR.iterdir()) if f.suffix not in (".md", ".json")
    }
    wrong, read, slowest, largest = 0, 0, 0.0, 0.0
    for begin in range(0, count, AT_ONCE):
        places = []
        for k in range(begin, min(begin + AT_ONCE, count)):
            name = [*good][k % len(good)]
            places.append(Path(f"{k} {name}"))
            places[-1].write_bytes(mutation(good[name], random))
        shares = [places[k : k + EACH] for k in range(0, len(places), EACH)]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            ended = [*chain.from_iterable(pool.map(read_apart, shares))]
        for place, (said, seconds, peak) in zip(places, ended, strict=True):
            read += said.startswith("read")
            slowest, largest = max(slowest, seconds), max(largest, peak)
            if said.startswith("!") or seconds > SECONDS or peak > LARGEST_MB:
                wrong += 1
                print(f"{place}: {said}, {seconds:.1f} s, {peak:.0f} MB", file=sys.stderr)
            else:
                place.unlink()
    beyond = f"more than {LARGEST_MB} MB or {SECONDS:g} s"
    what = f"files of {len(good)} makers damaged at random: crashes, {beyond}, of {count:,}"
    return [
        judged(what, wrong, 0),
        noted(
            f"    read, in percent; at most {slowest:.1f} s and {largest:.0f} MB",
            100 * read / count,
        ),
    ]


def mutation(data: bytes, random: np.random.Generator) -> bytes:
    """A file after one to three accidents."""
    for _ in range(random.integers(1, 4)):
        data = _ACCIDENTS[random.integers(len(_ACCIDENTS))](data, random)
    return data


def _flipped(data: bytes, random: np.random.Generator) -> bytes:
    raw = np.frombuffer(data, np.uint8).copy()
    at = random.integers(
        0, max(min(len(raw), 10 ** int(random.integers(1, 7))), 1), random.integers(1, 30)
    )
    if len(raw):
        raw[at] = random.choice([0, 255, 127, *random.integers(0, 256, 5)], at.size)
    return raw.tobytes()


def _cut(data: bytes, random: np.random.Generator) -> bytes:
    a, b = np.sort(random.integers(0, len(data) + 1, 2))
    return (data[:a], data[a:], data[a:b], data[:a] + data[b:])[random.integers(4)]


def _repeated(data: bytes, random: np.random.Generator) -> bytes:
    a = int(random.integers(0, len(data) + 1))
    part = data[a : a + int(random.integers(1, 4000))]
    return data[:a] + part * int(random.integers(2, 60)) + data[a:]


def _lines(data: bytes, random: np.random.Generator) -> bytes:
    lines = data.splitlines(keepends=True) or [b""]
    for _ in range(random.integers(1, 20)):
        a, b = random.integers(0, len(lines), 2)
        lines[a], lines[b] = lines[b], lines[a]
    return b"".join(lines)


def _lengths(data: bytes, random: np.random.Generator) -> bytes:
    raw = bytearray(data)
    for _ in range(random.integers(1, 4)):
        value = int(
            random.choice([0, 1, -1, 2**31 - 1, -(2**31), 10**9, int(random.integers(1000))])
        )
        at = 4 * int(random.integers(0, min(len(raw), 4096) // 4 + 1))
        raw[at : at + 4] = struct.pack(random.choice(["<i", ">i"]), value)
    return bytes(raw)


def _numbers(data: bytes, random: np.random.Generator) -> bytes:
    found = [*re.finditer(rb"\d+", data[:20_000])]
    for one in sorted(random.choice(len(found), min(3, len(found)), False) if found else [])[::-1]:
        said = random.choice([b"0", b"-1", b"999999999", b"1e308", b"", b"1e-320", b"x"])
        data = data[: found[one].start()] + bytes(said) + data[found[one].end() :]
    return data


_ACCIDENTS = (_flipped, _cut, _repeated, _lines, _lengths, _numbers)


FILES: dict[str, Callable[[], bytes]] = {
    "numbers.ods": ods_numbers, "empty.ods": ods_empty, "words.ods": ods_words, "words.xlsx": xlsx_words,
    "words.parquet": parquet_words, "rows.parquet": parquet_rows, "packed.bag": bag_packed,
    "endless.lvm": lvm_endless, "declared.uff": uff_declared,
    "wide.json": json_wide,
}  # fmt: skip
FOLDERS: dict[str, Callable[[Path], Path]] = {
    "generated": db3_view, "endless": db3_messages, "zstd": db3_zstd, "mcap": mcap_packed,
}  # fmt: skip


def bombs(quick: bool) -> list[Row]:
    """Each bomb in a process of its own, so that its memory is its own."""
    if quick:
        return [noted("bombs", 0, reason="takes minutes: run without --quick")]
    places = []
    for name, make in FILES.items():
        Path(name).write_bytes(make())
        places.append(Path(name))
    places += [make(Path(name)) for name, make in FOLDERS.items()]
    wrong = 0
    for place in places:
        ((said, seconds, peak),) = read_apart([place])
        bad = said.startswith("!") or seconds > SECONDS or peak > LARGEST_MB
        wrong += bad
        if bad:
            print(f"{place}: {said}, {seconds:.1f} s, {peak:.0f} MB", file=sys.stderr)
    what = f"bombs that take more than {LARGEST_MB} MB or {SECONDS:g} s, or crash, of {len(places)}"
    return [judged(what, wrong, 0)]
