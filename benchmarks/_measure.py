"""Timing of calls side by side, and the table or JSON that every benchmark prints."""

import argparse
import json
import math
import os
import platform
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

Calls = Mapping[str, Callable[[], Any]]


class Row(NamedTuple):
    """One figure: `value` against `bar`, not above it, or not below with `at_least`.

    `least` is the fastest round's. `met` is None, with a `reason`, where this run cannot judge it;
    `value` is NaN where it cannot even be measured.
    """

    what: str
    value: float
    bar: float | None = None
    least: float | None = None
    met: bool | None = None
    reason: str = ""
    at_least: bool = False


def judged(
    what: str, value: float, bar: float, least: float | None = None, *, at_least: bool = False
) -> Row:
    """A row whose value must not exceed its bar, or with `at_least` not fall short of it."""
    met = value >= bar if at_least else value <= bar
    return Row(what, value, bar, least, bool(met), at_least=at_least)


def noted(
    what: str, value: float, least: float | None = None, reason: str = "no bar is set"
) -> Row:
    """A row for the record."""
    return Row(what, value, None, least, None, reason)


def means(found: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Each figure's mean over what was measured several times."""
    return {name: float(np.mean([one[name] for one in found])) for name in found[0]}


def interleaved(calls: Calls, rounds: int, moment: float = 2e-3) -> dict[str, np.ndarray]:
    """Seconds of each call in each round, (rounds,).

    Every round runs every call, so that what disturbs the machine disturbs all alike and ratios
    within a round are fair. A call that takes less than a `moment` (seconds) is repeated for that
    long and the fastest taken: its caches may have been emptied by the call before. Two rounds
    before the first compile and warm up.
    """
    seconds = {name: np.empty(rounds) for name in calls}
    for k in range(-2, rounds):
        for name, call in calls.items():
            taken = _least_of(call, moment)
            if k >= 0:
                seconds[name][k] = taken
    return seconds


def _least_of(call: Callable[[], Any], moment: float) -> float:
    least, end = math.inf, time.perf_counter() + moment
    while (begin := time.perf_counter()) < end:
        jax.block_until_ready(call())
        least = min(least, time.perf_counter() - begin)
    return least


def least_seconds(calls: Calls, rounds: int, moment: float = 2e-3) -> dict[str, float]:
    """The least of each call's `interleaved` times: what else the machine does only adds to it."""
    return {name: float(taken.min()) for name, taken in interleaved(calls, rounds, moment).items()}


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


def said(row: Row) -> Row:
    """The row, which is said on stderr at once: what takes long shows what it has found so far."""
    print(f"{row.what}: {row.value:.3g}, {_verdict(row)}", file=sys.stderr, flush=True)
    return row


def _verdict(row: Row) -> str:
    return row.reason if row.met is None else "yes" if row.met else "NO"


def report(rows: Sequence[Row], as_json: bool) -> None:
    """Print the rows as a table, or as `{"machine", "rows"}`."""
    if as_json:
        print(json.dumps({"machine": machine(), "rows": [_entry(row) for row in rows]}))
        return
    print(machine())
    width = max((len(row.what) for row in rows), default=0)
    print(f"{'what':{width}}  {'value':>8}  {'least':>8}  {'bar':>7}  met")
    for row in rows:
        what, value, bar, least, _, _, at_least = row
        beside = "" if least is None else f"{least:.3g}"
        limit = "" if bar is None else f"{'≥' if at_least else '≤'} {bar:g}"
        known = f"{value:.3g}" if abs(value) < 1000 or value % 1 else f"{value:.0f}"
        print(f"{what:{width}}  {known:>8}  {beside:>8}  {limit:>7}  {_verdict(row)}")


def _entry(row: Row) -> dict[str, Any]:
    # JSON has no NaN.
    value = None if math.isnan(row.value) else row.value
    entry: dict[str, Any] = {"what": row.what, "value": value, "bar": row.bar, "met": row.met}
    entry |= {"at_least": True} if row.at_least else {}
    entry |= {"least": row.least} if row.least is not None else {}
    return entry | ({"reason": row.reason} if row.met is None else {})


def run_parts(
    module: str,
    about: str | None,
    parts: Mapping[str, Callable[[bool], list[Row]]],
    arguments: Sequence[str] | None,
) -> None:
    """Run the parts of a benchmark, or with `--only TEXT` those with this in their name, and print."""
    chosen = options(module, about, arguments, only="parts with this in their name")
    jax.config.update("jax_enable_x64", True)
    rows: list[Row] = []
    for name, part in parts.items():
        if (chosen.only or "") in name:
            print(f"{name} ...", file=sys.stderr, flush=True)
            rows += part(chosen.quick)
    report(rows, chosen.json)


def options(
    module: str,
    about: str | None,
    arguments: Sequence[str] | None,
    flags: Mapping[str, str] | None = None,
    **others: str,
) -> argparse.Namespace:
    """`--quick` and `--json` of `python -m benchmarks.NAME`, `flags`, and `others` that take a value."""
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=about)
    own = {"quick": "fewer rounds", "json": "one JSON object on stdout"}
    for name, meaning in (own | dict(flags or {})).items():
        parser.add_argument(f"--{name}", action="store_true", help=meaning)
    for name, meaning in others.items():
        parser.add_argument(f"--{name}", help=meaning)
    return parser.parse_args(arguments)
