"""Streams, names and folders that a terminal may bring along."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

from identify.internal import read_json, write_json
from tests.test_hysid.command import ENVIRONMENT, run

LIST = [sys.executable, "-m", "hysid", "datasets", "list"]


def test_a_reader_that_is_gone(tmp_path: Path):
    """`hysid ... | head`: nothing is said, and the exit status is that of a closed pipe."""
    out, into = os.pipe()
    process = subprocess.Popen(
        LIST, env=ENVIRONMENT, stdout=into, stderr=subprocess.PIPE, text=True
    )
    os.close(into)
    os.close(out)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (141, "")


def test_a_terminal_without_unicode():
    environment = ENVIRONMENT | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run(LIST, env=environment, capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.isascii()


def test_a_name_that_is_not_utf8_is_kept(tmp_path: Path):
    """Linux's names are bytes: Python reads those that are not UTF-8 as halves of characters."""
    document = {"source": "run\udcff.csv", "é": "é"}
    write_json(tmp_path / "fit.json", document)
    assert read_json(tmp_path / "fit.json") == document


def test_nowhere_to_write_the_details(monkeypatch: pytest.MonkeyPatch):
    def nowhere(*_: Any, **__: Any) -> None:
        raise FileNotFoundError("No usable temporary directory found")

    def fault(*_: Any, **__: Any) -> None:
        raise KeyError("a fault of ours")

    monkeypatch.setattr(tempfile, "NamedTemporaryFile", nowhere)
    monkeypatch.setattr("hysid.commands._check.run", fault)
    said = run("check", __file__, "--input", "a", "--output", "b")
    assert (said.code, said.out) == (1, "")
    assert f"{__file__}, line" in said.err
