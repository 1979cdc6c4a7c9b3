"""The template distribution, installed, through the command line."""

import ast
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tests.test_hysid.command import ENVIRONMENT

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


def test_a_model_of_another_distribution_is_fitted_reported_and_refused_for_export(
    installed: Path, tmp_path: Path
):
    path = f"{installed}:{ENVIRONMENT['PYTHONPATH']}"

    def hysid(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "hysid", *words], cwd=tmp_path, text=True, capture_output=True,
            env=ENVIRONMENT | {"PYTHONPATH": path},
        )  # fmt: skip

    u = np.interp(np.arange(240) % 80, [0, 20, 60, 80], [0.0, 3.0, -2.0, 0.0])
    y, before, noise = 0.0, 0.0, np.random.default_rng(0)
    rows = []
    for x in u:  # the equation, in a thousand steps of Euler's method
        for _ in range(1000):
            du = (x - before) / 1000
            y += 0.5 * abs(du) * (1.0 * (before + du * _) - y) + 0.7 * du
        before = x
        rows.append(f"{x},{y + noise.normal(0, 0.005)}\n")
    (tmp_path / "run.csv").write_text("u (mm),y (N)\n" + "".join(rows))
    columns = ("--input", "u (mm)", "--output", "y (N)")
    quick = ("--noise", "gaussian", "--out", "fit", "--json")
    fitted = hysid("fit", "run.csv", *columns, "--model", "duhem", *quick)
    assert fitted.returncode == 0, fitted.stderr
    document = json.loads(fitted.stdout)
    assert document["model"] == "Duhem"
    found = {p["name"]: p["value"] for p in document["parameters"]}
    assert found == {
        "alpha": pytest.approx(0.5, rel=0.03),
        "beta": pytest.approx(1.0, rel=0.03),
        "gamma": pytest.approx(0.7, rel=0.03),
    }
    reported = hysid("report", "fit", "--json")
    assert reported.returncode == 0, reported.stderr
    assert "Duhem" in (tmp_path / "fit" / "report.html").read_text("utf-8")
    exported = hysid("export", "fit", "--runtime", "duhem.json")
    assert exported.returncode == 2
    assert "Duhem cannot be exported" in exported.stderr
    assert not (tmp_path / "duhem.json").exists()


def test_a_model_takes_fifteen_lines():
    """With its imports, without docstrings and `guess`, which is optional."""
    module = ast.parse((TEMPLATE / "hysid_duhem.py").read_text("utf-8"))
    (model,) = (part for part in module.body if isinstance(part, ast.ClassDef))
    used = {node.id for node in ast.walk(model) if isinstance(node, ast.Name)}
    imports = [
        part
        for part in module.body
        if isinstance(part, ast.Import | ast.ImportFrom)
        and used & {name.asname or name.name for name in part.names}
    ]
    assert isinstance(model.body[0], ast.Expr)  # the docstring
    parts = [*imports, *model.decorator_list, *model.body[1:]]
    written = "\n".join(map(ast.unparse, parts)).splitlines()
    assert len(written) + len(["class Duhem(...):"]) <= 15, written
