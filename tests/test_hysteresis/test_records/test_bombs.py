"""Files that would unpack, nest or name without end, or declare more than they hold: refused at once."""

import contextlib
import io
import os
import struct
import sys
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.io import savemat

from benchmarks._ruggedness import bombs
from hysteresis import InputError, _limits, read_table
from hysteresis._limits import DAMAGE, DEEPEST, LARGEST_TOML, load_arrays, parse_json, parse_toml
from tests.refusals import refuses
from tests.workbooks import binary_workbook, old_workbook

ROWS = "".join(f"{k},{k * k}\n" for k in range(30))


def refused(file: Path, code: str, *words: str) -> None:
    """At once, and in words that name the limit or the place."""
    begin = perf_counter()
    refuses(code, lambda: read_table(file), *words)
    assert perf_counter() - begin < 20.0  # most take less than one second; without limits, hours


NAMES = ",".join(f"c{k}" for k in range(10_001))


@pytest.mark.parametrize(("content", "code", "words"), [
    # With an open quotation mark, the rest of the file is one cell.
    *(
        (f"a,b\n{ROWS}1,{quote}{'1' * 200_000}\n{ROWS}", "long-cell",
         ("line 32", "131,072 characters"))
        for quote in ('"', "")
    ),
    # An array of text gives each of 30,000 cells the room of the longest one.
    ("a,b\n" + "1,2\n" * 30_000 + f"1,{'x' * 3000}\n", "long-cell",
     ("line 30002", "'b'", "characters")),
    (f"{NAMES}\n{','.join('1' * 10_001)}\n", "too-many-columns", ("10,001", "10,000")),
])  # fmt: skip
def test_cells_and_columns_have_an_end(tmp_path: Path, content: str, code: str, words):
    (tmp_path / "run.csv").write_text(content)
    refused(tmp_path / "run.csv", code, *words)


@pytest.mark.parametrize(("needs", "name", "make", "code", "words"), [
    ("python_calamine", "run.xlsx", lambda: bombs.xlsx_words(3), "damaged-file",
     "more than 256,000,000 characters"),
    ("pyarrow", "run.parquet", bombs.parquet_words, "long-cell", "'w'"),
])  # fmt: skip
def test_words_have_an_end(tmp_path: Path, needs: str, name: str, make: Any, code: str, words: str):
    pytest.importorskip(needs)
    (tmp_path / name).write_bytes(make())
    refused(tmp_path / name, code, words)


def tdms(samples: int) -> bytes:
    """Two channels in one file whose index says `samples` of each, with data for twenty."""
    nptdms = pytest.importorskip("nptdms")
    packed = io.BytesIO()
    step = {"wf_increment": 0.1}
    channels = [nptdms.ChannelObject("g", name, np.arange(20.0), step) for name in ("force", "x")]
    with nptdms.TdmsWriter(packed) as writer:
        writer.write_segment(channels)
    # Each index holds the kind of number (10: double), one dimension, and the count.
    was, now = (struct.pack("<iIQ", 10, 1, count) for count in (20, samples))
    assert packed.getvalue().count(was) == 2
    return packed.getvalue().replace(was, now)


def test_samples_that_a_file_does_not_hold(tmp_path: Path):
    file = tmp_path / "run.tdms"
    file.write_bytes(tdms(20))
    assert len(read_table(file).line) == 20
    for samples in (21, 2**31, 2**40, 2**62):
        file.write_bytes(tdms(samples))
        begin = perf_counter()
        # npTDMS takes a piece that is cut off for what it holds.
        with contextlib.suppress(InputError):
            assert len(read_table(file).line) <= 40
        assert perf_counter() - begin < 5.0


NUMBERS = [(k, c, float(k + c)) for k in range(1, 21) for c in (0, 1)]
CELLS = [(0, 0, "force"), (0, 1, "x"), *NUMBERS]

FAR = '\n<row r="1000000000"><c r="A1000000000"><v>1</v></c></row>\n'


@pytest.mark.parametrize(("content", "ending"), [
    (bombs.xlsx(FAR), "xlsx"),
    (bombs.ods_words(), "ods"),
    (old_workbook([*CELLS, (65_535, 16_383, 1.0)]), "xls"),
    (old_workbook(CELLS, (2**31, 2)), "xls"),
    (binary_workbook([*CELLS, (65_535, 16_383, 1.0)]), "xlsb"),
])  # fmt: skip
@pytest.mark.skipif(sys.platform == "win32", reason="memory has no end there")
def test_a_workbook_that_asks_for_gigabytes(content: bytes, ending: str, tmp_path: Path):
    """It spans a thousand million cells, or says a long text again and again: 9 kB, read as 100 GB."""
    pytest.importorskip("python_calamine")
    file = tmp_path / f"run.{ending}"
    file.write_bytes(content)
    refused(file, "damaged-file", "more than 2,147,483,648 bytes of memory")


