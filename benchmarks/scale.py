"""Time and memory of fits against the number of rows, beside other programs on the same file.

python -m benchmarks.scale [--quick] [--json] [--model NAME[,NAME]] [--rows 1e3,1e5]

Of every model and number of rows: the whole of `hysid fit FILE --model NAME`, from the start of Python to
the written folder, in seconds and peak memory; cold, with no compiled programs kept, and warm, a second
time. Growth is the exponent of time and of memory between neighbouring numbers of rows. The peer is a whole
process too, on the same file. "Second fit" is one of another length in a process that has fitted before.
The multisine has 8,192 rows, and a fit in blocks 1e7, whatever `--rows` says; `--rows 1e8` takes as many in
blocks. `--model batch` fits `--files` files (300) of 1,000 rows over Dask, and is not among the cases that
are taken without a name. `--quick` takes 1,000 rows alone.
"""

import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from hysteresis import Burgers
from hysteresis.numerics._recurrence import clamped, relaxed

from ._measure import Row, judged, noted, options, report
from ._scale import over_dask

COLUMNS = ("time", "input", "output")

WORDS = ("--time", "time", "--input", "input", "--output", "output")


LONG = 100_000
"""Rows from which on the peer's time is a bar."""


class Bar(NamedTuple):
    """Seconds allowed of a cold and of a warm fit, and its peak memory in GB."""

    cold: float | None = None
    warm: float | None = None
    memory: float | None = None


class Case(NamedTuple):
    """A model to fit, and what is fitted.

    - `columns`: time, input and output of so many rows. `model`: what `hysid fit` calls it, if not `name`.
    - `peer`: a module of `benchmarks._scale` that fits the same file, its first line says what it is, and
      what is said to it.
    - `bars`: what is allowed, by number of rows. `second`: seconds allowed for a second fit.
    - `over_peer`: how many times the peer's seconds a warm fit of `LONG` rows may take.
    - `growth`: exponents allowed of seconds and of memory. `report`: the fit of so many rows and more has a
      report, which is timed too.
    - `sizes`: its own numbers of rows.
    """

    name: str
    columns: Callable[[int], tuple[np.ndarray, ...]]
    bars: Mapping[int, Bar]
    peer: tuple[str, ...] = ()
    over_peer: float | None = None
    second: float | None = None
    model: str = ""
    growth: tuple[float, float] | None = None
    report: float = math.inf
    sizes: tuple[int, ...] = ()

    @property
    def fitted(self) -> str:
        """The model, as `hysid fit --model` takes it."""
        return self.model or self.name


class Taken(NamedTuple):
    """Seconds and peak memory (GB) of a process, seconds of processors, and what it printed."""

    seconds: float
    processor: float
    memory: float
    output: str


def burgers(rows: int) -> tuple[np.ndarray, ...]:
    """Force ramps and rests on a Burgers element at 100 Hz, white noise of a per cent of the range."""
    t = 0.01 * np.arange(rows)
    knots = np.arange(0.0, t[-1] + 5.0, 5.0)
    levels = np.resize([0.0, 5.0, 5.0, 1.0, 3.0, 3.0, 0.5, 4.0], len(knots))
    force = np.interp(t, knots, np.random.default_rng(0).permuted(levels))
    clean = np.asarray(Burgers(2.0, 10 * t[-1], 1.0, 2.0, 0.3).simulate(t, force))
    noise = np.random.default_rng(1).normal(0.0, 0.01 * np.ptp(clean), rows)
    return t, force, clean + noise


def leading(rows: int) -> tuple[np.ndarray, ...]:
    """The same element under displacement ramps, at 300 Hz: a clock that is even to its printed digits."""
    t, displacement, _ = burgers(rows)
    t = np.array([float(f"{x:.7g}") for x in t / 3])
    element = Burgers(2.0, 10 * t[-1], 1.0, 2.0, 0.3, leading=True)
    clean = np.asarray(element.simulate(t, displacement))
    noise = np.random.default_rng(1).normal(0.0, 0.01 * np.ptp(clean), rows)
    return t, displacement, clean + noise


def sliders(rows: int) -> tuple[np.ndarray, ...]:
    """Play operators, a relaxing branch and a cubic under a sine of 250 rows whose amplitude wanders."""
    t, cycle = 0.01 * np.arange(rows), np.arange(rows) / 250
    u = np.sin(2 * np.pi * cycle) * (0.55 + 0.45 * np.sin(2 * np.pi * cycle / 17.3 + 0.4))
    radii, share = np.array([0.05, 0.15, 0.3, 0.5]), np.array([0.3, 0.25, 0.2, 0.15])
    play = clamped(u[:, None] - radii, u[:, None] + radii, np.zeros(4))
    decay = np.full((rows, 1), np.exp(-0.025))
    slow = relaxed(decay, ((1 - decay) * u[:, None])[:, :, None], np.zeros((1, 1)))[:, 0, 0]
    noise = np.random.default_rng(0).normal(0.0, 0.005, rows)
    return t, u, play @ share + 0.3 * (u - slow) + 0.2 * u**3 + noise


