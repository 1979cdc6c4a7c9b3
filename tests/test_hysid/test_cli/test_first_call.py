"""The first command of a newcomer: a file without a configuration, another file under one, and help."""

import re
import shlex
import tomllib
from pathlib import Path

import openpyxl
import pytest

from tests.test_hysid.command import LINE, F, T, X, put, refused, run, sponge, takes, text

ROWS = sponge()

pytestmark = pytest.mark.usefixtures("empty_folder")


def selection(config: str) -> dict:
    return tomllib.loads(Path(config).read_text("utf-8"))["selection"]


def workbook(name: str) -> None:
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append([T, F, X])
    for row in ROWS:
        sheet.append([float(cell) for cell in row[:3]])
    book.save(name)


def test_a_fresh_file_gets_its_verdict_in_one_command():
    said = run("fit", put(ROWS), *LINE)
    assert said.code == 0, said.err
    assert re.match("(PASS|CAUTION|FAIL): LinearSponge", said.out)
    for words in ((f"input     {F}", "sure", "the rig commanded it"), (f"output    {X}", "lags")):
        (line,) = (one for one in said.err.splitlines() if one.strip().startswith(words[0]))
        assert all(word in line for word in words)
    assert selection("run.toml") == {"input": F, "output": X, "time": T, "test_cycles": 1}
    again = run("fit", "run.csv", *LINE, "--overwrite")
    assert again.out == said.out
    assert "Options of run.toml" in again.err


def test_options_that_are_given_are_not_doubted():
    put(text([row[:3] for row in ROWS], ("t", "a", "b")))
    refused(run("fit", "run.csv", *LINE), "a guess", "hysid init run.csv", "[cannot-decide]")
    assert not Path("run.toml").exists()
    given = ("--test-tail", 0.2, "--model", "LinearSponge", "--noise", "gaussian")
    put(ROWS, "other.csv")
    found = run("fit", "other.csv", *given, "--turn", X, "--json").json()["selection"]
    assert (found["test_tail"], found["test_cycles"], found["turn"]) == (0.2, None, [X])
    assert selection("other.toml")["turn"] == [X]
    # On the command line one way to hold out, or one clock, replaces those of the configuration.
    more = ("--test-cycles", 1, "--dt", 6, "--overwrite", "--json")
    found = run("fit", "other.csv", *LINE, *more).json()["selection"]
    assert (found["test_tail"], found["test_cycles"]) == (None, 1)
    assert (found["time"], found["dt"]) == (None, 6)


def test_what_nothing_drives_is_not_fitted():
    rows = "".join(f"{3 * k % 7},{3 * k % 11},{5 * k % 13}\n" for k in range(40))
    put(f"Fx,Fy,Fz\n{rows}", "wrench.csv")
    words = ("hysid init wrench.csv", "[cannot-decide]")
    refused(run("fit", "wrench.csv"), "none drives another", *words)
    refused(run("check", "wrench.csv"), "hysid init wrench.csv", "[cannot-decide]")
    assert [file.name for file in Path().iterdir()] == ["wrench.csv"]
    assert "\nhysid " not in run("init", "wrench.csv").out  # nor is a pair proposed


@pytest.mark.parametrize("words", [
    ("fit", "nix.csv"), ("fit", "nix.csv", "--input", F, "--output", F),
    ("check", "nix.csv"), ("init", "nix.csv"),
])  # fmt: skip
def test_a_file_that_is_not_there_is_said_first(words):
    put("[selection]\n", "nix.toml")
    refused(run(*words), "nix.csv: not found", "[file-not-found]")


def test_files_of_one_stem_have_configurations_and_folders_of_their_own():
    workbook("press.xlsx")
    put(ROWS, "press.csv")
    for file in ("press.xlsx", "press.csv", "bare"):
        put(ROWS, "bare")
        found = run("init", file)
        assert found.code == 0, found.err
        words = shlex.split(found.out.splitlines()[-1])
        assert run(*words[1:], *LINE).code == 0
        assert run("fit", file, *LINE, "--overwrite").code == 0
    folders = {file.name for file in Path().iterdir() if file.is_dir()}
    assert folders == {"press", "press.csv-fit", "bare-fit"}
    assert selection("press.csv.toml")["input"] == selection("press.toml")["input"] == F
    # A configuration that was copied for another file, or whose file has a new name, is that file's.
    Path("press.toml").rename("moved.toml")
    Path("press.csv").rename("moved.csv")
    assert "Options of moved.toml" in run("check", "moved.csv").err


def test_another_file_under_a_configuration_is_told():
    put(ROWS)
    assert run("init", "run.csv").code == 0
    config = Path("run.toml").read_text("utf-8")
    put(config.replace('model = "auto"', 'model = "LinearSponge"'), "run.toml")
    put(text(ROWS[:-5]))  # fewer rows, as of an earlier export
    told = run("check", "run.csv")
    assert (told.code, "written for run.csv of" in told.err) == (0, True)
    put(text(ROWS, (T, X, F, "cycle")))
    said = run("fit", "run.csv", *LINE).err.splitlines()[-1]
    assert "[other-settings]" in said
    fix = re.search(r"hysid init [^,]*", said)
    # One configuration for many specimens is meant: it is named.
    many = run("fit", "run.csv", "--config", "run.toml", *LINE)
    assert (many.code, "Note: run.toml was written for" in many.err) == (0, True)
    assert run("batch", "*.csv", "--config", "run.toml", "--out", "all").code == 0
    assert run(*shlex.split(fix[0])[1:]).code == 0
    assert run("check", "run.csv").code == 0


def test_a_configuration_from_elsewhere_says_nothing_of_its_file():
    put(ROWS)
    put(f'[selection]\ninput = "{F}"\noutput = "{X}"\n', "run.toml")
    assert "Note" not in run("check", "run.csv").err
    put("[selection", "run.toml")
    assert "not TOML" in run("check", "run.csv").err


def test_hysid_alone_says_how_to_begin():
    page = run().out
    assert page == run("--help").out
    lines = [line[4:] for line in page.splitlines() if line[:10] == "    hysid "]
    begin = [line.split("   ")[0].split() for line in lines]
    assert [words[:2] for words in begin] == [
        ["hysid", "fit"], ["hysid", "report"], ["hysid", "export"]
    ]  # fmt: skip
    put(ROWS)
    for _, name, *words in begin:  # which `test_remedies` and others run
        takes(name, words)