@pytest.mark.parametrize(("make", "ending"), [(old_workbook, "xls"), (binary_workbook, "xlsb")])
def test_a_sheet_that_is_nearly_empty_is_read(make: Any, ending: str, tmp_path: Path):
    pytest.importorskip("python_calamine")
    file = tmp_path / f"run.{ending}"
    for content in (make(CELLS, (65_536, 256)), make([*CELLS, (60_000, 20, 1.0)])):
        file.write_bytes(content)
        np.testing.assert_array_equal(read_table(file).number("x"), np.arange(2.0, 22.0))


def test_a_bag_that_unpacks_or_computes_without_end(tmp_path: Path):
    pytest.importorskip("rosbags")
    ways = (
        (bombs.db3_zstd, "unpacks to more than"),
        (bombs.db3_view, "messages in a.db3 holds no data of its own"),
        (bombs.db3_messages, "messages in a.db3 holds no data of its own"),
    )
    for k, (make, words) in enumerate(ways):
        refused(make(tmp_path / str(k)), "damaged-file", words)


@pytest.mark.thorough
def test_a_bag_packed_in_blocks_that_unpacks_without_end(tmp_path: Path):
    pytest.importorskip("rosbags")
    file = tmp_path / "run.bag"
    file.write_bytes(bombs.bag_packed(300_000_000))
    refused(file, "damaged-file", "unpacks to more than 256,000,000 bytes")
    refused(bombs.mcap_packed(tmp_path / "m", size=300_000_000), "damaged-file", "unpacks to more")


@pytest.mark.parametrize("packed", [False, True])
def test_a_damaged_mat_file_does_not_end_the_process(packed: bool, tmp_path: Path):
    """SciPy's reader crashes on some of these; whole ones are read as ever."""
    u, whole = np.sin(np.arange(20.0)), io.BytesIO()
    savemat(whole, {"s": {"force": u, "x": u, "who": "me"}}, do_compression=packed)
    file = tmp_path / "run.mat"
    file.write_bytes(whole.getvalue())
    np.testing.assert_array_equal(read_table(file).number("x"), u)
    random, refused = np.random.default_rng(0), 0
    for k in np.linspace(128, len(whole.getvalue()) - 4, 4).astype(int):
        content = bytearray(whole.getvalue())
        content[k : k + 4] = random.choice([b"\0" * 4, b"\xff" * 4, b"\x7f" * 4, b"\0", b"\x09"])
        file.write_bytes(content)
        try:
            read_table(file)
        except InputError:
            refused += 1
    assert refused > 1


def hdf5(tmp_path: Path, *, matlab: bool, make: Callable[[Any], None]) -> Path:
    """A file with a good column `u`, and what `make` adds."""
    h5py = pytest.importorskip("h5py")
    file = tmp_path / ("run.mat" if matlab else "run.h5")
    with h5py.File(file, "w", userblock_size=512 if matlab else 0) as group:
        group["u"] = np.linspace(0.0, 1.0, 30)
        make(group)
    return file


SECRET = np.arange(30.0)


def outside(tmp_path: Path) -> dict[str, Callable[[Any], None]]:
    """Ways in which a data set may say that its values lie in another file."""
    import h5py

    secret, fifo = tmp_path / "secret.bin", tmp_path / "fifo"
    secret.write_bytes(SECRET.tobytes())
    os.mkfifo(fifo)
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["y"] = SECRET
    layout = h5py.VirtualLayout(30, float)
    layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "y", 30)

    def external(place: Path) -> Callable[[Any], None]:
        return lambda file: file.create_dataset("y", (30,), float, external=[(str(place), 0, 240)])

    def linked(file: Any) -> None:
        file["y"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "y")

    return {
        "external": external(secret),
        "a pipe": external(fifo),
        "virtual": lambda file: file.create_virtual_dataset("y", layout),
        "link": linked,
    }


@pytest.mark.parametrize("matlab", [False, True])
@pytest.mark.parametrize("way", ["external", "a pipe", "virtual", "link"])
def test_values_in_other_files_are_not_read(tmp_path: Path, way: str, matlab: bool):
    pytest.importorskip("h5py")
    file = hdf5(tmp_path, matlab=matlab, make=outside(tmp_path)[way])
    if way == "link":
        assert list(read_table(file).columns) == ["u"]
    else:
        refused(file, "damaged-file", "y lie in other files")


def test_arrays_of_a_small_file_that_declare_gigabytes(tmp_path: Path):
    """Chunks that were never written hold a fill value: 2 kB, read as 4 GB; or as many times 200 MB."""

    def one(file: Any) -> None:
        file.create_dataset("y", (500_000_000,), float, chunks=(1_000_000,), fillvalue=1.0)

    def many(file: Any) -> None:
        for k in range(20):
            file.create_dataset(f"y{k}", (25_000_000,), float, chunks=(1_000_000,), fillvalue=1.0)

    for make in (one, many):
        refused(hdf5(tmp_path, matlab=False, make=make), "damaged-file", "declares")


