"""Bad input through the command line: one message with place, cause and fix; nothing is written."""

import gzip
import shlex
import subprocess
import sys
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import pytest

from tests.test_hysid.command import (
    COLUMNS,
    ENVIRONMENT,
    HEADER,
    LINE,
    F,
    Result,
    T,
    X,
    put,
    refused,
    run,
    sponge,
    text,
    tree,
)

ROWS = sponge()
CLEAN = text(ROWS)
LINES = CLEAN.splitlines(keepends=True)
# Records of one length share what is compiled for them.
FIT = (*LINE, "--out", "out")
SWAPPED = text([[t, x, f, c] for t, f, x, c in ROWS])
TURNED = text([[t, f, f"{-float(x):g}", c] for t, f, x, c in ROWS])
CLIPPED_X = text([[t, f, f"{min(float(x), 10):g}", c] for t, f, x, c in ROWS])
CLIPPED_F = text([[t, f"{min(float(f), 15):g}", x, c] for t, f, x, c in ROWS])


def column(name: str, cells: list[str], first: int = 0) -> str:
    """The clean file with other cells in a column, from row `first` on."""
    rows = [list(row) for row in ROWS]
    for row, cell in zip(rows[first:], cells, strict=False):
        row[HEADER.index(name)] = cell
    return text(rows)


def cell(name: str, value: str, row: int = 12) -> str:
    """The clean file with one other cell, in line `row` + 2."""
    return column(name, [value], row)


def line(number: int, content: str) -> str:
    """The clean file with one other line."""
    return "".join([*LINES[: number - 1], f"{content}\n", *LINES[number:]])


def steady(spread: float) -> str:
    """A force that is held, with noise on it."""
    noise = np.random.default_rng(0).normal(0, spread, len(ROWS))
    return column(F, [f"{x:.4f}" for x in 5 + noise])


def one_way() -> str:
    """The first press in steps so fine that it is as long as the five together."""
    pressed = np.array([row[:3] for row in ROWS[:11]], float).T
    at = np.linspace(0, pressed[0, -1], len(ROWS))
    cells = (np.interp(at, pressed[0], column) for column in pressed)
    return text([[f"{v:.4f}" for v in row] + ["1"] for row in zip(*cells, strict=True)])


ONE_WAY = one_way()
COMMA = text([[c.replace(".", ",") for c in row] for row in ROWS], separator=";")
OVERLOAD = cell(F, "OVLD")
NO_OUTPUT = column(X, ["NaN"] * 10, 20)
NO_INPUT = cell(F, "", 30)
RESET = text([*ROWS, *ROWS])
SPECIMENS = text(
    [[*row, "A"] for row in ROWS]
    + [[*row[:2], "NaN" if k == 5 else row[2], row[3], "B"] for k, row in enumerate(ROWS)],
    (*HEADER, "block"),
)


class Bad(NamedTuple):
    """A file that is refused: the code of the fault and words its message must have."""

    content: str | bytes
    code: str
    words: tuple[str, ...]
    options: tuple[str, ...] = COLUMNS


