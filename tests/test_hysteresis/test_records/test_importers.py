"""Files as machines write them: the table is found, its units, its pieces, its decimal sign."""

import io
import sys

import h5py
import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import csc_array

from hysteresis import InputError, read_csv, read_table
from tests.refusals import refuses

N = 12
T = 0.5 * np.arange(N)
X = np.abs((np.arange(N) % 8) - 4.0) / 4
F = 3 * X**2 + 0.125


def rows(*columns: np.ndarray, sep: str = ",", comma: bool = False, quote: str = "") -> str:
    lines = (sep.join(f"{quote}{v:.4f}{quote}" for v in row) for row in zip(*columns, strict=True))
    text = "\n".join(lines) + "\n"
    return text.replace(".", ",") if comma else text


BLUEHILL = (
    '"Test method","Loops.im_tens"\n"Width : 10.5 mm"\n\n"Results Table 1"\n'
    '"","Maximum Load","Energy"\n"","(N)","(mJ)"\n"1","3.12","0.4"\n"2","3.10","0.5"\n\n'
    '"Results Table 2"\n"Time","Extension","Load"\n"(s)","(mm)","(N)"\n' + rows(T, X, F, quote='"')
)
MTS_HEAD = "Running Time\tAxial Displacement\tAxial Load\nSec\tmm\tN\n"
MTS = (
    "MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A\n\nData Acquisition\t\t\tTime:\t4\tSec\n"
    + MTS_HEAD
    + rows(T[:5], X[:5], F[:5], sep="\t")
    + "\nData Acquisition\t\t\tTime:\t8\tSec\n"
    + MTS_HEAD
    + rows(T[5:], X[5:], F[5:], sep="\t")
)
TESTWORKS = (
    "Sample ID:\tsponge 3\nTest Date:\t11/3/2019\n\nCrosshead\tLoad\tTime\nmm\tN\tsec\n"
    + rows(X, F, T, sep="\t")
)
TRIOS = (
    "Filename\trun.tri\nInstrument name\tRSA-G2\n\n[step]\nAxial - 1\nStep time\tGap\tAxial force\n"
    "s\tmm\tN\n"
    + rows(T[:6], X[:6], F[:6], sep="\t")
    + "\n[step]\nAxial - 2\nStep time\tGap\tAxial force\ns\tmm\tN\n"
    + rows(T[6:], X[6:], F[6:], sep="\t")
)
TEXTURE = (
    "\tgel 1\t\t\tgel 2\n"
    "Force (g)\tDistance (mm)\tTime (sec)\tForce (g)\tDistance (mm)\tTime (sec)\n"
    + rows(F, X, T, 2 * F, X, T, sep="\t")
)
FIXED = (
    "Station: press 3\n\nTime      Axial Force  Axial Displacement\ns         N            mm\n"
    + "".join(f"{t:<10.2f}{f:<13.4f}{x:.4f}\n" for t, f, x in zip(T, F, X, strict=True))
)  # fmt: skip
CREEP = "chem=PE;label=M3;T=150;stress=10;\nt\tstrain\tstress\tT\ns\t-\tPa\tC\n" + rows(
    T + 1, F, np.full(N, 10.0), np.full(N, 150.0), sep="\t"
)
LVM = "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\n"
LVM += "Decimal_Separator\t{d}\nMulti_Headings\t{m}\nX_Columns\t{x}\nTime_Pref\tRelative\n"
LVM += "***End_of_Header***\t\n\t\n"
SEGMENT = (
    "Channels\t2\t\t\nSamples\t6\t6\t\nY_Unit_Label\tmm\tNewton\t\nX_Dimension\tTime\tTime\t\n"
    "X0\t0.0000000E+0\t0.0\t\nDelta_X\t0.500000\t0.500000\t\n***End_of_Header***\t\t\t\n"
)


def lvm(kind: str, body: str, decimal: str = ".", multi: str = "No") -> str:
    return LVM.format(d=decimal, m=multi, x=kind) + body


