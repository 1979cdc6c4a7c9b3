"""What files say of their columns at their beginning, in the ways in which rigs and scripts say it."""

import json

import numpy as np
import pytest

from hysteresis import InputError, read_table

T = 0.5 * np.arange(12)
X = np.abs((np.arange(12) % 8) - 4.0) / 4
F = 3 * X**2 + 0.125


@pytest.fixture
def table(tmp_path):
    def _read(content: str, name: str = "run.txt"):
        path = tmp_path / name
        path.write_text(content, encoding="utf-8")
        return read_table(path)

    return _read


def rows(*columns: np.ndarray, sep: str = "\t") -> str:
    lines = (sep.join(f"{v:.4f}" for v in row) for row in zip(*columns, strict=True))
    return "\n".join(lines) + "\n"


OBJECTS = [{"t_s": t, "ft": {"z": f, "xy": [0.0, None]}} for t, f in zip(T, F, strict=True)]
LINES = "\n".join(map(json.dumps, OBJECTS))


@pytest.mark.parametrize(
    "text",
    [LINES, LINES.replace("\n", "\n\n"), json.dumps(OBJECTS), json.dumps(OBJECTS, indent=2),
     f"[\n{LINES.replace(chr(10), ',' + chr(10))}\n]\n", LINES + '\n{"t_s": 3.0, "ft'],
)  # fmt: skip
def test_objects_are_rows(text, table):
    found = table(text)
    assert list(found.columns) == ["t_s", "ft.z", "ft.xy.0", "ft.xy.1"]
    np.testing.assert_allclose(found.number("ft.z"), F)
    assert np.isnan(found.number("ft.xy.1")).all()


def test_lists_in_an_object_are_columns(table):
    found = table(json.dumps({"time_s": T.tolist(), "force_N": F.tolist()}))
    np.testing.assert_allclose(found.number("force_N"), F)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ('{"a": 1}\n{"a": 2, b}\n{"a": 3}\n', "damaged-file"),
        ('{"settings": {"rate": 100}}', "no-rows"),
        ('{"a": ' + 4000 * "[", "damaged-file"),
        ("\n".join(f'{{"k{k}": 1}}' for k in range(3000)), "too-many-columns"),
    ],
)
def test_json_that_holds_no_table_is_refused_by_name(text, code, table):
    with pytest.raises(InputError, match=r"JSON|objects") as caught:
        table(text)
    assert caught.value.code == code