def multisine(rows: int) -> tuple[np.ndarray, ...]:
    """The same sliders under 175 sines of random phase: some 700 cycles of ever other sizes."""
    t, random = np.arange(rows) / rows, np.random.default_rng(0)
    lines, phases = np.arange(600, 775), random.uniform(0, 2 * np.pi, 175)
    u = np.cos(2 * np.pi * np.outer(t, lines) + phases).sum(axis=1)
    u /= np.abs(u).max()
    radii, share = np.array([0.05, 0.15, 0.3, 0.5]), np.array([0.3, 0.25, 0.2, 0.15])
    play = clamped(u[:, None] - radii, u[:, None] + radii, np.zeros(4))
    return t, u, play @ share + 0.2 * u**3 + random.normal(0.0, 0.005, rows)


CASES = (
    Case(
        "Burgers",
        burgers,
        {1_000: Bar(cold=5.0), 100_000: Bar(warm=6.0)},
        peer=("lmfit_burgers",),
        over_peer=3.0,
        second=0.5,
    ),
    Case(
        "Burgers leading",
        leading,
        {1_000: Bar(cold=5.0), 100_000: Bar(warm=6.0)},
        peer=("lmfit_burgers", "--leading"),
        second=0.5,
        model="Burgers",
    ),
    Case("Preisach", sliders, {100_000: Bar(warm=5.0), 1_000_000: Bar(warm=25.0, memory=1.5)}),
    Case(
        "Composition",
        sliders,
        {100_000: Bar(warm=12.0, memory=1.0), 1_000_000: Bar(warm=60.0, memory=2.0)},
    ),
    Case(
        "auto",
        sliders,
        {1_000: Bar(warm=8.0), 100_000: Bar(warm=25.0), 1_000_000: Bar(warm=90.0, memory=2.0)},
        growth=(0.8, 0.6),
        report=1_000_000,
    ),
    Case(
        "multisine",
        multisine,
        {8_192: Bar(warm=15.0, memory=1.0)},
        model="auto",
        sizes=(8_192,),
    ),
)


