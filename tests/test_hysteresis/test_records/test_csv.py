"""Reading CSV: every good dialect reads the same; most bad files are those of `test_bad_inputs`."""

import csv
import io
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import hysid
from hysteresis import InputError, Record, read_csv, read_table
from tests.refusals import refuses

X, F, T = "Disp (mm)", "Force (N)", "Time (s)"
ROWS = [(0.1 * k, k % 7, 2.5 * (k % 7)) for k in range(20)]


def table(rows: list[tuple] = ROWS, header: str = f"{T},{X},{F}", sep: str = ",") -> str:
    return "\n".join([header, *(sep.join(map(str, row)) for row in rows)]) + "\n"


@pytest.fixture
def read(tmp_path):
    def _read(content: str | bytes, input: str = X, output: str = F, **options: Any) -> Record:
        path = tmp_path / "run.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_csv(path, input, output, **options)

    return _read


def with_cell(line: int, cells: str) -> str:
    lines = table().splitlines()
    lines[line - 1] = cells
    return "\n".join(lines)


def test_a_row_of_units(read):
    text = table().replace("\n", "\ns,mm,kN\n", 1).replace(T, "t").replace(F, "F").replace(X, "x")
    record = read(text, "x", "F", time="t")
    assert (record.input_unit, record.output_unit, record.time_unit) == ("mm", "kN", "s")
    assert (len(record), record.line[0]) == (len(ROWS), 3)
    note = "Row 2 is units (s, mm, kN); using them. Confirm with units_row=2"
    assert any(note in sentence for sentence in record.history)
    confirmed = read(text, "x", "F", units_row=2)
    assert not any("Confirm" in sentence for sentence in confirmed.history)
    refuses("bad-units-row", lambda: read(text, "x", "F", units_row=5), "Line 5", "--units-row 2")
    below = read(f"# rig 3\n{text}", "x", "F")
    assert any("Row 3 is units" in s and "units_row=3" in s for s in below.history)
    refuses("text-cell", lambda: read(text, "x", "F", units_row=0), "line 2", "'mm'", "units_row=2")
    # A specimen called A is no ampere.
    named = "sample;x;F\nA;1,5;2,5\nA;;\nA;2,5;3,5\n"
    assert len(read(named, "x", "F", decimal=",", nan="interpolate")) == 3


def test_a_cell_of_text(read):
    text = with_cell(9, "0.7,0,OVLD")
    words = ("line 9", f"'{F}'", "'OVLD'", "overload", "na_values", "--na-values OVLD")
    refuses("text-cell", lambda: read(text), *words)
    record = read(text, na_values=["OVLD"], nan="omit")
    assert np.flatnonzero(~record.mask).tolist() == [7]
    coded = read(with_cell(9, "0.7,0,-999.0"), na_values=["-999"], nan="omit")
    assert coded.mask.sum() == 19
    other = text.replace("0.8,1,2.5", "0.8,1,stop")
    refuses("text-cell", lambda: read(other, na_values=["OVLD"], nan="omit"), "line 10", "'stop'")
    every = table([(t, x, f"{y} N") for t, x, y in ROWS])  # a row of units is alone
    refuses("text-cell", lambda: read(every), "line 2", "text among", "--na-values '0.0 N'")
    words = ("a decimal point", "leave --decimal away")
    refuses("text-cell", lambda: read(table(), decimal=","), *words)
    swedish = table([(t, x, str(-y).replace("-", "\u2212")) for t, x, y in ROWS])
    np.testing.assert_array_equal(read(swedish).output, [-y for *_, y in ROWS])
    refuses("text-cell", lambda: read(with_cell(9, "0.7,0,1_5")), "line 9", "'1_5'")  # a name
    endless = with_cell(9, f"0.7,0,{'9' * 300}")  # no number is that long
    refuses("text-cell", lambda: read(endless), "line 9", f"'{F}'", "'999")


@pytest.mark.parametrize("change", [
    lambda s: s.replace("\n", "\r").encode(),
    lambda s: s.replace("\n", ",\n").encode(),
    lambda s: (s.split("\n", 1)[0] + "\n" + s.split("\n", 1)[1].replace("\n", ",\n")).encode(),
    lambda s: s.replace(",", " , ").encode(),
    lambda s: s.replace(f"{T},{X}", f'"{T}","{X}"').encode(),
    lambda s: ("# rig 3, 20 °C\n\n" + s + "# end\n\n").encode(),
    lambda s: ("# 20 °C\n" + s).encode("latin-1"),
    lambda s: s.rstrip("\n").encode(),
])  # fmt: skip
def test_dialects_read_alike(read, change):
    assert read(change(table()), time=T).digest() == read(table(), time=T).digest()


