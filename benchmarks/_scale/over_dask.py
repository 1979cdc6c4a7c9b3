"""`hysid batch` over Dask's LocalCluster: one worker against two, a worker that dies, the client's memory.

Files of 1,000 rows of the sliders of `benchmarks.scale`, each with noise of its own. The scheduler and its
workers run beside the command, as on a cluster, so that the command's memory is the client's alone.
"""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROWS = 1_000

CONFIG = """
[selection]
input = "input"
output = "output"
time = "time"

[fit]
model = "{model}"
noise = "{noise}"
"""


class Batch(NamedTuple):
    """Seconds and peak memory (GB) of the command, and how many files it has fitted."""

    seconds: float
    memory: float
    fitted: int


def write_files(folder: Path, columns: tuple[np.ndarray, ...], count: int) -> None:
    """So many files of the same input, whose outputs differ by noise."""
    folder.mkdir()
    t, u, y = columns
    for k in range(count):
        noise = np.random.default_rng(k).normal(0.0, 0.005, len(t))
        table = np.column_stack([t, u, y + noise])
        file = folder / f"run{k:05}.csv"
        np.savetxt(file, table, "%.7g", ",", header="time,input,output", comments="")


@contextmanager
def cluster(workers: int) -> Iterator[Any]:
    """So many workers of one thread each."""
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[variable] = "1"
    flags = "--xla_cpu_multi_thread_eigen=false"
    if flags not in os.environ.get("XLA_FLAGS", ""):
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flags}".strip()
    from distributed import LocalCluster

    with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0") as started:
        yield started


def batch(
    started: Any, pattern: Path, model: str, out: Path, noise: str = "auto", killed: bool = False
) -> Batch:
    """The command over a cluster; `killed`: one worker is, after the first fit."""
    config = out.with_suffix(".toml")
    config.write_text(CONFIG.format(model=model, noise=noise))
    words = ("-m", "hysid", "batch", str(pattern), "--config", str(config), "--out", str(out))
    words = (*words, "--scheduler", started.scheduler_address, "--json")
    begin = time.perf_counter()
    with subprocess.Popen(
        [sys.executable, *words], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as child:
        if killed:
            threading.Thread(target=_kill_one, args=(started, out), daemon=True).start()
        assert child.stdout is not None
        document = json.loads(child.stdout.read())
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    assert child.returncode == 0
    return Batch(time.perf_counter() - begin, used.ru_maxrss / 1e6, document["fitted"])


def _kill_one(started: Any, out: Path) -> None:
    while not list(out.glob("*/fit.json")):
        time.sleep(0.05)
    nanny = next(iter(started.workers.values()))
    os.kill(nanny.pid, signal.SIGKILL)
