"""Rows named by the lines of their file, and quantities with stamps of their own."""

import numpy as np
import pytest

import hysid
from hysteresis import read_table
from tests.refusals import refuses
from tests.test_hysid.command import SPONGE, run

COLUMNS = {"input": "force (N)", "output": "displacement (mm)", "time": "time (s)"}


def records(**options):
    return hysid.records(SPONGE, **COLUMNS, **options)[""]


def test_excluded_rows_drive_the_model_and_do_not_count():
    whole, _ = records()
    train, test = records(exclude_lines=("2-11", "50"))
    assert test is None
    np.testing.assert_array_equal(train.input, whole.input)
    assert set(whole.line[~train.mask]) == {*range(2, 12), 50}
    assert train.history[-1].code == "excluded"


def test_held_out_lines_are_tested_and_excluded_ones_are_not():
    train, test = records(test_lines=("60-100",), exclude_lines=("90-95",))
    assert set(test.line[test.mask]) == {*range(60, 90), *range(96, 101)}
    assert not (train.mask & (test.mask | ((train.line >= 60) & (train.line <= 100)))).any()


@pytest.mark.parametrize(("options", "code"), [
    ({"exclude_lines": ("9-2",)}, "bad-option"),
    ({"exclude_lines": ("two",)}, "bad-option"),
    ({"test_lines": ("5000-6000",)}, "no-match"),
    ({"exclude_lines": ("2-5000",)}, "no-rows"),
    ({"test_lines": ("2-9",), "test_cycles": 1}, "conflicting-options"),
    ({"test_line": ("2-9",)}, "bad-option"),
    ({"test_cycles": "1"}, "bad-option"),
])  # fmt: skip
def test_lines_that_cannot_be_used(options, code):
    refuses(code, lambda: records(**options))


N = 200
T = 0.05 * np.arange(N)
Z = 5 * np.abs((np.arange(N) / 50 + 1) % 2 - 1)
FORCE = 2 * Z + np.where(np.gradient(Z) > 0, 0.4, -0.4) + 0.01 * np.sin(7.3 * np.arange(N))


def log(names: dict[str, int], columns: list[tuple[float, np.ndarray]]) -> str:
    """A table of columns by name and topic; each topic has a delay and its values (n,) or (n, m)."""
    lines = []
    for topic, (delay, values) in enumerate(columns):
        for t, v in zip(T + delay, np.reshape(values, (N, -1)), strict=True):
            own = iter(v)
            cells = [f"{next(own):.4f}" if at == topic else "" for at in names.values()]
            lines.append((t, f"{t + 1.7e9:.3f},{','.join(cells)}\n"))
    return f"__time,{','.join(names)}\n" + "".join(line for _, line in sorted(lines))


TWO = log({"/ft/force/z": 1, "/stage/position/z": 0}, [(0.0, Z), (0.013, FORCE)])
THREE = log(
    {"/stage/position/z": 0, "/ft/force/z": 1, "/ft/force/x": 1, "/room/temperature": 2},
    [(0.0, Z), (0.013, np.column_stack([FORCE, np.sin(T * 40)])), (0.03, 20 + 0.01 * T)],
)


@pytest.mark.parametrize("text", [TWO, THREE], ids=["two", "three"])
def test_topics_with_stamps_of_their_own_are_a_pair(text, tmp_path):
    file = tmp_path / "log.csv"
    file.write_text(text)
    told = run("init", file, "--json").json()
    chosen = told["selection"]
    assert {chosen["input"], chosen["output"]} == {"/stage/position/z", "/ft/force/z"}
    assert (chosen["time"], chosen["nan"]) == ("__time", "interpolate")
    assert told["rows"] == len(read_table(file).line)
    assert any(found["what"] == "in turn" for found in told["found"])


def test_parts_that_follow_one_another_are_not_in_turn(tmp_path):
    file = tmp_path / "log.csv"
    rows = [f"{t:.3f},{f:.4f},{z:.4f},," for t, f, z in zip(T, FORCE, Z, strict=True)]
    rows += [f"{t + 20:.3f},,,{f:.4f},{z:.4f}" for t, f, z in zip(T, FORCE, Z, strict=True)]
    file.write_text("time (s),force (N),pos (mm),force 2 (N),pos 2 (mm)\n" + "\n".join(rows) + "\n")
    told = run("init", file, "--json").json()
    assert not any(found["what"] == "in turn" for found in told["found"])