@pytest.mark.parametrize("rows", [100, 12_000, 40_000])
def test_an_excerpt_of_a_small_file_is_the_file(tmp_path, rows: int):
    file = tmp_path / "rows.csv"
    file.write_text("t,x\n" + "".join(f"{k},{k % 50}\n" for k in range(rows)))
    table = read_table(file, most=10)
    assert table.share == 1
    np.testing.assert_array_equal(table.columns["t"], np.arange(rows))


def test_groups_where_and_keep(read):
    rows = [(s, r, k, 2 * k, k % 3) for k in range(4) for s in "ab" for r in (1, 2, 10)]
    text = table(rows, "sample,run,x_mm,f_N,part")
    record = read(text, "x_mm", "f_N", group=["sample", "run"], dt=0.5, keep=["part"])
    assert record.labels == ("a/1", "a/2", "a/10", "b/1", "b/2", "b/10")
    assert np.array_equal(record.time, np.tile(0.5 * np.arange(4), 6))
    assert np.array_equal(record.columns["part"], record.input % 3)
    # One name is not a list of letters.
    one = read(text, "x_mm", "f_N", keep="part", condition="run")
    assert "part" in one.columns
    assert list(one.conditions) == ["run"]
    some = read(text, "x_mm", "f_N", group="sample", where={"run": ["2", "10.0"]})
    assert (len(some), some.labels) == (16, ("a", "b"))
    refuses("no-match", lambda: read(text, "x_mm", "f_N", where={"run": ["3"]}), "run=3", "10")
    refuses("bad-option", lambda: read(table(), time=T, dt=0.1), "--dt")
    refuses("bad-option", lambda: read(table(), dt=0.0), "--dt")
    refuses("bad-option", lambda: read(table(), decimal=";"), "--decimal")


def test_conditions(tmp_path):
    path, kinds = tmp_path / "run.csv", ["4,a,4.0", "5,b=c,ref", "6,a,4"]
    rows = [f"{kinds[k % 3]},{k},{k * k}" for k in range(30)]
    path.write_text("\n".join(["run,name,mix,x,y", *rows]))

    def held_out(condition: str) -> list[bool]:
        columns = {"input": "x", "output": "y", "dt": 1.0}
        ((_, test),) = hysid.records(path, **columns, test_where=[condition]).values()
        return test.mask[:3].tolist()

    wanted = {
        "run=4": [1, 0, 0], "run=4.0,6": [1, 0, 1], "name=a": [1, 0, 1], "name=b=c": [0, 1, 0],
        "mix=4": [1, 0, 1], "run%2=0": [1, 0, 1], "run%3=1,2": [1, 1, 0],
    }  # fmt: skip
    assert {text: held_out(text) for text in wanted} == wanted
    for text in ("run", "=4", "run=", "run=4,"):
        refuses("bad-condition", lambda text=text: held_out(text), "COL=VALUE")
    refuses("no-column", lambda: held_out("runs=4"), "'run'")
    refuses("no-match", lambda: held_out("name=z"))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.tuples(*[st.floats(-1e9, 1e9, allow_subnormal=False)] * 3), min_size=2, max_size=30
    ),
    st.sampled_from([",", ";", "\t", "|"]),
    st.sampled_from([".", ","]),
    st.sampled_from(["\n", "\r\n"]),
    st.sampled_from(["utf-8", "utf-8-sig", "latin-1", "utf-16"]),
    st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL]),
    st.booleans(),
)
def test_any_dialect_reads_back_identically(
    tmp_path, rows, sep, decimal, end, encoding, quoting, comment
):
    names = ["Angle (°)", "x_mm", "Force, net [N]"]
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, delimiter=sep, lineterminator=end, quoting=quoting)
    writer.writerow(names)
    for row in rows:
        writer.writerow([repr(x).replace(".", decimal) for x in row])
    text = f"# a comment{end}" * comment + stream.getvalue()
    path = tmp_path / "random.csv"
    path.write_bytes(text.encode(encoding))
    read = read_table(path, decimal=decimal)
    for name, column in zip(names, zip(*rows, strict=True), strict=True):
        assert np.array_equal(read.number(name), column)
    assert read.line.tolist() == list(range(2 + comment, 2 + comment + len(rows)))


@given(st.binary(max_size=300))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_bytes_give_a_table_or_an_input_error(tmp_path, data):
    path = tmp_path / "noise.csv"
    path.write_bytes(data)
    try:
        found = read_table(path)
    except InputError:
        return
    assert all(len(x) == len(found.line) for x in found.columns.values())


def test_a_header_that_is_repeated_begins_a_run(read):
    """A logger that was started again appends its header and its row of units."""
    once = table().replace("\n", "\ns,mm,N\n", 1).replace(T, "t").replace(F, "F").replace(X, "x")
    record = read(once + "\n" + once, "x", "F", time="t", segments="auto")
    assert record.starts.tolist() == [0, len(ROWS)]
    assert any("repeat the header: 2, first line 24" in note.text for note in record.history)
