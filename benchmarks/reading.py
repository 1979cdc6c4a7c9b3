"""Reading of large tables: rows a second, memory, and what `hysid init` takes.

python -m benchmarks.reading [--quick] [--json]

A table of three columns, written for it: a gigabyte, with `--quick` a fortieth. It is read in a process of
its own, once by the compiled parser and, a million rows of it, by the careful reader alone. Seconds are
those of processor time. `hysid init` is the whole command, from the start of Python on.
"""

import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ._measure import Row, judged, noted, options, report

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
    """Write the table, read it both ways, and print."""
    chosen = options("benchmarks.reading", __doc__, arguments)
    with tempfile.TemporaryDirectory() as folder:
        size = GIGABYTE // 40 if chosen.quick else GIGABYTE
        whole, piece = Path(folder) / "run.csv", Path(folder) / "piece.csv"
        _write(whole, size)
        _write(piece, GIGABYTE // 40)
        report([*_read(whole, piece), _init(whole)], chosen.json)


def _write(file: Path, size: int) -> None:
    """A clock, a sine and its answer, until there are `size` bytes."""
    time_s = 0.001 * np.arange(PIECE)
    turn = 0.1 * np.pi * time_s
    noise = 0.01 * np.random.default_rng(0).normal(size=PIECE)
    columns = time_s, 10 * np.sin(turn), 5 * np.sin(turn - 0.3) + noise
    rows = "".join(f"{t:.3f},{f:.6f},{x:.6f}\n" for t, f, x in zip(*columns, strict=True))
    with file.open("w") as opened:
        opened.write("time (s),force (N),displacement (mm)\n")
        while opened.tell() < size:
            opened.write(rows)


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
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [
        sys.executable,
        "-m",
        "hysid",
        "init",
        str(file),
        "--out",
        str(file.with_suffix(".toml")),
    ]
    subprocess.run(command, capture_output=True, check=True)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"hysid init: {wall:.1f} s by the clock on the wall", file=sys.stderr)
    return judged("hysid init: seconds", used, 2.0)


if __name__ == "__main__":
    main()
