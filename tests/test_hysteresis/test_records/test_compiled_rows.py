"""Large texts: the compiled parser gives the table of the careful reader, whatever is in them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hysteresis import InputError, read_table

READER = "hysteresis.records._read_table"
ROWS = 1300
LOOPS = [(f"{0.01 * k:.2f}", f"{k % 97 - 48}.5", f"-{k % 89}.25e-3") for k in range(ROWS)]
HEADER = "time (s),force (N),x (mm)"


def lines(sep: str = ",", header: str = HEADER, end: str = "") -> list[str]:
    return [header.replace(",", sep), *(sep.join(row) + end for row in LOOPS)]


def changed(at: int, line: str, rows: list[str] | None = None) -> list[str]:
    """Rows with another one at a line that the head does not reach."""
    found = list(rows or lines())
    found[at - 1] = line
    return found


def each(change) -> list[str]:
    """Every seventh row changed."""
    return [change(s) if k % 7 == 3 else s for k, s in enumerate(lines())]


COMPILED = {
    "short row at the end": changed(1200, "1,2,"),
    "overloads": each(lambda s: f"{s.rpartition(',')[0]},OVLD"),
    "plain": lines(),
    "semicolons": lines(";"),
    "bars and blanks": lines(" | "),
    "tabs": lines("\t"),
    "ends with a separator": lines(end=","),
    "both end with a separator": lines(header=f"{HEADER},", end=","),
    "quoted": ['"time (s)","force (N)","x (mm)"', *(f'"{"".join(a)}","{b}","{c}"' for a, b, c in LOOPS)],
    "row of units": ["t,F,x", "s,N,mm", *lines()[1:]],
    "comment above": ["# rig 3", "", *lines()],
    "empty cells": each(lambda s: s.replace(s.split(",")[1], "", 1)),
    "empty last cells": each(lambda s: s.rpartition(",")[0] + ","),
    "words for nothing": each(lambda s: f"{s.rpartition(',')[0]}, N/A "),
    "NaN": each(lambda s: f"{s.rpartition(',')[0]},-NaN"),
    "words": [f"label,{HEADER}", *(f"A {k % 5}, {s}" for k, s in enumerate(lines()[1:]))],
    "blank lines": changed(1000, ""),
    "a comment": changed(1000, "# here the pump stopped, 1, 2"),
    "infinite": changed(1100, "1,inf,3"),
    "notes above": ["Rig 3", "Operator,Meier", "", *lines()],
    "MTS": [
        "MTS793|BTW|ENU|1|2|.|/|:|1|0|0|A", "", "Data Acquisition:\tTimed", "",
        "Time\tForce\tDisp", "s\tkN\tmm", *lines("\t")[1:],
    ],
    "numbers alone": lines()[1:],
    "blanks": ["# t F x", *(" ".join(row) for row in LOOPS)],
}  # fmt: skip
CAREFUL = {
    "a cell of two lines": [*lines()[:1100], '1,"a', 'b",3', *lines()[1100:]],
    "a word": changed(1100, "1,stop,3"),
    "an underscore": changed(1100, "1,1_000,3"),
    "a quoted cell": changed(1100, '1, "2.5",3'),
    "a quotation mark": changed(1100, '1,2"5,3"'),
    "empty rows at the end": [*lines(), ",,"],
    "not ASCII": changed(1100, "1,2,3µ"),
    "notes below": ["Rig 3", "Operator,Meier", "", *lines(), "End of test"],
    "two tables": ["Rig 3", "Operator,Meier", "", *lines(), "", *lines()],
    "missing under notes": changed(1100, "1,,3", ["Rig 3", "Operator,Meier", "", *lines()]),
}
FAULTS = {
    "ragged": changed(1100, "1,2"),
    "decimal commas": [HEADER, *lines()[1:900], *("1,5,2,5,3,5" for _ in range(2000))],
    "open quote": changed(1100, '1,"2,3'),
}


@pytest.fixture
def both(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The table with the compiled parser, and without; heads and blocks are small."""
    monkeypatch.setattr(f"{READER}.HEAD", 2**13)
    monkeypatch.setattr(f"{READER}.LEAST_LINES", 420)
    monkeypatch.setattr("hysteresis.records._compiled_rows.BLOCK", 2**12)

    def read(text: str, **asked) -> tuple[Any, Any]:
        file = tmp_path / "run.csv"
        file.write_bytes(text.encode())
        found = read_table(file, **asked)
        with monkeypatch.context() as careful:
            careful.setattr(f"{READER}._by_its_head", lambda *_: None)
            return found, read_table(file, **asked)

    return read


def is_compiled(table: Any) -> bool:
    return not isinstance(table.text, dict)


def assert_same(one: Any, other: Any) -> None:
    assert list(one.columns) == list(other.columns)
    for name, x in one.columns.items():
        assert x.dtype.kind == other.columns[name].dtype.kind
        assert np.array_equal(x, other.columns[name], equal_nan=x.dtype.kind == "f")
        assert np.array_equal(one.text[name], other.text[name])
    assert np.array_equal(one.line, other.line)
    for key in ("units", "written_units", "notes", "decimal", "sha256", "share"):
        assert getattr(one, key) == getattr(other, key)


@pytest.mark.parametrize(("number", "name"), list(enumerate(COMPILED)))
def test_a_large_text_reads_as_a_small_one(both, number: int, name: str):
    end = ("\n", "\r\n")[number % 2]
    found, careful = both(end.join(COMPILED[name]) + end)
    assert is_compiled(found)
    assert_same(found, careful)


@pytest.mark.parametrize("name", CAREFUL)
def test_what_is_not_plain_is_read_carefully(both, name: str):
    found, careful = both("\n".join(CAREFUL[name]))
    assert not is_compiled(found)
    assert_same(found, careful)


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_the_careful_readers(both, name: str, tmp_path: Path, monkeypatch):
    with pytest.raises(InputError) as caught:
        both("\n".join(FAULTS[name]))
    monkeypatch.setattr(f"{READER}._by_its_head", lambda *_: None)
    with pytest.raises(InputError) as careful:
        read_table(tmp_path / "run.csv")
    assert str(caught.value) == str(careful.value)


def test_decimal_commas_and_words_for_missing_values(both):
    text = "\n".join(lines(";")).replace(".", ",")
    assert_same(*both(text, decimal=","))
    assert_same(*both(text.replace(";10,5;", ";-999;"), decimal=",", na_values=("-999,0",)))
    found, careful = both(text.replace(";10,5;", ";-999,9;"), decimal=",", na_values=("-999.9",))
    assert np.isnan(found.columns["force (N)"]).any()  # as `check` writes the mark
    assert_same(found, careful)
    marked = "\n".join(each(lambda s: f"{s.rpartition(',')[0]},OVLD"))
    found, careful = both(marked, na_values=("ovld", "-48.5"))
    assert is_compiled(found)
    assert np.isnan(found.columns["x (mm)"]).sum() == 186
    assert_same(found, careful)
