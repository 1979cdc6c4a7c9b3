"""A compensator that runs on: the last five cycles of a record, repeated 100 times.

A drift tells of one run. Where it is in what compensates, the error goes on growing with the passes; the
specimens here drift with the cycles, with the time, and with both, and measured foams do.
"""

from collections.abc import Iterator

import numpy as np

import hysid
from hysteresis import Record, read_csv, read_table

from .._measure import Row, judged, noted
from ..accuracy import data_folder

WHAT = "the last five cycles repeated 100 times, error at pass 100 over pass 2"
BAR = 1.2
PASSES = 100
ROWS = 100
"""Rows of a cycle, about: every so many of a measured one."""

FOAMS = (
    ("foam-midsole-compression/tidy.csv", "compression_mm", "force_N", "time_s", "sample"),
    ("foam-instron-cyclic/tidy.csv", "displacement (mm)", "force (N)", "time (s)", None),
)


def rows(quick: bool) -> list[Row]:
    """The worst specimen, then each of them."""
    specimens = [*_virtual(2 if quick else 6)]
    if not quick:
        specimens += _measured()
    each = [(name, *ratio(record)) for name, record in specimens]
    worst = max((found for _, found, _ in each), default=float("nan"))
    return [
        judged(f"{WHAT}, worst of {len(each)}", worst, BAR),
        *(noted(f"  {name}: {level}", found) for name, found, level in each),
    ]


def ratio(record: Record) -> tuple[float, str]:
    """rms error of the estimated input in pass 100 over that in pass 2, and the level of the verdict."""
    fit = hysid.fit(record, "Composition", test_cycles=1, purpose="compensate")
    numbers = np.unique(record.cycle[record.cycle > 0])[-5:]
    last = np.isin(record.cycle, numbers)
    u, y, t = record.input[last], record.output[last], record.time
    assert t is not None
    step = float(np.median(np.diff(t)))
    # The first pass is the record itself; a repeated one begins a step after the one before.
    once = t[last] - t[last][0] + step
    again = [t[-1] + k * once[-1] + once for k in range(PASSES - 1)]
    readings = np.concatenate([record.output, *[y] * (PASSES - 1)])
    found = hysid.invert(fit).simulate(np.concatenate([t, *again]), readings)
    passes = np.asarray(found.value)[len(record) :].reshape(PASSES - 1, -1)
    error = np.sqrt(np.mean((passes - u) ** 2, axis=1))
    return float(error[-1] / error[0]), fit.verdict.level


def _virtual(count: int) -> Iterator[tuple[str, Record]]:
    """Foams with a loop that lags, whose stiffness and zero drift by different laws."""
    for seed in range(count):
        rng = np.random.default_rng([44, seed])
        period, cycles = rng.uniform(5, 40), int(rng.integers(10, 22))
        t = np.linspace(0, cycles * period, cycles * ROWS + 1)
        u = 5 - 5 * np.cos(2 * np.pi * t / period)
        lag = rng.uniform(0.3, 1.5) * np.sin(2 * np.pi * t / period) * np.sqrt(u / 10)
        curve = rng.uniform(0.3, 1) * u + rng.uniform(0.02, 0.1) * u**2
        law = (np.log1p(t / period), np.sqrt(t / t[-1]), 1 - np.exp(-3 * t / t[-1]))[seed % 3]
        softer = 1 - rng.uniform(0.02, 0.08) * law / law[-1] * (seed % 2)
        moved = rng.uniform(-1, 1) * law / law[-1]
        y = (curve + lag) * softer + moved + rng.normal(0, 0.02, len(t))
        name = f"virtual foam {seed + 1}, {cycles} cycles"
        yield name, Record.from_arrays(u, y, t, input_unit="mm", output_unit="N")


def _measured() -> Iterator[tuple[str, Record]]:
    for file, given, output, time, each in FOAMS:
        path = data_folder() / file
        if not path.exists():
            continue
        table = read_table(path)
        names = [None] if each is None else sorted(set(table.text[each].tolist()))
        for name in names:
            where = None if each is None or name is None else {each: [name]}
            whole = read_csv(table, given, output, time, where=where)
            many = max(1, len(whole) // (max(whole.n_cycles, 1) * ROWS))
            inside = np.flatnonzero(whole.cycle > 0)[::many]
            assert whole.time is not None
            yield str(name or "soft block"), Record.from_arrays(
                whole.input[inside], whole.output[inside], whole.time[inside],
                input_unit=whole.input_unit, output_unit=whole.output_unit,
            )  # fmt: skip
