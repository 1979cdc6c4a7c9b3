"""How the Preisach model's time and memory grow with the record and with the grid.

python -m benchmarks._preisach.growth SAMPLES    # prepare and evaluate once, print the peak memory in bytes
"""

import math
import subprocess
import sys
from functools import partial
from pathlib import Path

import jax

from .._measure import Row, judged, least_seconds, noted
from .inputs import SAMPLES, evaluate, look_up, modulated_sine, random_model, table

LENGTHS = (10_000, 100_000, 1_000_000, 10_000_000)
GRIDS = (50, 100, 200, 400)
GIGABYTE = 1e9


def over_lengths(rounds: int) -> dict[int, float]:
    """Seconds of `evaluate` for every number of samples, on one grid."""
    model = random_model()
    calls = {
        str(n): partial(evaluate, model, model.prepare(None, modulated_sine(n))) for n in LENGTHS
    }
    return {int(n): seconds for n, seconds in least_seconds(calls, rounds, 0.05).items()}


def over_grids(rounds: int) -> dict[int, tuple[float, float]]:
    """Seconds of the look-ups, and of the Everett table alone, for every grid, on one record."""
    calls, u = {}, modulated_sine()
    for n in GRIDS:
        model = random_model(n)
        calls[f"{n}"] = partial(look_up, model, table(model), model.prepare(None, u))
        calls[f"{n} table"] = partial(table, model)
    seconds = least_seconds(calls, rounds, 0.01)
    return {n: (seconds[f"{n}"], seconds[f"{n} table"]) for n in GRIDS}


def rows(quick: bool) -> list[Row]:
    """Figures and bars of both growths, and the memory of a long record."""
    lengths = over_lengths(3 if quick else 10)
    grids = over_grids(10 if quick else 50)
    return [
        *(
            noted(f"evaluate, T = {n:,}, ns a sample", 1e9 * seconds / n)
            for n, seconds in lengths.items()
        ),
        # 1 is linear. The short record's arrays stay in the cache, those of the long one (0.5 GB) have to
        # come from memory, and its output takes fresh pages.
        judged(
            "evaluate, exponent of T in its time from 100,000 to 10,000,000",
            math.log(lengths[10_000_000] / lengths[100_000], 100),
            1.15,
        ),
        memory_row(10_000_000),
        *(
            noted(f"evaluate, table apart, {n}x{n} grid, ns a sample", 1e9 * s / SAMPLES)
            for n, (s, _) in grids.items()
        ),
        judged("evaluate, table apart, 400x400 over 50x50", grids[400][0] / grids[50][0], 1.3),
        *(
            noted(
                f"Everett table, {n}x{n} grid, ns a cell of the triangle", 2e9 * s / (n * (n + 1))
            )
            for n, (_, s) in grids.items()
        ),
    ]


def memory_row(samples: int) -> Row:
    """Peak memory of a fresh process that prepares and evaluates a record."""
    what, bar = f"prepare and evaluate, T = {samples:,}, peak memory of a process, GB", 3.0
    if not Path("/proc/self/status").exists():
        return Row(what, math.nan, bar, reason="the peak is read from Linux's /proc")
    command = [sys.executable, "-m", "benchmarks._preisach.growth", str(samples)]
    root = Path(__file__).resolve().parents[2]
    peak = subprocess.run(command, cwd=root, check=True, capture_output=True, text=True).stdout
    return judged(what, int(peak) / GIGABYTE, bar)


def peak_memory() -> int:
    """Bytes this program held at most. `getrusage` would count what its parent held when it forked."""
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.partition("VmHWM:")[2].split()[0])


def main(samples: int) -> None:
    """Prepare and evaluate once; print the peak memory."""
    jax.config.update("jax_enable_x64", True)
    model = random_model()
    evaluate(model, model.prepare(None, modulated_sine(samples))).block_until_ready()
    print(peak_memory())


if __name__ == "__main__":
    main(int(sys.argv[1]))
