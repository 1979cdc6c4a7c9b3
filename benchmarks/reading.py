"""Reading of files: variants of what rig makers export, and large tables.

python -m benchmarks.reading [--quick] [--json] [--only TEXT]

`variants`: a hundred files of testing machines, rheometers, magnetometers, loggers and binary formats, in
the languages, encodings, separators, units and layouts that their programs have, are written with made-up
numbers, and `hysid init` has to tell columns, units, clock and roles.

`cases`, `sure`: small files in `../shared/cases` by the judge beside them; and how many roles and clocks
`init` says it is sure of and has wrong, over these, the variants, makers' own files and measured sets.

`large`: a table of three columns, a gigabyte, with `--quick` a fortieth. It is read in a process of its
own, once by the compiled parser and, a million rows of it, by the careful reader alone. Seconds are those
of the processor. `hysid init` is the whole command, from the start of Python on.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ._measure import Row, judged, noted, run_parts
from ._trust.cases import cases_right
from ._vendor_files._judge import judge, variants
from ._vendor_files._sure import sure_and_wrong

GIGABYTE = 10**9
PIECE = 1_000_000
"""Rows of the piece that is written again and again."""
_READ = """
import resource, sys, time
from hysteresis import read_table
from hysteresis.records import _read_table
if sys.argv[2] == "careful":
    _read_table._by_its_head = lambda *_: None
begin = time.process_time()
rows = len(read_table(sys.argv[1]).line)
print(rows, time.process_time() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the parts, and print."""
    parts = {
        "variants": lambda _: judge(variants()),
        "cases": lambda quick: cases_right(quick, ("init",), "small cases of `init` right"),
        "sure": sure_and_wrong,
        "large": _large,
    }
    run_parts("benchmarks.reading", __doc__, parts, arguments)


def _large(quick: bool) -> list[Row]:
    """Write the table, and read it both ways."""
    with tempfile.TemporaryDirectory() as folder:
        whole, piece = Path(folder) / "run.csv", Path(folder) / "piece.csv"
        _write(whole, GIGABYTE // 40 if quick else GIGABYTE)
        _write(piece, GIGABYTE // 40)
        return [*_read(whole, piece), _init(whole)]


def _write(file: Path, size: int) -> None:
    """The rows of `write_rows` again and again, until there are `size` bytes."""
    write_rows(file, PIECE)
    rows = file.read_text().partition("\n")[2]
    with file.open("a") as opened:
        while opened.tell() < size:
            opened.write(rows)


def write_rows(file: Path, count: int) -> None:
    """A clock, a sine and its answer."""
    time_s = 0.001 * np.arange(count)
    turn = 0.1 * np.pi * time_s
    noise = 0.01 * np.random.default_rng(0).normal(size=count)
    columns = time_s, 10 * np.sin(turn), 5 * np.sin(turn - 0.3) + noise
    rows = "".join(f"{t:.3f},{f:.6f},{x:.6f}\n" for t, f, x in zip(*columns, strict=True))
    file.write_text(f"time (s),force (N),displacement (mm)\n{rows}")


def _read(whole: Path, piece: Path) -> list[Row]:
    found = []
    for file, way in ((whole, "compiled"), (piece, "careful")):
        command = [sys.executable, "-c", _READ, str(file), way]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        rows, seconds, peak = map(float, done.stdout.split())
        size = file.stat().st_size
        found.append(noted(f"{way}: rows a second", rows / seconds))
        found.append(noted(f"{way}: peak memory over the size of the file", peak / size))
        if way == "compiled":
            taken = seconds * GIGABYTE / size
            found.append(judged(f"{way}: seconds for a gigabyte", taken, 60.0))
    return found


def _init(file: Path) -> Row:
    """The second run of the command, whose modules are then compiled to bytecode, as pip compiles them."""
    command = [sys.executable, "-m", "hysid", "init", str(file), "--overwrite"]
    own = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(file.parent / "bytecode")}
    for _ in range(2):
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run(command, capture_output=True, check=True, env=os.environ | own)
        wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"hysid init: {wall:.1f} s by the clock on the wall", file=sys.stderr)
    return judged("hysid init: seconds", used, 2.0)


if __name__ == "__main__":
    main()
