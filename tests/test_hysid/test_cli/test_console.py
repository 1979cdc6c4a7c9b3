"""Errors as JSON, the version, options that are written once, and terminals of any kind."""

import json
import os
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from hysid.commands._console import Left
from tests.test_hysid.command import COLUMNS, ENVIRONMENT, run, sponge, text

KEYS = {"code", "message", "where", "cause", "fix"}


def error_of(*arguments: object, code: int = 2) -> dict[str, str]:
    """The object in the last line on stderr, of a command that printed nothing on stdout."""
    said = run(*arguments, "--json")
    assert (said.code, said.out) == (code, "")
    document = json.loads(said.err.splitlines()[-1])
    assert set(document) == {"error"}
    assert set(document["error"]) == KEYS
    assert all(isinstance(words, str) for words in document["error"].values())
    return document["error"]


@pytest.fixture
def file(tmp_path_factory):
    made = tmp_path_factory.mktemp("data") / "run.csv"
    made.write_text(text(sponge()))
    return made


def test_an_error_of_the_data_is_an_object_with_the_fields_of_the_exception(file):
    found = error_of("check", file, "--input", "Force", *COLUMNS[2:])
    assert found["code"] == "no-column"
    assert "Force" in found["message"]
    said = run("check", file, "--input", "Force", *COLUMNS[2:]).err
    assert all(words in said for words in found.values())


@pytest.mark.parametrize(("arguments", "where"), [
    (("fit", "run.csv", "--frobnicate"), "hysid fit"), (("fit",), "hysid fit"),
    (("frobnicate",), "hysid"),
    (("check", "run.csv", *COLUMNS, "--nan", "maybe"), "hysid check"),
    (("export", "fit"), "hysid export"), (("reproduce", "nobody1900"), "hysid reproduce"),
    (("microchannel", "train"), "hysid microchannel train"),
])  # fmt: skip
def test_a_usage_error_is_an_object_too(arguments, where):
    found = error_of(*arguments)
    assert (found["code"], found["where"]) == ("usage", where)
    assert found["fix"] == f"See: {where} --help"


@pytest.mark.parametrize(("error", "code", "status", "words"), [
    (RuntimeError("the sponge bit\nback"), "bug", 1, "This is a bug in hysid, not your doing (Runtime"),
    (AssertionError(), "bug", 1, "This is a bug in hysid, not your doing (Assertion"),
    (OSError(28, "No space left on device", "fit.npz"), "os-error", 2,
     "fit.npz: No space left on device.\n"),
    (FileExistsError(17, "File exists", "run"), "os-error", 2, "run: a file is where a folder is"),
    (KeyboardInterrupt(), "interrupted", 130,
     "Interrupted. What was written so far is complete.\n"),
])  # fmt: skip
def test_every_other_end_is_told_in_a_line_or_an_object(
    file, monkeypatch, tmp_path, error, code, status, words
):
    def job(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("hysid.commands._check.run", job)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    said = run("check", file, *COLUMNS)
    assert (said.code, said.out, said.err.count("\n")) == (status, "", 1)
    assert said.err.startswith(f"hysid: {words}")
    if code == "bug":
        (details,) = tmp_path.iterdir()
        assert said.err.endswith(f"Details: {details}\n")
        assert "Traceback" in details.read_text()
    assert error_of("check", file, *COLUMNS, code=status)["code"] == code


def test_the_version_is_that_of_the_distribution():
    assert run("--version") == (0, f"hysid {version('hysid')}\n", "")


@pytest.mark.parametrize(("spent", "words"), [
    (1.0, ""), (10.0, "; about 30 s left"), (60.0, "; about 3 min left"),
    (7200.0, "; about 6 h left"),
])  # fmt: skip
def test_what_is_left_takes_as_long_as_what_was_done(spent, words):
    left = Left()
    left.begin = time.monotonic() - spent
    assert left(1, 4) == words
    assert left(4, 4) == left(0, 4) == left(0, 0) == ""
    # Of the next value of --each the parts are counted anew: what the first one took tells nothing.
    assert left(1, 4) == ""


LIST = [sys.executable, "-m", "hysid", "datasets", "list"]


def test_a_reader_that_is_gone(tmp_path: Path):
    """`hysid ... | head`: nothing is said, and the exit status is that of a closed pipe."""
    out, into = os.pipe()
    piped = {"stdout": into, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(LIST, env=ENVIRONMENT, **piped)
    os.close(into)
    os.close(out)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (141, "")


def test_a_terminal_without_unicode():
    environment = ENVIRONMENT | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run(LIST, env=environment, capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.isascii()


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