BAD = {
    "decimal commas": Bad(COMMA, "decimal-comma", ("line 2", f"{X!r}", "'0,003'", "--decimal ,")),
    "decimal commas between commas": Bad(
        CLEAN.replace(".", ","), "decimal-comma", ("line 2", "5 cells", '";"', "--decimal ,")),
    "ambiguous commas": Bad(
        cell(F, '"1,234"'), "thousands-separator", ("line 14", "thousands", "--decimal ,")),
    "a column that is not there": Bad(
        CLEAN, "no-column", ("'Force'", f"{F!r}", f"{X!r}"), ("--input", "Force", "--output", X)),
    "no header": Bad(text(ROWS[1:], ROWS[0]), "no-header", ("no header", "'0'")),
    "overload": Bad(
        OVERLOAD, "text-cell", ("line 14", f"{F!r}", "'OVLD'", "sensor overload?", "--na-values OVLD")),
    "words": Bad(cell(F, "see notes"), "text-cell", ("line 14", "'see notes'", "text among")),
    "not-finite": Bad(cell(F, "inf"), "not-finite", ("line 14", "'inf'", "division by zero")),
    "NaN in the output": Bad(
        NO_OUTPUT, "nan-output",
        ("10 NaN", f"{X!r}", "lines 22 to 31 (54 s)", "--nan omit", "history still runs")),
    "NaN in the input": Bad(
        NO_INPUT, "nan-input", ("1 NaN", f"{F!r}", "line 32", "complete input", "--nan interpolate")),
    "NaN in the input, omitted": Bad(
        NO_INPUT, "nan-input", ("line 32", "complete input"), (*COLUMNS, "--nan", "omit")),
    "a cell too many": Bad(
        line(51, "1,2,3,4,5"), "ragged-line", ("line 51", "5 cells, the header has 4", "mend")),
    "a line cut short": Bad(CLEAN[:-9], "ragged-line", ("line 102", "2 cells", "cut short")),
    "a line with another separator": Bad(
        line(51, LINES[50].strip().replace(",", ";")), "ragged-line", ("line 51", "separator")),
    "an open quote": Bad(cell(F, '"5'), "ragged-line", ("line 14", "open quote")),
    "too short": Bad(text(ROWS[:9]), "too-few-rows", ("0.5 cycles", "at least one cycle, or 20")),
    "a held input": Bad(
        column(F, ["7"] * len(ROWS)), "constant-input", (f"{F!r}", "7 N in every row", "--input")),
    "noise for an input": Bad(
        steady(0.01), "no-excitation", ("range 0.0433 N", "nothing to identify", "drive the rig")),
    "two runs": Bad(RESET, "time-backwards", ("line 103", "--segments auto", "--group")),
    "an empty file": Bad("", "empty-file", ("empty",)),
    "comments only": Bad("# rig 7\n\n", "empty-file", ("nothing but blank or comment lines",)),
    "a header only": Bad(LINES[0], "no-rows", ("a header and no rows",)),
    "a header and empty rows": Bad(f"{LINES[0]},,,\n,,,\n", "no-rows", ("a header and no rows",)),
    "binary": Bad(bytes(range(256)), "binary-file", ("binary", "export it as text")),
    "a spreadsheet": Bad(b"PK\3\4workbook", "binary-file", ("export the sheet as CSV",)),
    "packed": Bad(gzip.compress(CLEAN.encode()), "binary-file", ("unpack it",)),
    "arrays": Bad(b"PK\3\4" + bytes(26) + b"t.npy", "binary-file", ("numpy.savetxt",)),
    "a column twice": Bad(
        text(ROWS, (T, F, F, X)), "duplicate-column", (f"{F!r}", "column 2 and 3", "rename")),
    "no such rows": Bad(CLEAN, "no-match", ("cycle=9", "5, 4"), (*COLUMNS, "--where", "cycle=9")),
    "no condition": Bad(
        CLEAN, "bad-condition", ("'cycle'", "COL=VALUE"), (*COLUMNS, "--test-where", "cycle")),
    "too few cycles": Bad(
        CLEAN, "too-few-cycles", ("5 complete cycles", "--test-tail"), (*COLUMNS, "--test-cycles", "5")),
    "the whole tail": Bad(
        CLEAN, "bad-option", ("1.5", "--test-tail 0.2"), (*COLUMNS, "--test-tail", "1.5")),
    "two hold-outs": Bad(
        CLEAN, "conflicting-options", ("--test-where",),
        (*COLUMNS, "--test-tail", "0.2", "--test-cycles", "1")),
    "two clocks": Bad(CLEAN, "conflicting-options", ("--dt",), (*COLUMNS, "--dt", "1")),
    "a specimen without a name": Bad(
        SPECIMENS.replace("A\n", "\n", 1), "no-value", ("line 2", "block"), (*COLUMNS, "--each", "block")),
    "no such model": Bad(
        CLEAN, "unknown-model", ("'Voigt'", "Burgers"), (*COLUMNS, "--model", "Voigt")),
}  # fmt: skip

USAGE = [  # what typer says of a number depends on its version
    (("--bogus",), "No such option: --bogus"),
    (("--seed", "1", "--seed", "2"), "'--seed': give it once"),
    (("--test-cycles", "soon"), "Invalid value for '--test-cycles'"),
    (("--starts", "0"), "Invalid value for '--starts'"),
    (("--seed", "-1"), "Invalid value for '--seed'"),
    (("--initial", "virgin"), "auto or negative or positive or demagnetised"),
    (("--conditioning", "never"), "auto or keep"),
    (("--segments", "all"), "'all' is not auto"),
    (("--nan", "ignore"), "raise or omit or interpolate"),
    (("--decimal", ";"), "';' is not . or ,"),
]