def test_a_list_of_an_archive_that_says_less_than_it_packs(tmp_path: Path):
    """200 MB of zeros in 200 kB, said to be 100 bytes: what is read ends there, and the sum is wrong."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("y.npy", "w") as member:
            about = {"descr": "<f8", "fortran_order": False, "shape": (1,)}
            np.lib.format.write_array_header_1_0(member, about)
            for _ in range(200):
                member.write(bytes(1_000_000))
        archive.getinfo("y.npy").file_size = 136
    raw = bytearray(packed.getvalue())
    tracemalloc.start()
    with pytest.raises(DAMAGE):
        load_arrays(io.BytesIO(raw))
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()


def test_a_column_of_one_value_and_a_thousand_million_rows(tmp_path: Path):
    pytest.importorskip("pyarrow")
    import pyarrow as pa
    import pyarrow.parquet as pq

    file, rows = tmp_path / "run.parquet", 5_000_000
    table = pa.table({"u": np.zeros(rows), "y": np.zeros(rows)})
    with pq.ParquetWriter(file, table.schema) as writer:
        for _ in range(8):
            writer.write_table(table)
    assert file.stat().st_size < 1e6
    refused(file, "damaged-file", "declares")


kinds = st.sampled_from(["f8", "f4", "i8", "i4", "?", "U3", "S2", "c16"])


@pytest.mark.parametrize(
    "bomb", ["[" * 10**6, '{"a":' * 10**5, "[" * 65 + "]" * 65, "[[]," * 10**5]
)
def test_nesting_has_an_end(bomb: str):
    with pytest.raises(ValueError, match=f"more than {DEEPEST} deep" if "[]" not in bomb else None):
        parse_json(bomb)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity"])
def test_what_json_does_not_have_is_refused(number: str):
    with pytest.raises(ValueError, match=number):
        parse_json(f'{{"a": [{number}]}}')


@pytest.mark.parametrize("bomb", [
    "a = " + "[" * 1000 + "]" * 1000, "a." * 20_000 + "b = 1", "[" + "a." * 20_000 + "b]\n",
    "x = {" + "a." * 20_000 + "b = 1}", '"a".' * 20_000 + "b = 1", "#" * (LARGEST_TOML + 1),
    "a = " + "{b = " * 1000,
])  # fmt: skip
def test_keys_and_tables_have_an_end(bomb: str):
    tracemalloc.start()
    with pytest.raises(ValueError, match=r"more than 64|the limit is 1,000,000"):
        parse_toml(bomb)
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()


@given(
    st.dictionaries(
        st.text("abc", min_size=1, max_size=3),
        hnp.arrays(kinds, hnp.array_shapes(min_dims=0, min_side=0)),
        max_size=3,
    ),
    st.booleans(),
)
def test_arrays_come_back(arrays: dict, packed: bool):
    file = io.BytesIO()
    (np.savez_compressed if packed else np.savez)(file, **arrays)
    found = load_arrays(io.BytesIO(file.getvalue()))
    assert found.keys() == arrays.keys()
    for name, array in arrays.items():
        assert found[name].dtype == array.dtype
        assert found[name].flags.writeable
        np.testing.assert_array_equal(found[name], array)


def npz(content: bytes, name: str = "a.npy") -> io.BytesIO:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr(name, content)
    return file


def header(shape: str, kind: str = "<f8") -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


@pytest.mark.parametrize(("content", "said"), [
    (header("(100000000000,)") + b"12345678", "declares 800,000,000,000 bytes"),
    (header("(3000000000, 3000000000, 3000000000)"), "declares"),
    (header("(-1,)"), "declares"),
    (header("(1,)", "|O") + b"12345678", "objects"),
    (header("(" * 900 + "1" + ",)" * 900), ""),
    (header("10**10**10"), ""),
    (header("(1,"), "cannot be read"),  # NumPy's reader of Python 2's headers raises TokenError
    (b"", ""),
    (b"\x93NUMPY\x09\x00aaaa", "version"),
])  # fmt: skip
def test_a_header_that_promises_more_is_refused(content: bytes, said: str):
    tracemalloc.start()
    with pytest.raises(DAMAGE, match=said or None):
        load_arrays(npz(content))
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()


def test_a_packed_file_does_not_unpack_to_gigabytes(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(_limits, "ALWAYS_UNPACKED", 2_000_000)
    file = io.BytesIO()
    with (
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed,
        packed.open("a.npy", "w") as to,
    ):
        to.write(header("(500000,)"))
        for _ in range(4):
            to.write(bytes(1_000_000))
    assert len(file.getvalue()) < 1e4
    words = r"would unpack to 4,000,\d+ bytes, and the limit .* 2,000,000"
    with pytest.raises(ValueError, match=words):
        load_arrays(file)
