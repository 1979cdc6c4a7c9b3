"""Batches: lines in closed form, one by one, bad records, two workers against one, a worker that dies.

python -m benchmarks._identification.batches [--quick] [--json]
python -m benchmarks._identification.batches --growth 100,1000,10000,100000
"""

import os
import resource
import signal
import tempfile
import time
from concurrent.futures import Executor
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")  # workers inherit it
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")

import jax  # noqa: E402
import numpy as np  # noqa: E402

import identify  # noqa: E402
from benchmarks._measure import Row, judged, noted, options, report  # noqa: E402
from hysteresis import LinearSponge, Preisach, Record  # noqa: E402
from hysteresis.preisach import GridDensity  # noqa: E402

SPONGE = LinearSponge(0.3, 0.0)
SAME: dict[str, Any] = {"conditioning": "keep", "clocks": "keep", "noise": "gaussian"}
ROWS = 500


def curves(count: int, first: int = 0) -> list[Record]:
    """Noisy lines: ten seconds of a press every 2.5 s, each its own compliance."""
    t = np.linspace(0, 10, ROWS)
    u = 10 - 10 * np.cos(2 * np.pi * t / 2.5)
    found = []
    for k in range(first, first + count):
        random = np.random.default_rng(k)
        y = random.uniform(0.2, 0.5) * u + 0.1 * random.normal() + 0.05 * random.normal(size=ROWS)
        found.append(Record.from_arrays(u, y, time=t))
    return found


def batch_rows(quick: bool) -> list[Row]:
    """The rows of a table of benchmarks."""
    return [*_lines(quick), *_bad_record(), *_workers(quick)]


def _lines(quick: bool) -> list[Row]:
    """The loop is timed on 20 records after compiling and scaled to 1,000."""
    records = curves(1000)
    for record in records[:2]:
        identify.fit(record, SPONGE, **SAME)
    begin = time.perf_counter()
    for record in records[:20]:
        identify.fit(record, SPONGE, **SAME)
    loop = (time.perf_counter() - begin) / 20 * len(records)
    identify.fit_many(records, SPONGE, **SAME)
    taken = []
    for _ in range(3 if quick else 7):
        begin = time.perf_counter()
        batch = identify.fit_many(records, SPONGE, **SAME)
        taken.append(time.perf_counter() - begin)
    begin = time.perf_counter()
    batch.table()
    table = time.perf_counter() - begin
    begin = time.perf_counter()
    fits = [fit for _, fit in islice(batch, 20)]
    each = (time.perf_counter() - begin) / len(fits)
    many = float(np.median(taken))
    return [
        judged(
            "loop of single fits over fit_many, 1,000 sponges of 500 rows, both compiled",
            loop / many, 50, loop / max(taken), at_least=True,
        ),
        noted("the same with the table of all of them", loop / (many + table)),
        noted("fit_many of them, s", many, min(taken)),
        noted("the fit of one record when it is asked for, ms", 1e3 * each),
    ]  # fmt: skip


def _bad_record() -> list[Row]:
    records = curves(999)
    y = records[0].output
    records.insert(500, Record.from_arrays(np.zeros(ROWS), y))
    batch = identify.fit_many(records, SPONGE, **SAME)
    named = list(batch.failed) == ["500"]
    what = "fits delivered of 1,000 of which one is bad and named"
    return [judged(what, len(batch) * named, 999, at_least=True)]


def grid_fit(record: Record, *, test: Record | None, marker: str = "") -> identify.FitResult:
    """A Preisach grid fit; where `marker` names a file that is not there, its worker dies first."""
    if marker and record.source == "2" and not Path(marker).exists():
        Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return identify.fit(record, _relays(), test=test, initial="negative", **SAME)


def _relays() -> Preisach:
    return Preisach(GridDensity(0.0, 20.0, np.ones((40, 40))))


def _loops(count: int, rows: int) -> list[Record]:
    t = np.linspace(0, 1, rows)
    u = 10 - 10 * (1 - 0.9 * t) * np.cos(40 * np.pi * t)
    found = []
    for k in range(count):
        random = np.random.default_rng(k)
        y = np.asarray(_relays().simulate(None, u)) * (1 + 0.1 * random.normal())
        y = y + 0.01 * np.ptp(y) * random.normal(size=rows)
        found.append(Record.from_arrays(u, y, source=str(k)))
    return found


@contextmanager
def _cluster(workers: int) -> Any:
    from distributed import Client, LocalCluster

    with (
        LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0") as cluster,
        Client(cluster) as client,
    ):
        executor: Executor = client.get_executor(pure=False)
        yield executor


def _workers(quick: bool) -> list[Row]:
    """Grid fits of 2,000 rows by Dask; every worker has compiled before."""
    records, seconds = _loops(8 if quick else 24, 2000), {}
    for workers in (1, 2):
        with _cluster(workers) as executor:
            identify.fit_many(records[: 4 * workers], executor=executor, function=grid_fit)
            begin = time.perf_counter()
            batch = identify.fit_many(records, executor=executor, function=grid_fit)
            seconds[workers] = time.perf_counter() - begin
            assert not batch.failed
    with tempfile.TemporaryDirectory() as folder, _cluster(2) as executor:
        marker = str(Path(folder) / "killed")
        few = records[:4]
        batch = identify.fit_many(few, executor=executor, function=grid_fit, marker=marker)
        assert Path(marker).exists()
    ratio, share = seconds[1] / seconds[2], len(batch) / len(few)
    return [
        judged("one Dask worker over two, grid fits file by file", ratio, 1.7, at_least=True),
        noted("seconds of a grid fit in a worker", seconds[1] / len(records)),
        judged("part of the fits delivered though a worker died", share, 1, at_least=True),
    ]


def growth(counts: list[int], chunk: int = 10_000) -> None:
    """Seconds and memory of ever more curves in one process, the table kept and nothing else."""
    identify.fit_many(curves(1000), SPONGE, **SAME)
    print(f"{'curves':>9}{'seconds':>10}{'of these fits':>15}{'us a curve':>12}{'peak MB':>10}")
    for count in counts:
        begin, fitting, rows = time.perf_counter(), 0.0, []
        for first in range(0, count, chunk):
            records = curves(min(chunk, count - first), first)
            since = time.perf_counter()
            rows += identify.fit_many(records, SPONGE, **SAME).table()
            fitting += time.perf_counter() - since
        seconds = time.perf_counter() - begin
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"{count:9}{seconds:10.2f}{fitting:15.2f}{1e6 * fitting / count:12.0f}{peak:10.0f}")


def main() -> int:
    """Print the rows, or how the time grows."""
    curves = "numbers of curves: 100,1000"
    chosen = options("benchmarks._identification.batches", __doc__, None, growth=curves)
    jax.config.update("jax_enable_x64", True)
    if chosen.growth:
        growth([int(word) for word in chosen.growth.split(",")])
        return 0
    rows = batch_rows(chosen.quick)
    report(rows, chosen.json)
    return int(any(row.met is False for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
