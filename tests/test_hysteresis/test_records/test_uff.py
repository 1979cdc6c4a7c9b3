"""Universal files: data sets 58 in text and binary, even and uneven; what is damaged is named."""

import numpy as np
import pytest

from hysteresis import read_table
from tests.refusals import refuses

T = 0.25 * np.arange(9)
F, X = np.sin(T), np.cos(T)
HEAD = (
    "{name}\nNONE\n05-Nov-20 10:00:00\nNONE\nNONE\n"
    "{function:5d}         1    1         1 NONE               1   3 NONE               0   0\n"
    "{kind:10d}{count:10d}{even:10d}  0.00000e+00  2.50000e-01  0.00000e+00\n"
    "{axis:10d}    0    0    0 Time                 s                   \n"
    "         8    0    0    0 Quantity             {unit:<20}\n"
    "         0    0    0    0 NONE                 NONE                \n"
    "         0    0    0    0 NONE                 NONE                \n"
)


def data_set(
    name: str, unit: str, y: np.ndarray, *, uneven: bool = False, binary: str = "", kind: int = 2,
    function: int = 1, axis: int = 17,
) -> bytes:  # fmt: skip
    about = {"name": name, "unit": unit, "kind": kind, "count": len(y), "even": int(not uneven)}
    head = HEAD.format(function=function, axis=axis, **about).encode()
    values = np.stack([T, y], 1).ravel() if uneven else y
    if not binary:
        body = "".join(f"{v:13.5e}" + ("\n" if k % 6 == 5 else "") for k, v in enumerate(values))
        return b"    -1\n    58\n" + head + body.encode() + b"\n    -1\n"
    wide = f"{binary}f{4 if kind == 2 else 8}"
    raw = y.astype(wide).tobytes()
    if uneven:
        both = np.zeros(len(y), [("x", f"{binary}f4"), ("y", wide)])
        both["x"], both["y"] = T, y
        raw = both.tobytes()
    order = 1 if binary == "<" else 2
    mark = (
        f"    58b{order:6d}     2          11{len(raw):12d}     0     0           0           0\n"
    )
    return b"    -1\n" + mark.encode() + head + raw + b"\n    -1\n"


@pytest.mark.parametrize("options", [
    {}, {"uneven": True}, {"binary": "<"}, {"binary": ">", "kind": 4},
    {"binary": "<", "kind": 4, "uneven": True},
])  # fmt: skip
def test_channels_over_time_are_columns(options, tmp_path):
    file = tmp_path / "run.uff"
    other = data_set("PSD", "g", X[:5], function=9, axis=18)
    parts = [data_set("Load", "N", F, **options), other, data_set("LVDT", "mm", X, **options)]
    file.write_bytes(b"".join(parts))
    table = read_table(file)
    assert list(table.columns) == ["time", "Load", "LVDT"]
    assert dict(table.units) == {"time": "s", "Load": "N", "LVDT": "mm"}
    for name, x in (("time", T), ("Load", F), ("LVDT", X)):
        np.testing.assert_allclose(table.columns[name], x, atol=1e-5)
    assert "skipped" in {note.code for note in table.notes}


def test_of_several_clocks_one_is_read(tmp_path):
    file = tmp_path / "run.uff"
    file.write_bytes(data_set("a", "N", F) + data_set("b", "N", X[:5]) + data_set("c", "mm", X))
    assert list(read_table(file).columns) == ["time", "a", "c"]
    assert list(read_table(file, table=2).columns) == ["time", "b"]
    refuses("bad-option", lambda: read_table(file, table=3), "table 1 to 2")


@pytest.mark.parametrize(("content", "code"), [
    (data_set("a", "N", F)[:-60], "damaged-file"),
    (data_set("a", "N", F).replace(b"    2         9", b"    2 999999999"), "damaged-file"),
    (data_set("a", "N", F, binary="<")[:-30], "damaged-file"),
    (data_set("PSD", "g", F, function=9, axis=18), "no-rows"),
    (data_set("FRF", "g", F, kind=5), "no-rows"),
    (b"    -1\n   151\nmodel\n    -1\n", "no-rows"),
    (b"    -1\n    58\nshort\n", "no-rows"),
])  # fmt: skip
def test_what_cannot_be_read_is_named(content, code, tmp_path):
    file = tmp_path / "run.uff"
    file.write_bytes(content)
    refuses(code, lambda: read_table(file))