pytestmark = pytest.mark.usefixtures("empty_folder")


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD.keys())
def test_a_bad_file_is_refused_in_one_message_and_nothing_is_written(bad):
    put(bad.content)
    before = tree(Path())
    options = bad.options if "--model" in bad.options else (*bad.options, *FIT[:-2])
    refused(run("fit", "run.csv", *options, *FIT[-2:]), *bad.words, f"[{bad.code}]\n")
    assert tree(Path()) == before
    assert not Path("out").exists()


@pytest.mark.parametrize(("options", "words"), USAGE, ids=[options[0] for options, _ in USAGE])
def test_a_bad_option_is_refused(options, words):
    put(CLEAN)
    refused(run("fit", "run.csv", *COLUMNS, *FIT, *options), words, "See: hysid fit --help")
    assert not Path("out").exists()


def test_a_missing_file_names_the_nearest():
    put(CLEAN, "run_07.csv")
    refused(run("fit", "run_7.csv", *COLUMNS, *FIT), "run_7.csv: not found", "nearest: run_07.csv")
    refused(run("check", "day/run.csv", *COLUMNS), "its folder does not exist", "[file-not-found]")
    refused(run("check", ".", *COLUMNS), "this is a folder", "[is-directory]")
    assert list(tree(Path())) == ["run_07.csv"]


def test_a_file_that_may_not_be_read(monkeypatch):
    def denied(_: Path) -> bytes:
        raise PermissionError

    put(CLEAN)
    monkeypatch.setattr(Path, "read_bytes", denied)
    refused(run("fit", "run.csv", *COLUMNS, *FIT), "run.csv", "may not read", "[permission-denied]")


@pytest.mark.parametrize(("content", "words"), [
    (ONE_WAY, ("Input only rises", "nothing tells hysteresis from a curve")),
    (SWAPPED, ("Loops create energy (-", "N mm a loop", "Columns swapped", "exchange --input")),
    (TURNED, ("Loops create energy (-", "The sign of one column is turned? If so, turn it",)),
    (CLIPPED_X, ("of the output at 10 mm: clipped, lines ", "4 more runs while the input moves",
                 "--exclude-lines ")),
    (CLIPPED_F, ("of the input at 15 N: clipped, lines ", "4 more runs while the output moves",
                 "measure with a wider range")),
], ids=["one way", "swapped", "turned", "clipped output", "clipped input"])  # fmt: skip
def test_what_may_be_meant_is_said_and_fitted(content, words):
    put(content)
    fitted = run("fit", "run.csv", *COLUMNS, *FIT, "--json")
    said = run("check", "run.csv", *COLUMNS)
    assert (fitted.code, said.code) == (0, 0), fitted.err + said.err
    for word in words:
        assert any(word in reason["text"] for reason in fitted.json()["verdict"]["reasons"])
        assert word in said.out


def test_results_are_not_written_over_unless_asked():
    put(CLEAN)
    assert run("fit", "run.csv", *COLUMNS, *FIT).code == 0
    before = tree(Path("out"))
    put(ONE_WAY)
    refused(run("fit", "run.csv", *COLUMNS, *FIT), "out: ", "--overwrite", "[would-overwrite]")
    assert tree(Path("out")) == before
    found = run("fit", "run.csv", *COLUMNS, *FIT, "--overwrite", "--json").json()
    assert found["data"]["sha256"] == sha256(ONE_WAY.encode()).hexdigest()
    assert tree(Path("out"))["fit.json"] != before["fit.json"]


SHORT = shlex.join(("fit", "run.csv", *COLUMNS))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("export out --c x.h --poisson 0.3", "--poisson has no effect without a material card"),
        ("export out --to abaqus x.inp --float", "--float has no effect without a compensator"),
        ("qualify out run.csv --mhz 100", "--mhz has no effect without --rate"),
        ("compare out out --margin 0.1", "--margin has no effect without --change"),
        ("microchannel train run.csv --out s --input F --place p --kind network",
         "--kind has no effect without --force"),
        ("microchannel train run.csv --out s --input F --place p --resume",
         "--resume has no effect without --force"),
        ("export out --to abaqus x.inp --date 2020-01-01", "--date has no effect without a compens"),
        ("export out --runtime x.json --fixed", "--fixed has no effect without a compensator to wr"),
        ("reproduce tsuji2014 --epochs 3", "--epochs has no effect without the paper kim2018"),
        (f"{SHORT} --oversampling 3", "--oversampling needs an oscillator"),
        (f"{SHORT} --model oscillator --budget 3",
         "--budget cannot be used with --model Oscillator"),
        ("armor solve run.csv --out s --armor out --sponge out", "or two things do"),
    ],
)  # fmt: skip
def test_an_option_that_would_do_nothing_is_refused(words, said):
    put(CLEAN)
    Path("out").mkdir()
    code = "conflicting-options" if "two things" in said else "bad-option"
    refused(run(*shlex.split(words)), said, f"[{code}]")


