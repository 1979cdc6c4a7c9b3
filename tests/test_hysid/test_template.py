"""The template distribution, installed, through the command line."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tests.test_hysid.command import ENVIRONMENT, Result

TEMPLATE = Path(__file__).parents[2] / "docs" / "template"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what an installer leaves there: the module, and the entry points of pyproject.toml.

    By hand, because a build backend would have to be fetched.
    """
    place = tmp_path_factory.mktemp("site")
    settings = tomllib.loads((TEMPLATE / "pyproject.toml").read_text("utf-8"))
    project = settings["project"]
    for name in settings["tool"]["hatch"]["build"]["targets"]["wheel"]["only-include"]:
        (place / name).write_bytes((TEMPLATE / name).read_bytes())
    info = place / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    groups = project["entry-points"]
    (info / "entry_points.txt").write_text(
        "".join(
            f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in entries.items())
            for group, entries in groups.items()
        )
    )
    return place


DRIVER = """
import json, sys
from tests.test_hysid.command import run
for words in json.loads(sys.argv[1]):
    print(json.dumps(run(*words)))
"""
"""Every command line of a list in one process, which compiles once."""


@pytest.mark.thorough
def test_a_model_of_another_distribution_goes_through_every_command(installed: Path, tmp_path):
    def hysid(*lines: str) -> list[Result]:
        path = f"{installed}:{ENVIRONMENT['PYTHONPATH']}"
        done = subprocess.run(
            [sys.executable, "-c", DRIVER, json.dumps([line.split() for line in lines])],
            cwd=tmp_path, text=True, capture_output=True, env=ENVIRONMENT | {"PYTHONPATH": path},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return [Result(*json.loads(line)) for line in done.stdout.splitlines()]

    for name, seed in (("run.csv", 0), ("other.csv", 1)):
        (tmp_path / name).write_text(measured(seed))
    columns = "--input u(mm) --output y(N) --test-cycles 1 --noise gaussian --starts 4 --json"
    fitted, line, reported, exported, forwards, backwards, qualified, sampled, compared = hysid(
        f"fit run.csv {columns} --model duhem --out fit",
        f"fit run.csv {columns} --model linearsponge --out line", "report fit --json",
        "export fit --runtime duhem.json", "predict fit other.csv --json",
        "predict fit other.csv --inverse --json", "qualify fit other.csv --json",
        "sample fit --steps 40 --ensembles 2 --json", "compare fit line --json",
    )  # fmt: skip
    document = fitted.json()
    assert document["model"] == "Duhem"
    found = {p["name"]: p["value"] for p in document["parameters"]}
    assert found == {
        "alpha": pytest.approx(0.5, rel=0.03),
        "beta": pytest.approx(1.0, rel=0.03),
        "gamma": pytest.approx(0.7, rel=0.03),
    }
    assert reported.code == 0, reported.err
    assert "Duhem" in (tmp_path / "fit" / "report.html").read_text("utf-8")
    assert exported.code == 2
    assert "Duhem cannot be exported" in exported.err
    assert not (tmp_path / "duhem.json").exists()
    assert forwards.json()["rmse"] < 0.01  # twice the noise
    assert backwards.json()["rmse"] < 0.02  # where it is flat, a reading is worth more input
    assert qualified.json()["errors"]["rmse"] == pytest.approx(backwards.json()["rmse"])
    drawn = {p["name"]: p for p in sampled.json()["parameters"]}
    assert drawn["alpha"]["mean"] == pytest.approx(found["alpha"], abs=4 * drawn["alpha"]["sd"])
    assert line.json()["model"] == "LinearSponge"
    assert "Duhem" in compared.out


def measured(seed: int) -> str:
    """The equation, in a thousand steps of Euler's method from row to row, and noise."""
    u = np.interp(np.arange(240) % 80, [0, 20, 60, 80], [0.0, 3.0, -2.0, 0.0])
    y, before, noise = 0.0, 0.0, np.random.default_rng(seed)
    rows = []
    for x in u:
        for k in range(1000):
            du = (x - before) / 1000
            y += 0.5 * abs(du) * (1.0 * (before + du * k) - y) + 0.7 * du
        before = x
        rows.append(f"{x},{y + noise.normal(0, 0.005)}\n")
    return "u(mm),y(N)\n" + "".join(rows)
