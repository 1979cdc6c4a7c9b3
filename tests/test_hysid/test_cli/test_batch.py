"""`hysid batch` and `--config`: every file of a pattern, a bad one, and options that are wrong."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from hysteresis import read_table
from tests.test_hysid.command import (
    COLUMNS,
    ENVIRONMENT,
    HEADER,
    F,
    T,
    X,
    put,
    read,
    refused,
    run,
    sponge,
    text,
)
from tests.thorough import rest_thorough

CONFIG = f"""
[selection]
input = "{F}"
output = "{X}"
time = "{T}"

[fit]
model = "LinearSponge"
conditioning = "keep"
clocks = "keep"
noise = "gaussian"
starts = 2
"""


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch) -> Path:
    """Three files, one of them bad, and a configuration, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    Path("data").mkdir()
    rows = sponge()
    for name in ("a", "b"):
        put(rows, f"data/{name}.csv")
    put(text([[t, f, "", c] for t, f, _, c in rows]), "data/bad.csv")
    put(CONFIG, "batch.toml")
    return tmp_path


def batch(*more: object, pattern: str = "data/*.csv", out: str = "out"):
    return run("batch", pattern, "--config", "batch.toml", "--out", out, *more)


def test_every_file_is_fitted_and_the_bad_one_named():
    default = CONFIG.replace('noise = "gaussian"\n', "")  # the kind is sought, as by a single fit
    put(default, "batch.toml")
    found = batch("--json").json()
    assert (found["fitted"], found["skipped"]) == (2, 0)
    assert "nan-output" in found["failed"]["bad"]
    assert [row["name"] for row in found["fits"]] == ["a", "b"]
    table = read("out/batch.csv")
    assert [row["name"] for row in table] == ["a", "b", "bad"]
    assert table[0]["K status"] == "free"
    kept = json.loads(Path("out/batch.json").read_text("utf-8"))
    assert kept["finished"]
    assert list(kept["failed"]) == ["bad"]
    # Each is a fit as any other.
    assert run("predict", "out/a", "data/b.csv", "--json").json()["rows"] == len(sponge())

    # As a single fit with the same options.
    alone = run("fit", "data/a.csv", "--config", "batch.toml", "--out", "alone", "--json").json()
    assert [p["value"] for p in alone["parameters"]] == [
        p["value"] for p in json.loads(Path("out/a/fit.json").read_text("utf-8"))["parameters"]
    ]
    # The command line has the last word.
    options = ("--config", "batch.toml", "--out", "more", "--json", "--seed", 7)
    assert run("fit", "data/a.csv", *options).json()["seed"] == 7

    # Mended, the bad one alone is left to do.
    put(sponge(), "data/bad.csv")
    again = batch()
    assert again.code == 0
    assert "3 fitted (2 of them by an earlier run), 0 failed." in again.out
    anew = batch("--no-resume", "--json").json()
    assert (anew["fitted"], anew["skipped"]) == (3, 0)

    # Results of another configuration are left alone.
    put(default.replace("starts = 2", "starts = 3"), "batch.toml")
    refused(batch(), "another configuration", "--no-resume")


def test_what_was_stopped_goes_on(monkeypatch):
    def stopped(file: Path, *rest, **named):
        if file.name == "b.csv":
            raise KeyboardInterrupt
        return read_table(file, *rest, **named)

    with monkeypatch.context() as patch:
        patch.setattr("hysid.intake._selection.read_table", stopped)
        ended = batch()
    assert ended.code == 130
    assert "batch.csv" in ended.err
    assert "1 of 3: a" in ended.err
    kept = json.loads(Path("out/batch.json").read_text("utf-8"))
    assert [row["name"] for row in kept["fits"]] == ["a"]
    assert not kept["finished"]
    assert "2 fitted (1 of them by an earlier run), 1 failed." in batch().out


def test_each_value_of_each_file():
    rows = [[*row, part] for part in ("x", "y/1") for row in sponge()]
    put(text(rows, (*HEADER, "part")), "data/a.csv")
    put(CONFIG.replace("[fit]", 'each = "part"\n[fit]'), "batch.toml")
    found = batch("--json", pattern="data/a.csv").json()
    assert [row["name"] for row in found["fits"]] == ["a/x", "a/y_1"]
    assert Path("out/a/y_1/fit.json").is_file()


def test_two_files_of_one_name():
    Path("data/deep").mkdir()
    put(sponge(), "data/deep/a.csv")
    found = batch("--json", pattern="data/**/a.csv").json()
    assert [row["name"] for row in found["fits"]] == ["a", "deep-a"]


@pytest.mark.parametrize(("said", "words"), [
    ("output = x", ["line 1", "bad-config"]),
    ("[selection]\nouput = 'x'", ["ouput", "Did you mean output?", "unknown-key"]),
    ("[selection]\nmodel = 'Burgers'", ["[fit]", "unknown-key"]),
    ("[select]\noutput = 'x'", ["[select]", "Did you mean selection?"]),
    ("[fit]\nstarts = 'many'", ["starts = 'many'", "a whole number"]),
    ("[fit]\nstarts = true", ["a whole number"]),
    ("[selection]\noutput = ['x', 'y']", ["text"]),
    ("[selection]\ninput = 'x'", ["no output"]),
    ("[selection]\ninput = 'x'\noutput = 'y'\n[fit]\nclocks = 'no'", ["'no'", "auto or keep"]),
])  # fmt: skip
def test_a_configuration_that_is_wrong(said, words):
    put(said, "batch.toml")
    refused(batch(), *words)


def test_a_pattern_or_a_configuration_that_is_not_there():
    refused(batch(pattern="nothing/*.csv"), "nothing/*.csv", "file-not-found")
    Path("batch.toml").unlink()
    refused(batch(), "batch.toml", "unreadable-file")
    one = ("fit", "data/a.csv", *COLUMNS, "--out", "out", "--config", "none.toml")
    refused(run(*one), "none.toml", "unreadable-file")


def test_nothing_that_can_be_fitted():
    result = batch(pattern="data/bad.csv")
    assert result.code == 2
    assert "nan-output" in result.err


def test_a_scheduler_that_does_not_answer(monkeypatch):
    monkeypatch.setattr("hysid.commands._batch.PATIENCE", 1)
    refused(batch("--scheduler", "tcp://127.0.0.1:9"), "no-scheduler", "127.0.0.1:9")
    refused(batch("--scheduler", "no address"), "no-scheduler")


def test_without_distributed(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    refused(batch("--scheduler", "tcp://127.0.0.1:9"), "hysid[cluster]")


@pytest.mark.thorough
def test_several_processes(monkeypatch):
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)  # and after the test, too
    put("raise SystemExit('not that of Python')", "select.py")
    found = batch("--jobs", 2, "--json").json()
    assert (found["fitted"], list(found["failed"])) == (2, ["bad"])


STARTS_A_WORKER = """
import os, signal
from hysid.cli._app import _terminated
from hysid.commands._batch import _pool
signal.signal(signal.SIGTERM, _terminated)
with _pool(1) as pool:
    pool.submit(os.getpid).result()
    print(flush=True)
    signal.pause()
"""


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("number", rest_thorough(["SIGKILL", "SIGTERM"], 1))
def test_no_worker_outlives_its_batch(number):
    started = [sys.executable, "-c", STARTS_A_WORKER]
    silent = subprocess.DEVNULL
    with subprocess.Popen(started, env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=silent) as batch:
        batch.stdout.readline()
        batch.send_signal(getattr(signal, number))
        # The worker holds the pipe too, which ends with the last one that does.
        assert batch.communicate(timeout=60)[0] == b""