@pytest.mark.parametrize(("content", "time", "x", "force"), [
    (BLUEHILL, "Time", "Extension", "Load"),
    (MTS, "Running Time", "Axial Displacement", "Axial Load"),
    (TESTWORKS, "Time", "Crosshead", "Load"),
    (TRIOS, "Step time", "Gap", "Axial force"),
    (FIXED, "Time", "Axial Displacement", "Axial Force"),
], ids=["Bluehill", "MTS", "TestWorks", "TRIOS", "fixed columns"])  # fmt: skip
def test_the_table_of_a_machine_is_found(table, content, time, x, force):
    found = table(content)
    for name, values, unit in ((time, T, "s"), (x, X, "mm"), (force, F, "N")):
        np.testing.assert_allclose(found.columns[name], values, atol=1e-4)
        assert found.units[name] == unit
    record = read_csv(found, input=force, output=x)
    assert (record.input_unit, record.output_unit) == ("N", "mm")
    # Every row knows its line: an error in it can be found.
    lines = content.split("\n")
    for k in (0, N - 1):
        assert f"{F[k]:.4f}".replace(".", found.decimal) in lines[found.line[k] - 1]


def test_the_pieces_of_a_file_are_told_apart(table):
    blocks, steps = table(MTS), table(TRIOS)
    assert blocks.text["block"].tolist() == ["1"] * 5 + ["2"] * 7
    assert steps.text["step"].tolist() == ["Axial - 1"] * 6 + ["Axial - 2"] * 6
    assert any("2 tables under one another" in note for note in steps.notes)
    results = table(BLUEHILL)
    assert "Maximum Load" not in results.columns
    assert any("Left out 2 rows of other tables" in note for note in results.notes)


def test_tables_side_by_side_come_under_one_another(table):
    found = table(TEXTURE)
    assert list(found.columns) == ["curve", "Force (g)", "Distance (mm)", "Time (sec)"]
    assert found.text["curve"].tolist() == ["gel 1"] * N + ["gel 2"] * N
    np.testing.assert_allclose(found.columns["Force (g)"], np.append(F, 2 * F), atol=1e-4)
    bare = TEXTURE.split("\n", 1)[1]
    assert table(bare).text["curve"].tolist() == ["1"] * N + ["2"] * N
    uneven = TEXTURE.replace("\n", "\n", 1).rstrip("\n") + "\n\t\t\t9\t9\t9\n"
    assert len(table(uneven).line) == 2 * N + 1
    record = read_csv(table(TEXTURE), "Force (g)", "Distance (mm)", group="curve", input_unit="gf")
    assert record.labels == ("gel 1", "gel 2")


@pytest.mark.parametrize(
    ("above", "count"), [("", N), ("Valve test\nOperator,me\n\n", N), ("", 30_000)]
)
def test_a_mean_below_the_table_is_no_reading(table, above, count):
    """A program's statistics; the second of them went into the readings, and took the clock away."""
    t = 0.5 * np.arange(count)
    text = above + "Time (s),Force (N)\n" + rows(t, np.sin(t))
    for below in ("Mean,0.5\n", "Mean,0.5\nMaximum,3.1\nEnd of test\n"):
        found = table(text + below)
        assert len(found.line) == count
        assert found.columns["Time (s)"][-1] == t[-1]
        assert any(f"first line {text.count(chr(10)) + 1}" in note for note in found.notes)
    phases = table("Phase,Force (N)\n" + "".join(f"rise,{y:.3f}\n" for y in F))
    assert len(phases.line) == N
    missing = table(above + "Time (s),Force (N)\n" + rows(T, F) + "nan,0.5\n")
    assert len(missing.line) == N + 1
    lines = text.replace(",", "  ").splitlines()
    assert len(table("\n".join([*lines[:-2], "", *lines[-2:], "Mean  0.5"])).line) == count


