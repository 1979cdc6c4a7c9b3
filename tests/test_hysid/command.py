"""The command line called in this process, and the record it is tried on."""

import csv
import io
import json
import math
import os
import shlex
import sys
from collections.abc import Iterable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import typer

import hysid
from hysid.cli._app import app, main
from hysteresis.rigs import SpongeRig

T, F, X = "time (s)", "force (N)", "displacement (mm)"
HEADER = (T, F, X, "cycle")
COLUMNS = ("--input", F, "--output", X, "--time", T)
LINE = ("--model", "LinearSponge", "--noise", "gaussian", "--starts", 2)
"""A fit of no time, where the kind of the noise and far starts are nobody's question."""

ENVIRONMENT = os.environ | {"PYTHONPATH": str(Path(hysid.__file__).parents[1])}
"""In which another process finds this hysid from any folder."""

SPONGE = Path(hysid.__file__).parents[1] / "datasets" / "sponge-50mm-cycles.csv"
"""A shipped record, with the columns of COLUMNS."""

Rows = list[list[str]]


class Result(NamedTuple):
    code: int
    out: str
    err: str

    def json(self) -> Any:
        """The one object on stdout; NaN and Infinity are not JSON."""
        assert self.code == 0, self.err

        def refuse(word: str) -> None:
            raise AssertionError(f"{word} in {self.out}")

        return json.loads(self.out, parse_constant=refuse)


def run(*arguments: object) -> Result:
    """`hysid ARGUMENTS`, without the progress that a loaded machine would show."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    argv = patch.object(sys, "argv", ["hysid", *map(str, arguments)])
    quick = patch("hysid.commands._console.SOON", math.inf)
    with argv, quick, redirect_stdout(out), redirect_stderr(err):
        try:
            main()
        except SystemExit as stop:
            code = stop.code
    assert isinstance(code, int)
    return Result(code, out.getvalue(), err.getvalue())


def _commands(group: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    for name, one in group.commands.items():
        if hasattr(one, "commands"):
            yield from _commands(one, f"{before}{name} ")
        else:
            yield f"{before}{name}", one


COMMANDS: dict[str, Any] = dict(_commands(typer.main.get_command(app)))
"""What does something, by the words that call it: those of groups have two."""


def takes(name: str, words: list[str]) -> None:
    """A command's options and arguments, which it does not run, are all its own, and none is missing."""
    assert COMMANDS[name].make_context(name, words).args == []


def example(name: str) -> list[str]:
    """The words of the example in a command's help, without "hysid"."""
    return shlex.split(COMMANDS[name].epilog.strip().splitlines()[-1])[1:]


def sponge(step: float = 2.0, thickness: float = 50.0, noise: float = 0.02) -> Rows:
    """Cells of five cycles of a virtual sponge, as its file would hold them; the caller's own."""
    return [list(row) for row in _cells(step, thickness, noise)]


@cache  # half a second to two
def _cells(step: float, thickness: float, noise: float) -> Rows:
    cycles = SpongeRig(thickness_mm=thickness).five_cycles(step=step, noise=noise, seed=0)
    return [[f"{t:g}", f"{f:g}", f"{x:.3f}", f"{c}"] for t, f, x, c in zip(*cycles, strict=True)]


def text(rows: Iterable[Any], header: Iterable[str] = HEADER, separator: str = ",") -> str:
    """A CSV file."""
    return "".join(f"{separator.join(map(str, row))}\n" for row in [header, *rows])


def write(file: Path, columns: dict[str, Any]) -> Path:
    """A CSV file of columns by their names."""
    return put(text(zip(*columns.values(), strict=True), columns), file)


def read(file: str | Path) -> list[dict[str, str]]:
    """The rows of a CSV file, by the names of their columns."""
    with open(file, newline="", encoding="utf-8") as handle:
        return list(csv.DictReader(handle))


def tree(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, byte for byte."""
    files = (file for file in sorted(folder.rglob("*")) if file.is_file())
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


def blocks() -> str:
    """Two specimens in one file, which the last column names."""
    both = {"soft": sponge(), "thin": sponge(thickness=30.0)}
    rows = [[*row, block] for block, cells in both.items() for row in cells]
    return text(rows, (*HEADER, "block"))


def put(content: str | bytes | Rows, file: str | Path = "run.csv") -> Path:
    """A file, in the present folder or elsewhere; rows as those of `sponge`."""
    file, content = Path(file), text(content) if isinstance(content, list) else content
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return file


def refused(result: Result, *words: str) -> None:
    """The command said one line with these words, and nothing else."""
    assert result.code == 2, result.err
    assert result.out == ""
    assert result.err.startswith("hysid: ")
    assert result.err.count("\n") == 1
    assert "Traceback" not in result.err
    for word in words:
        assert word in result.err


def answered(result: Result, *words: str) -> None:
    """The command said what it was at, and then one line with these words."""
    refused(result._replace(err=result.err.splitlines(keepends=True)[-1]), *words)