def run(words: Sequence[object], cache: Path) -> Taken:
    """A process, with JAX's programs kept in `cache`."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    begin = time.perf_counter()
    with subprocess.Popen(
        [sys.executable, "-m", *map(str, words)],
        env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as child:  # fmt: skip
        assert child.stdout is not None
        output = child.stdout.read()
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise RuntimeError(output)
    seconds = time.perf_counter() - begin
    return Taken(seconds, used.ru_utime + used.ru_stime, used.ru_maxrss / 1e6, output)


def rows_of_size(case: Case, rows: int, folder: Path) -> tuple[list[Row], Taken]:
    """The figures of one number of rows, and the warm fit."""
    file, out, what = folder / f"{rows}.csv", folder / "fit", f"{case.name}, {rows:,} rows"
    # Seven digits, as loggers write them: the printed clock is even to its rounding only.
    table = np.column_stack(case.columns(rows))
    np.savetxt(file, table, fmt="%.7g", delimiter=",", header=",".join(COLUMNS), comments="")
    words = ("hysid", "fit", file, *WORDS, "--model", case.fitted, "--out", out, "--overwrite")
    cold, warm = (run(words, folder / f"cache{rows}") for _ in range(2))
    bar = case.bars.get(rows, Bar())
    found = [
        _within(f"{what}: cold, s", cold.seconds, bar.cold),
        _within(f"{what}: warm, s", warm.seconds, bar.warm),
        noted(f"{what}: warm, seconds of processors", warm.processor),
        _within(f"{what}: peak memory, GB", warm.memory, bar.memory),
    ]
    if case.peer:
        module, *said = case.peer
        peer = run((f"benchmarks._scale.{module}", file, *said), folder)
        name = f"{module.partition('_')[0]} with {peer.output.splitlines()[0]}"
        found.append(noted(f"{what}: {name}, s", peer.seconds))
        ratio = warm.seconds / peer.seconds
        # Of few rows the start of Python and of JAX is all the time there is.
        allowed = case.over_peer if rows >= LONG else None
        found.append(_within(f"{what}: warm over {name}", ratio, allowed))
    if rows >= case.report:
        page = run(("hysid", "report", out), folder / f"cache{rows}")
        found += [
            judged(f"{what}: report, s", page.seconds, 15.0),
            judged(f"{what}: report, MB", (out / "report.html").stat().st_size / 1e6, 5.0),
        ]
    return found, warm


def in_blocks(rows: int) -> list[Row]:
    """A grid of 50 x 50 cells fitted to a Parquet file of so many rows, a block at a time in memory.

    The file repeats 4,325 rows, after which the sliders' input starts again.
    """
    import pyarrow
    import pyarrow.parquet

    print(f"in blocks, {rows:,} rows ...", file=sys.stderr, flush=True)
    _, u, y = (np.tile(column, 232) for column in sliders(4_325))
    block = pyarrow.table({"input": u, "output": y})
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "long.parquet"
        with pyarrow.parquet.ParquetWriter(file, block.schema) as writer:
            for first in range(0, rows, len(u)):
                writer.write_table(block.slice(0, min(len(u), rows - first)))
        taken = run(("benchmarks._scale.in_blocks", file), Path(folder))
    what = f"in blocks, {rows:,} rows of Parquet"
    long = rows >= 1e8
    return [
        _within(f"{what}: s", taken.seconds, 900.0 if long else None),
        _within(f"{what}: peak memory, GB", taken.memory, 2.0 if long else None),
        noted(f"{what}: rms error, output's deviation {y.std():.3g}", float(taken.output)),
    ]


def batches(files: int) -> list[Row]:
    """`hysid batch` over Dask: growth by a second worker, a worker that dies, memory by number of files."""
    t, u, clean = sliders(over_dask.ROWS)
    taken, lines = {}, {}
    part = -(-files // 4)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for what, count in (("few", 12), ("part", part), ("files", files)):
            over_dask.write_files(folder / what, (t, u, clean), count)
        for workers in (1, 2):
            print(f"batch, {files} files, workers: {workers} ...", file=sys.stderr, flush=True)
            with over_dask.cluster(workers) as started:

                def fitted(
                    of: str, model: str = "Preisach", started: Any = started, **options: Any
                ) -> over_dask.Batch:
                    out = folder / f"{of}-{model}-{len(list(folder.iterdir()))}"
                    return over_dask.batch(started, folder / of / "*.csv", model, out, **options)

                fitted("few")  # every worker has then loaded what it needs
                taken[workers] = fitted("files")
                if workers == 2:
                    # Lines with white noise are fitted fast: only the number of files differs.
                    lines = {
                        of: fitted(of, "LinearSponge", noise="gaussian") for of in ("part", "files")
                    }
                    left = fitted("few", killed=True).fitted / 12
    more = 1e3 * (lines["files"].memory - lines["part"].memory) / (files - part)
    what = f"batch over Dask, {files:,} files of {over_dask.ROWS:,} rows"
    return [
        judged(
            f"{what}: one worker over two", taken[1].seconds / taken[2].seconds, 1.8, at_least=True
        ),
        noted(f"{what}: seconds a file, one worker", taken[1].seconds / files),
        noted(f"{what}: peak memory of the client, GB", taken[2].memory),
        noted("batch over Dask: memory of the client per 1,000 files more, MB", 1e3 * more),
        judged(
            "batch over Dask: part of the fits there though a worker died", left, 1, at_least=True
        ),
    ]


def second_fit(case: Case, rows: int) -> Row:
    """A fit of another length in a process that has fitted `rows` rows before."""
    # Loaded here: what the parent process does with JAX does not count in the other figures.
    import identify
    from hysteresis import Record

    seconds = math.nan
    for count in (rows, rows - rows // 10):
        t, u, y = case.columns(count)
        begin = time.perf_counter()
        identify.fit(Record.from_arrays(u, y, t), case.fitted)
        seconds = time.perf_counter() - begin
    return _within(f"{case.name}, {rows:,} rows: second fit, s", seconds, case.second)


def rows_of(case: Case, sizes: Sequence[int]) -> list[Row]:
    """All figures of a case."""
    found, taken = [], {}
    with tempfile.TemporaryDirectory() as folder:
        for rows in sizes:
            print(f"{case.name}, {rows:,} rows ...", file=sys.stderr, flush=True)
            figures, taken[rows] = rows_of_size(case, rows, Path(folder))
            found += figures
    if case.second is not None:
        found.append(second_fit(case, sizes[0]))
    for few, many in pairwise(sizes):
        for name, bar in zip(("seconds", "memory"), case.growth or (None, None), strict=True):
            ratio = getattr(taken[many], name) / getattr(taken[few], name)
            exponent = math.log(ratio) / math.log(many / few)
            what = f"{case.name}, {few:,} to {many:,} rows: exponent of {name}"
            found.append(_within(what, exponent, bar))
    return found


def _within(what: str, value: float, bar: float | None) -> Row:
    return noted(what, value) if bar is None else judged(what, value, bar)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit every case at every number of rows and print; the exit status."""
    chosen = options(
        "benchmarks.scale", __doc__, arguments,
        model="cases of these models", rows="how many rows, with commas between",
        files="how many files a batch has",
    )  # fmt: skip
    jax.config.update("jax_enable_x64", True)
    said = (chosen.rows or ("1e3" if chosen.quick else "1e3,1e5")).split(",")
    sizes = sorted(int(float(word)) for word in said)
    names = [word.casefold() for word in (chosen.model or "").split(",") if word]
    some = [
        case
        for case in CASES
        if not names or {case.name.casefold(), case.fitted.casefold()} & set(names)
    ]
    blocks = "in blocks" in names or not (names or chosen.quick)
    batch = "batch" in names
    if not (some or blocks or batch):
        print(f"have {', '.join(case.name for case in CASES)}, in blocks, batch", file=sys.stderr)
        return 2
    rows = [row for case in some for row in rows_of(case, case.sizes or sizes)]
    if blocks:
        rows += in_blocks(max(*sizes, 10_000_000))
    if batch:
        rows += batches(int(chosen.files or 300))
    report(rows, chosen.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