def test_a_line_that_is_no_row_does_not_end_the_table(table):
    lines = TESTWORKS.splitlines(keepends=True)
    broken = table("".join([*lines[:9], "operator went for lunch\n", *lines[9:]]))
    assert len(broken.line) == N
    assert any("Left out 1 lines that are no row, first line 10" in n for n in broken.notes)
    assert broken.line[-1] == len(lines) + 1


def test_a_note_and_columns_that_do_not_move(table):
    found = table(CREEP)
    assert found.units == {"t": "s", "strain": "1", "stress": "Pa", "T": "C"}
    assert set(found.columns["stress"]) == {10.0}
    # A header wider than its rows: the columns without a cell are not there.
    short = "a=1;\nt\tstrain\tstress\ns\t-\tPa\n" + rows(T, F, sep="\t")
    assert list(table(short).columns) == ["t", "strain"]


def test_labview_with_a_clock_for_each_channel(table):
    body = "X_Value\tweg\tX_Value\tkraft\tComment\n"
    found = table(lvm("Multi", SEGMENT + body + rows(T, X, T + 0.1, F, sep="\t")), "run.lvm")
    assert list(found.columns) == ["X_Value weg", "weg", "X_Value kraft", "kraft"]
    same = table(lvm("Multi", SEGMENT + body + rows(T, X, T, F, sep="\t")), "run.lvm")
    assert list(same.columns) == ["X_Value", "weg", "kraft"]
    np.testing.assert_allclose(same.columns["kraft"], F, atol=1e-4)


def test_labview_segments_are_told_apart(table):
    part = SEGMENT + "X_Value\tweg\tkraft\tComment\n" + rows(T[:6], X[:6], F[:6], sep="\t") + "\t\n"
    found = table(lvm("One", part + part, multi="Yes"), "run.lvm")
    assert found.text["segment"].tolist() == ["1"] * 6 + ["2"] * 6
    np.testing.assert_allclose(found.columns["X_Value"], np.tile(T[:6], 2))
    bare = part + part.split("Comment\n")[1]  # one heading for all
    assert len(table(lvm("One", bare), "run.lvm").line) == 12


@pytest.mark.parametrize(("content", "code"), [
    ("LabVIEW Measurement\t\nSeparator\tTab\n", "damaged-file"),
    (lvm("One", SEGMENT), "no-rows"),
    (b"PK\x03\x04workbook", "binary-file"),
    (b"\xd0\xcf\x11\xe0" + bytes(64), "binary-file"),
    (b"\x89PNG\r\n\x1a\n" + bytes(64), "binary-file"),
])  # fmt: skip
def test_what_cannot_be_read_is_said(table, content, code):
    refuses(code, lambda: table(content, "run.lvm"), "run.lvm")


@pytest.mark.parametrize(("module", "extra", "head"), [
    ("nptdms", "rigs", b"TDSm"),
    ("python_calamine", "rigs", None),
    ("pyarrow", "parquet", b"PAR1PAR1"),
    ("rosbags", "ros", b"#ROSBAG V2.0\n"),
])  # fmt: skip
def test_a_reader_that_is_not_installed_is_named(table, monkeypatch, module, extra, head):
    content = head or _empty_workbook()
    monkeypatch.setitem(sys.modules, module, None)
    refuses("missing-extra", lambda: table(content), f"pip install 'hysid[{extra}]'")


def _empty_workbook() -> bytes:
    import zipfile

    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("xl/workbook.xml", "<workbook/>")
    return packed.getvalue()


