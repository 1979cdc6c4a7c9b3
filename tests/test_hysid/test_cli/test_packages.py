"""Packages of the same names by others: said in one line, by every way in."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import hysid

ROOT = Path(hysid.__file__).parents[1]
OURS = ("hysteresis", "identify", "compensate", "hysid")


def python(place: Path, *words: str, path: Path = ROOT) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(path)}
    command = [sys.executable, *words]
    return subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True)


@pytest.mark.parametrize(("name", "kind"), [("identify", "file"), ("hysteresis", "folder")])
def test_a_file_in_the_current_folder(name: str, kind: str, tmp_path: Path):
    """It comes first on Python's path, and was never meant."""
    foreign = tmp_path / (f"{name}.py" if kind == "file" else f"{name}/__init__.py")
    foreign.parent.mkdir(exist_ok=True)
    foreign.write_text("raise RuntimeError('mine')\n")
    done = python(tmp_path, "-m", "hysid", "check", "run.csv")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"hysid: hysid needs its own package {name!r}")
    assert done.stderr.count("\n") == 1
    assert "Fix: rename" in done.stderr
    assert str(foreign if kind == "file" else foreign.parent) in done.stderr
    told = json.loads(python(tmp_path, "-m", "hysid", "check", "run.csv", "--json").stderr)
    assert told["error"]["code"] == "foreign-package"
    done = python(tmp_path, "-c", "import hysid")
    assert done.returncode == 1
    words = f"ImportError: hysid needs its own package {name!r}"
    assert done.stderr.splitlines()[-1].startswith(words)


def test_the_command_does_not_look_into_the_current_folder(tmp_path: Path):
    """For `python -m hysid`, Python runs ./hysid.py before anything of ours; not with `-P`."""
    (tmp_path / "hysid.py").write_text("print('mine')\n")
    command = tmp_path / "bin" / "hysid"
    command.parent.mkdir()
    command.write_text("from hysid.cli._app import main\nmain()\n")  # as pip makes it
    for words in ((str(command),), ("-P", "-m", "hysid")):
        done = python(tmp_path, *words, "--version")
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.startswith("hysid")
    assert python(tmp_path, "-m", "hysid", "--version").stdout == "mine\n"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the packages, as pip makes one."""
    place = tmp_path_factory.mktemp("site-packages")
    for name in OURS:
        shutil.copytree(ROOT / name, place / name, ignore=shutil.ignore_patterns("__pycache__"))
    return place


def test_another_distribution_installed_over_ours(installed: Path, tmp_path: Path):
    """pre-commit's library has an empty identify/__init__.py."""
    good = python(tmp_path, "-m", "hysid", "--version", path=installed)
    assert good.returncode == 0, good.stderr
    ours = (installed / "identify" / "__init__.py").read_text()
    (installed / "identify" / "__init__.py").write_text("")
    done = python(tmp_path, "-m", "hysid", "--version", path=installed)
    (installed / "identify" / "__init__.py").write_text(ours)
    assert done.returncode == 2
    assert "another distribution named 'identify' was installed over it" in done.stderr
    assert "python -m venv" in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_package_that_is_missing(installed: Path, tmp_path: Path):
    (installed / "compensate").rename(installed / "elsewhere")
    done = python(tmp_path, "-S", "-c", "import hysid", path=installed)
    (installed / "elsewhere").rename(installed / "compensate")
    assert "the package 'compensate' of hysid is missing" in done.stderr.splitlines()[-1]


def test_a_broken_library_is_said_without_importing_it(installed: Path, tmp_path: Path):
    """JAX that cannot be imported: the handler does not need it."""
    (installed / "jax.py").write_text("raise ImportError('libdevice is missing')\n")
    (tmp_path / "run.csv").write_text("a,b\n1,2\n2,3\n")
    words = ("-m", "hysid", "check", "run.csv", "--input", "a", "--output", "b")
    done = python(tmp_path, *words, path=installed)
    (installed / "jax.py").unlink()
    assert done.returncode == 2
    assert "installation is not complete (ImportError: libdevice is missing)" in done.stderr
    assert done.stderr.count("\n") == 1
