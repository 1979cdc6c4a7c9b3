"""What a report costs: of a fit of 50,000 rows, and of a page on 100 specimens.

python -m benchmarks.identification --only reports [--quick] [--json]
"""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import identify
from hysid.reporting._report import write_report
from hysid.reporting._specimens_page import write_many
from hysteresis import LinearSponge, Record

from .._measure import Row, judged, noted

ROWS, SPECIMENS = 50_000, 100


def report_rows(quick: bool) -> list[Row]:
    """Seconds count from a loaded interpreter, compiling among them; megabytes are 10^6 bytes."""
    return [*_single("Preisach"), *([] if quick else _single("LinearSponge")), *_many()]


def _single(model: str) -> list[Row]:
    found = identify.fit(_loops(), model, test_cycles=4)
    with tempfile.TemporaryDirectory() as name:
        folder = identify.save(found, name)
        seconds, file = _timed(lambda: write_report(folder))
        size = file.stat().st_size / 1e6
    of = f"report of {ROWS:,} rows, {model}"
    return [judged(f"{of}, s", seconds, 15.0), judged(f"{of}, MB", size, 5.0)]


def _many() -> list[Row]:
    """Lines over as many specimens, each of 400 rows; their own reports not counted."""
    t = np.linspace(0, 10, 400)
    u = 10 - 10 * np.cos(2 * np.pi * t / 2.5)
    random = np.random.default_rng(0)
    records = [
        Record.from_arrays(u, random.uniform(0.2, 0.5) * u + 0.05 * random.normal(size=len(u)))
        for _ in range(SPECIMENS)
    ]
    names = [f"s{k}" for k in range(SPECIMENS)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        identify.fit_many(records, LinearSponge(0.3, 0.0), out=folder, names=names)
        each = {k: folder / k for k in names}
        file = folder / "report.html"
        seconds, _ = _timed(lambda: write_many(each, file))
        size = file.stat().st_size / 1e6
    of = f"page on {SPECIMENS} specimens"
    return [noted(f"{of}, s", seconds), judged(f"{of}, MB", size, 5.0)]


def _timed(call: Callable[[], Any]) -> tuple[float, Any]:
    begin = time.perf_counter()
    found = call()
    return time.perf_counter() - begin, found


def _loops() -> Record:
    """A noisy loop that narrows over twenty presses."""
    t = np.linspace(0, 500, ROWS)
    u = 10 - 10 * np.cos(2 * np.pi * t / 25) * np.linspace(1, 0.6, ROWS)
    y = 0.3 * u + 0.05 * u * np.tanh(np.gradient(u, t))
    y += 0.05 * np.random.default_rng(0).normal(size=ROWS)
    return Record.from_arrays(u, y, time=t, input_unit="N", output_unit="mm")
