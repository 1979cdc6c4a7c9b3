"""Timing of calls side by side, and the table or JSON that every benchmark prints."""

import argparse
import json
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np


class Row(NamedTuple):
    """One figure: `value` against `bar`, not above it. `least` is the fastest round's.

    `met` is None, with a `reason`, where this run cannot judge it.
    """

    what: str
    value: float
    bar: float | None = None
    least: float | None = None
    met: bool | None = None
    reason: str = ""


def judged(what: str, value: float, bar: float, least: float | None = None) -> Row:
    """A row whose value must not exceed its bar."""
    return Row(what, value, bar, least, bool(value <= bar))


def noted(
    what: str, value: float, least: float | None = None, reason: str = "no bar is set"
) -> Row:
    """A row for the record."""
    return Row(what, value, None, least, None, reason)


def interleaved(calls: Mapping[str, Callable[[], Any]], rounds: int) -> dict[str, np.ndarray]:
    """Seconds of each call in each round, (rounds,).

    Every round runs every call once, so that what disturbs the machine disturbs all alike and
    ratios within a round are fair. Two rounds before the first compile and warm the caches.
    """
    seconds = {name: np.empty(rounds) for name in calls}
    for k in range(-2, rounds):
        for name, call in calls.items():
            begin = time.perf_counter()
            jax.block_until_ready(call())
            if k >= 0:
                seconds[name][k] = time.perf_counter() - begin
    return seconds


def machine() -> str:
    """Processor, cores, threads and versions, in a line."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [
            x.partition(":")[2].strip() for x in cpuinfo.read_text().splitlines() if "name" in x
        ]
        model = next(iter(names), model)
    flags = os.environ.get("XLA_FLAGS", "")
    threads = "1 XLA thread" if "multi_thread_eigen=false" in flags else "XLA's default threads"
    blas = os.environ.get("OMP_NUM_THREADS", "default")
    return (
        f"{model}, {os.cpu_count()} cores; {jax.default_backend()}, {threads}, OMP threads {blas}; "
        f"Python {platform.python_version()}, JAX {jax.__version__}, NumPy {np.__version__}"
    )


def report(rows: Sequence[Row], as_json: bool) -> None:
    """Print the rows as a table, or as `{"machine", "rows"}`."""
    if as_json:
        listed = []
        for row in rows:
            entry = {"what": row.what, "value": row.value, "bar": row.bar, "met": row.met}
            entry |= {"least": row.least} if row.least is not None else {}
            listed.append(entry | ({"reason": row.reason} if row.met is None else {}))
        print(json.dumps({"machine": machine(), "rows": listed}))
        return
    print(machine())
    width = max(len(row.what) for row in rows)
    print(f"{'what':{width}}  {'median':>8}  {'least':>8}  {'bar':>6}  met")
    for what, value, bar, least, met, reason in rows:
        beside = "" if least is None else f"{least:.3g}"
        limit = "" if bar is None else f"{bar:g}"
        verdict = reason if met is None else "yes" if met else "NO"
        print(f"{what:{width}}  {value:8.3g}  {beside:>8}  {limit:>6}  {verdict}")


def options(module: str, about: str | None, arguments: Sequence[str] | None) -> argparse.Namespace:
    """`--quick` and `--json` of `python -m benchmarks.NAME`."""
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=about)
    parser.add_argument("--quick", action="store_true", help="fewer rounds")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    return parser.parse_args(arguments)
