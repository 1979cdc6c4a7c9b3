"""What a newcomer's hour comes to: init, fit and report on measured files, by the commands' own words.

python -m benchmarks.newcomer [--quick] [--json] [--only TEXT] [--folder FOLDER]

Every table in the folder of measurements (HYSID_DATA), or those with TEXT in their path: `hysid init FILE`,
then the command it prints, then `hysid report`. Nothing is chosen by hand. `--quick` fits one kind of model
in place of them all.
"""

import json
import shlex
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ._measure import Row, noted, options, report
from .accuracy import data_folder

TABLES = ("*.csv", "*.txt", "*.creep", "*.lvm", "*.tdms", "*.xlsx")


class Road(NamedTuple):
    """The three commands on one file. `told`: the verdict, or the message that ended it."""

    seconds: float
    reached: bool
    told: str


def walk(file: Path, out: Path, quick: bool) -> Road:
    """From a file to its report."""
    begin = time.perf_counter()
    toml = out / f"{file.parent.name}-{file.stem}.toml"
    fitted = toml.with_suffix("")
    said = _hysid("init", file, "--out", toml)
    if said.returncode == 0:
        shown = next(line for line in said.stdout.splitlines() if " hysid fit " in line)
        words = shlex.split(shown)[1:] + (["--model", "LinearSponge"] if quick else [])
        said = _hysid(*words, "--out", fitted)
    if said.returncode == 0:
        said = _hysid("report", fitted)
    reached = said.returncode == 0
    told = _verdicts(fitted) if reached else said.stderr.strip().splitlines()[-1]
    return Road(time.perf_counter() - begin, reached, told)


def rows_of(folder: Path, only: str, quick: bool) -> Iterator[Row]:
    """A row a file, told as it is done; then how many came through."""
    files = sorted(file for pattern in TABLES for file in folder.rglob(pattern))
    reached = 0
    with tempfile.TemporaryDirectory() as out:
        for file in (one for one in files if only in str(one.relative_to(folder))):
            road = walk(file, Path(out), quick)
            reached += road.reached
            name = str(file.relative_to(folder))
            print(f"{name}: {road.told}", file=sys.stderr, flush=True)
            yield noted(f"{name}, s", road.seconds, reason=road.told)
    yield noted("files that came to a report", reached)


def _hysid(*words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "hysid", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True)


def _verdicts(folder: Path) -> str:
    """Of the fits in `folder`: how many of each verdict, the models, the median error where held out."""
    fits = [json.loads(file.read_text("utf-8")) for file in sorted(folder.rglob("fit.json"))]
    levels = Counter(fit["verdict"]["level"] for fit in fits)
    off = [fit["metrics"]["test"]["nrmse_percent"] for fit in fits if fit["metrics"]["test"]]
    return ", ".join(
        [f"{count} {level}" if len(fits) > 1 else level for level, count in levels.items()]
        + sorted({fit["model"] for fit in fits})
        + ([f"{np.median(off):.2g} % off where held out"] if off else ["nothing held out"])
    )


def main(arguments: Sequence[str] | None = None) -> None:
    chosen = options(
        "benchmarks.newcomer", __doc__, arguments, only="files with this in their path",
        folder="where the files lie",
    )  # fmt: skip
    folder = Path(chosen.folder) if chosen.folder else data_folder()
    report(list(rows_of(folder, chosen.only or "", chosen.quick)), chosen.json)


if __name__ == "__main__":
    main()
