"""Tables as strangers write them: CSV, LabVIEW, TRIOS and others, TDMS and workbooks, whole and broken."""

import contextlib
import io
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from hypothesis import strategies as st

from tests.test_hysid.command import run
from tests.test_hysteresis.test_escape import HOSTILE
from tests.workbooks import binary_workbook, old_workbook

from .fuzzing import told

NAMES = (
    "time (s)",
    "force (N)",
    "displacement (mm)",
    "cycle",
    "a",
    "b",
    "force",
    "x [mm]",
    "U_V",
    "name",
)
ODD = (
    "",
    "nan",
    "NaN",
    "inf",
    "-inf",
    "1e999",
    "1e308",
    "1e200",
    "-0",
    "0x1F",
    "1,5",
    "1.234,5",
    "1 000",
    "OVLD",
    '"',
    '"a',
    "'",
    "#",
    "--",
    "1e",
    "e5",
    "12:30:01",
    "2024-01-01",
    "2024-01-01T10:00:00Z",
    "true",
    "°",
    "－１",
    "١٢",
    "1_000",
    "\0",
    "9" * 400,
    "9" * 5000,
    "x" * 140_000,
    "\u202e1",
    "=1+1",
    "mm",
    "N",
)
PREAMBLES = (
    "",
    "# made by a rig\n",
    "Test: 5\nOperator: me\n\n",
    "LabVIEW Measurement\t\nSeparator\tTab\n"
    "***End_of_Header***\t\nChannels\t2\t\nSamples\t9\t9\t\nDelta_X\t0.1\t0.1\n***End_of_Header***\t\n",
    "[step]\nramp\n",
    "MTS793|BTW|ENU|1|2|/|.|/|:|1|0|0|A\n",
    '"Results Table 1"\n',
    "Prüfzeit;Standardkraft\n",
    "Filename,run.txt\nProcedure Name,Flow\n\n",
    "\ufeff",
    "sep=;\n",
)
OPTIONS = (
    ("--decimal", ","),
    ("--where", "cycle = 99"),
    ("--where", "a < 0"),
    ("--where", "zzz = 1"),
    ("--hold", "cycle"),
    ("--group", "cycle"),
    ("--group", "name"),
    ("--each", "cycle"),
    ("--nan", "omit"),
    ("--nan", "interpolate"),
    ("--segments", "auto"),
    ("--time", "time (s)"),
    ("--dt", "0.1"),
    ("--units-row", "2"),
    ("--na-values", "OVLD"),
    ("--test-cycles", "1"),
    ("--test-where", "cycle = 1"),
    ("--test-tail", "0.3"),
    ("--input-time", "time (s)"),
    ("--condition", "cycle"),
    ("--input-unit", "10**10**10"),
    ("--step", "1"),
    ("--cycles", "1"),
    ("--separator", "\t"),
)


BYTES = (b"\xff" * 4, b"\0" * 4, b"\xff" * 8, b"\0", b"\x7f" * 4, b'"', b"\n")


class Case(NamedTuple):
    """A file's bytes, its ending, and the words of the command after its name."""

    content: bytes
    ending: str
    words: tuple[str, ...]


@st.composite
def options(draw: st.DrawFn, names: list[str]) -> tuple[str, ...]:
    """A command's words: columns that are there, or not, and some options."""
    a, b = names[0], names[-1]
    if draw(st.integers(0, 9)) == 0:
        a = draw(st.sampled_from([*names, "nothing", ""]))
    columns = ("--input", a, "--output", b)
    more = draw(st.lists(st.sampled_from(OPTIONS), max_size=3, unique_by=lambda o: o[0]))
    return (*columns, *(word for option in more for word in option))