@pytest.mark.parametrize("words", [
    "compare out two --loops --change",
    "batch *.csv --config b.toml --out two --jobs 2 --scheduler tcp://127.0.0.1:1",
])  # fmt: skip
def test_of_two_options_none_is_ignored(words):
    put('[selection]\ninput = "F"\noutput = "x"\n', "b.toml")
    refused(run(*words.split()), "not both")


def test_a_folder_that_cannot_be_made_is_said_before_the_fit():
    put(CLEAN)
    put(CLEAN, "two.csv")
    before = tree(Path())
    each = (
        ("run.csv", "would-overwrite"),
        ("two.csv", "not-a-folder"),
        ("two.csv/deep", "cannot-write"),
    )
    for folder, code in each:
        refused(
            run("fit", "run.csv", *COLUMNS, *FIT[:-2], "--out", folder), folder[:7], f"[{code}]"
        )
    assert tree(Path()) == before


def test_one_bad_specimen_is_named_and_the_others_are_fitted():
    put(SPECIMENS)
    found = run("fit", "run.csv", *COLUMNS, "--each", "block", *FIT, "--json").json()
    assert list(found["each"]) == ["A"]
    assert "line 108" in found["failed"]["B"]
    reasons = {reason["code"]: reason["text"] for reason in found["verdict"]["reasons"]}
    assert "B: not fitted" in reasons["not-fitted"]
    told = run("fit", "run.csv", *COLUMNS, "--each", "block", *FIT, "--overwrite").out
    assert "All reasons of each: hysid report out" in told
    assert "B cannot be used" in run("check", "run.csv", *COLUMNS, "--each", "block").out


def test_a_fault_of_the_whole_file_is_said_once_not_per_specimen():
    put(SPECIMENS)
    options = ("--input", "Force", "--output", X, "--each", "block")
    refused(run("fit", "run.csv", *options, *FIT), "No column 'Force'", "[no-column]")
    assert not Path("out").exists()


@pytest.fixture
def _single_precision():
    jax.config.update("jax_enable_x64", False)
    yield
    jax.config.update("jax_enable_x64", True)


@pytest.mark.usefixtures("_single_precision")
def test_a_fit_in_single_precision_can_be_asked_for():
    put(CLEAN)
    # All of a fit can be had in it, the search for the kind of noise among it.
    options = ("--model", "LinearSponge", "--starts", 2, "--out", "out", "--allow-float32")
    found = run("fit", "run.csv", *COLUMNS, *options, "--json").json()
    assert found["parameters"][0]["value"] == pytest.approx(1.3213, rel=1e-4)


def test_a_process_exits_with_two_and_one_line():
    put(COMMA)
    words = [sys.executable, "-m", "hysid", "check", "run.csv", *COLUMNS]
    done = subprocess.run(words, capture_output=True, text=True, env=ENVIRONMENT, timeout=120)
    refused(Result(done.returncode, done.stdout, done.stderr), "--decimal ,")
    assert list(tree(Path())) == ["run.csv"]


def test_the_mask_of_clipped_rows_masks_them():
    """A limit of many digits, as a sensor's is; and one that the force reads in other rows."""
    put(text([[t, f, f"{min(float(x), 10.0519657):.9g}", c] for t, f, x, c in ROWS]))
    said = run("check", "run.csv", *COLUMNS).out
    value = said.partition("--na-values ")[2].partition(" ")[0]
    said = run("check", "run.csv", *COLUMNS, "--na-values", value, "--nan", "omit").out
    assert "clipped" not in said
    put(CLIPPED_X)
    said = run("check", "run.csv", *COLUMNS).out
    lines = said.partition("--exclude-lines ")[2].partition(")")[0]
    assert "clipped" not in run("check", "run.csv", *COLUMNS, "--exclude-lines", lines).out


def test_a_constant_output_says_nothing_false_of_the_input():
    """The load goes up and down: it does not "change by 0"."""
    put(text([[t, f, "7.5", c] for t, f, x, c in ROWS]))
    said = run("fit", "run.csv").err.splitlines()[-1]
    assert "dead" in said
    assert "changes by" not in said