def test_a_workbook(table):
    openpyxl = pytest.importorskip("openpyxl", reason="openpyxl is an extra")
    book = openpyxl.Workbook()
    results = book.active
    results.title = "results"
    for row in (["specimen", "peak", "work"], [1, 3.1, 0.4], [2, 3.2, 0.5]):
        results.append(row)
    for name in ("probe 1", "probe 2"):
        sheet = book.create_sheet(name)
        for row in ([name], ["Zeit", "Weg", "Kraft"], ["s", "mm", "N"]):
            sheet.append(row)
        for row in zip(T, X, F, strict=True):
            sheet.append([float(v) for v in row])
    packed = io.BytesIO()
    book.save(packed)
    found = table(packed.getvalue(), "run.xlsx")
    assert found.text["sheet"].tolist() == ["probe 1"] * N + ["probe 2"] * N
    np.testing.assert_array_equal(found.columns["Kraft"], np.tile(F, 2))
    assert found.units == {"Zeit": "s", "Weg": "mm", "Kraft": "N"}


def test_tdms(table):
    nptdms = pytest.importorskip("nptdms", reason="npTDMS is an extra")
    packed = io.BytesIO()
    step = {"wf_increment": 0.5, "wf_start_offset": 0.0}
    with nptdms.TdmsWriter(packed) as writer:
        for group in ("run 1", "run 2"):
            force = nptdms.ChannelObject(group, "force", F, {"unit_string": "N", **step})
            position = nptdms.ChannelObject(group, "position", X, {"unit_string": "mm", **step})
            writer.write_segment([force, position])
    found = table(packed.getvalue(), "run.tdms")
    assert list(found.columns) == ["group", "time", "force", "position"]
    assert found.units == {"time": "s", "force": "N", "position": "mm"}
    np.testing.assert_array_equal(found.columns["force"], np.tile(F, 2))
    np.testing.assert_allclose(found.columns["time"], np.tile(T, 2))
    whole = packed.getvalue()
    for damaged in (whole[:4] + b"\xff" * 40, whole[:60]):
        with pytest.raises(InputError) as caught:
            table(damaged, "cut.tdms")
        assert caught.value.code in ("damaged-file", "no-rows")


def test_packed_numbers_of_netcdf(table):
    packed = io.BytesIO()
    with h5py.File(packed, "w") as file:
        file["t"], file["F"] = T, np.round(100 * F).astype(np.int16)
        file["F"][3] = -32768
        file["t"].attrs["units"] = "hours since 2026-01-01"
        fill = np.array([-32768], np.int16)
        file["F"].attrs.update({"scale_factor": 0.01, "add_offset": 5.0, "_FillValue": fill})
    found = table(packed.getvalue(), "run.nc")
    wanted = np.where(np.arange(len(F)) == 3, np.nan, np.round(100 * F) / 100 + 5)
    np.testing.assert_allclose(found.columns["F"], wanted)
    assert found.units == {"t": "hours"}


