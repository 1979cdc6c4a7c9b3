"""Topics of one log, each with stamps of its own: a row holds the columns of one of them."""

import numpy as np
import pytest

from hysteresis import read_table
from tests.test_hysid.command import run

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