@st.composite
def texts(draw: st.DrawFn) -> Case:
    """A text table with one to a few things that are not as they should be."""
    separator = draw(st.sampled_from(",,,;\t|"))
    names: list[str] = [*draw(st.permutations(NAMES))[: draw(st.integers(2, 5))]]
    if draw(st.integers(0, 3)) == 0:
        names[0] = draw(st.sampled_from(HOSTILE) | st.text(max_size=8))
    count, width = draw(st.sampled_from([0, 1, 2, 5, 12, 30, 60])), len(names)
    x = np.sin(np.arange(count)[:, None] * draw(st.floats(0.1, 2)) + np.arange(width))
    rows = [[f"{v:.4g}" for v in row] for row in x]
    for row in rows[:: draw(st.integers(1, 9))]:
        if draw(st.integers(0, 5)) == 0:
            row[draw(st.integers(0, width - 1))] = draw(st.sampled_from(ODD) | st.text(max_size=6))
    for _ in range(draw(st.integers(0, 2))):
        if rows:
            k = draw(st.integers(0, len(rows) - 1))
            rows[k] = draw(
                st.sampled_from(
                    [rows[k]] * 6 + [rows[k] * 2, rows[k][:-1], [], [*rows[k], ""], ["x"] * width]
                )
            )
    quoted = [f'"{n.replace(chr(34), chr(34) * 2)}"' if separator in n else n for n in names]
    end = draw(st.sampled_from(["\n", "\n", "\r\n", "\r"]))
    lines = [separator.join(row) for row in [quoted, *rows]]
    preamble = draw(st.sampled_from(["", "", "", "", *PREAMBLES]))
    text = preamble + end.join(lines) + draw(st.sampled_from(["", end, end * 3, '"']))
    encoding = draw(st.sampled_from(["utf-8"] * 5 + ["utf-16", "latin-1", "utf-8-sig"]))
    content = text.encode(encoding, "replace")
    return Case(
        broken(draw, content), draw(st.sampled_from(["csv", "txt", "lvm"])), draw(options(names))
    )


def broken(draw: st.DrawFn, content: bytes, most: int = 2) -> bytes:
    """Bytes cut off, overwritten or repeated."""
    for _ in range(max(draw(st.integers(-2, most)), 0)):
        at = draw(st.integers(0, max(len(content) - 1, 0)))
        with_ = draw(st.sampled_from(BYTES) | st.binary(max_size=4))
        how = draw(st.integers(0, 3))
        content = (
            content[:at] if how == 0
            else content[:at] + with_ + content[at + len(with_) :] if how < 3
            else content[:at] + content[at : at + 40] + content[at:]
        )  # fmt: skip
    return content


def good_binaries() -> dict[str, bytes]:
    """A small file of each binary kind whose library is installed."""
    found, u = {}, np.sin(np.arange(20.0))
    try:
        from nptdms import ChannelObject, TdmsWriter

        packed = io.BytesIO()
        with TdmsWriter(packed) as writer:
            about = {"wf_increment": 0.1, "unit_string": "N"}
            writer.write_segment([ChannelObject("g", n, u, about) for n in ("force", "x")])
        found["tdms"] = packed.getvalue()
    except ImportError:
        pass
    try:
        from openpyxl import Workbook

        packed, book = io.BytesIO(), Workbook()
        sheet: Any = book.active
        for row in [("force", "x"), *zip(u.tolist(), u.tolist(), strict=True)]:
            sheet.append(row)
        book.save(packed)
        found["xlsx"] = packed.getvalue()
    except ImportError:
        pass
    with contextlib.suppress(ImportError):
        import python_calamine  # noqa: F401 - what reads them

        cells = [
            (0, 0, "force"),
            (0, 1, "x"),
            *((k + 1, c, v) for k, v in enumerate(u.tolist()) for c in (0, 1)),
        ]
        found |= {"xls": old_workbook(cells, (21, 2)), "xlsb": binary_workbook(cells, (21, 2))}
    from scipy.io import savemat

    packed = io.BytesIO()
    savemat(packed, {"force": u, "x": u})
    found["mat"] = packed.getvalue()
    return found


@st.composite
def binaries(draw: st.DrawFn, good: dict[str, bytes]) -> Case:
    """A binary file, damaged."""
    kind = draw(st.sampled_from(sorted(good)))
    return Case(broken(draw, good[kind], 4), kind, ("--input", "force", "--output", "x"))


def checked(case: Case) -> str:
    """`hysid check` of a case, which writes nothing."""
    file = Path(f"run.{case.ending}")
    file.write_bytes(case.content)
    try:
        ended = told(run("check", file, *case.words))
        assert [p.name for p in Path().iterdir()] == [file.name], "a file was written"
    finally:
        file.unlink()
    return ended