@pytest.mark.parametrize("kind", ["structures", "7.3", "HDF5"])
def test_files_of_arrays(table, kind):
    packed, words = io.BytesIO(), np.array(["x", "y"] * N)[:N]
    if kind in ("7.3", "HDF5"):
        with h5py.File(packed, "w", userblock_size=512 if kind == "7.3" else 0) as file:
            for run in ("a", "b"):
                for name, x in (("t", T), ("F", F), ("Z", 1j * F), ("w", words.astype("S"))):
                    given = x[None] if kind == "7.3" else x
                    data = file.create_dataset(f"{run}/{name}", data=given)
                    data.attrs["unit"] = "N" if name == "F" else "s"
        content = packed.getvalue()
        content = b"MATLAB 7.3 MAT-file" + content[19:] if kind == "7.3" else content
    else:
        odd = {"w": words.astype(object), "v": words, "s": csc_array(F[:, None])}
        savemat(packed, {run: {"t": T, "F": F, "Z": 1j * F, **odd} for run in "ab"})
        content = packed.getvalue()
    found = table(content, "run.mat")
    np.testing.assert_array_equal(found.columns["F"], np.tile(F, 2))
    assert "group" in found.columns
    assert found.units == ({} if kind == "structures" else {"t": "s", "F": "N"})
    assert "Z" not in found.columns
    assert sum("complex numbers: 'Z'" in note for note in found.notes) == 2
    others = "'w', 'v', 's'." if kind == "structures" else "'w'."
    assert sum(f"are text, cells or sparse: {others}" in note for note in found.notes) == 2
    for damaged in (content[:300], content[: len(content) // 2]):
        with pytest.raises(InputError) as caught:
            table(damaged, "cut.mat")
        assert caught.value.code in ("damaged-file", "binary-file", "no-rows")


def test_parquet(table):
    arrow = pytest.importorskip("pyarrow", reason="pyarrow is an extra")
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is an extra")
    fields = [arrow.field("F", arrow.float64(), metadata={"unit": "N"}),
              arrow.field("x", arrow.float32()), arrow.field("run", arrow.string()),
              arrow.field("t", arrow.duration("ms"))]  # fmt: skip
    packed = io.BytesIO()
    columns = [F, X.astype(np.float32), ["a"] * N, 500 * np.arange(N)]
    parquet.write_table(arrow.table(columns, arrow.schema(fields)), packed)
    found = table(packed.getvalue(), "run.parquet")
    np.testing.assert_array_equal(found.columns["F"], F)
    assert found.units == {"F": "N", "t": "s"}
    np.testing.assert_array_equal(found.columns["t"], np.arange(N) / 2)
    assert set(found.text["run"]) == {"a"}


@pytest.mark.parametrize("generation", [1, 2])
def test_ros_bag(tmp_path, generation):
    bags = pytest.importorskip(f"rosbags.rosbag{generation}", reason="rosbags is an extra")
    types = pytest.importorskip("rosbags.typesys", reason="rosbags is an extra")
    kinds = types.Stores
    store = types.get_typestore(kinds.ROS1_NOETIC if generation == 1 else kinds.LATEST)
    vector = store.types["geometry_msgs/msg/Vector3"]
    path = tmp_path / ("run.bag" if generation == 1 else "run")
    packed = store.serialize_ros1 if generation == 1 else store.serialize_cdr
    with bags.Writer(path, **({} if generation == 1 else {"version": 9})) as writer:
        kind = vector.__msgtype__
        topics = [writer.add_connection(t, kind, typestore=store) for t in ("/f", "/x")]
        for k in range(N):
            stamp = 10**9 * (1_700_000_000 + k)
            for topic, x, every in zip(topics, (F, X), (1, 2), strict=True):
                if k % every == 0:
                    writer.write(topic, stamp, packed(vector(x[k], 0.0, 0.0), vector.__msgtype__))
    found = read_table(path)
    np.testing.assert_array_equal(found.columns["time"], np.arange(N))
    np.testing.assert_array_equal(found.columns["/f.x"], F)
    np.testing.assert_array_equal(found.columns["/x.x"][::2], X[::2])
    assert any("/x (6) are interpolated" in note for note in found.notes)
    whole = path if generation == 1 else next(path.glob("*.db3"))
    whole.write_bytes(whole.read_bytes()[:200])
    refuses("damaged-file", lambda: read_table(path))


def test_an_input_on_its_own_clock_is_moved_to_the_output(table):
    late = T + 0.2
    text = "run,t_u,u,t_y,y\n" + "".join(
        f"{r},{a:.3f},{2 * a:.4f},{b:.3f},{b:.4f}\n" for r in "ab" for a, b in zip(T, late, strict=True)
    )  # fmt: skip
    found = table(text)
    record = read_csv(found, "u", "y", time="t_y", input_time="t_u", group="run")
    inner = np.tile(late <= T[-1], 2)
    np.testing.assert_allclose(record.input[inner], np.tile(2 * late, 2)[inner], atol=1e-9)
    np.testing.assert_allclose(record.input[~inner], 2 * T[-1])
    assert any("clock" in note for note in record.history)
    refuses("bad-option", lambda: read_csv(found, "u", "y", input_time="t_u"), "--time COL")
    with pytest.raises(InputError, match="go back at different rows"):
        read_csv(table(text.replace("b,0.000", "b,9.000")), "u", "y", time="t_y", input_time="t_u")
