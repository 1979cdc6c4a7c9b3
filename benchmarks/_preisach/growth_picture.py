"""The picture of both growths, with peers beside."""

import sys
from collections.abc import Callable, Sequence
from typing import Any

import jax
import matplotlib
from matplotlib.figure import Figure

from hysid.figures._base import BLUE, GREEN, ORANGE, VERMILLION, styled

from .._measure import least_seconds
from .growth import GRIDS, LENGTHS, over_grids, over_lengths
from .inputs import CELLS, SAMPLES, modulated_sine, random_weights
from .relays import DENSE_LOOP, DENSE_SCAN, SWEPT_LOOP, peers

LINES: dict[str, dict[str, Any]] = {
    "evaluate": {"color": BLUE, "marker": "o", "lw": 2.2},
    "evaluate, table apart": {"color": BLUE, "ls": ":"},
    DENSE_SCAN: {"color": VERMILLION, "marker": "s", "lw": 1.1, "ms": 5},
    DENSE_LOOP: {"color": ORANGE, "marker": "^", "lw": 1.1, "ms": 5},
    SWEPT_LOOP: {"color": GREEN, "marker": "v", "lw": 1.1, "ms": 5},
}


def picture(file: str) -> None:
    """Draw both growths, peers beside, into a file of any format matplotlib knows."""
    lengths, grids = over_lengths(5), over_grids(10)
    ours_by_grid = {
        "evaluate": {n: look_ups + table for n, (look_ups, table) in grids.items()},
        "evaluate, table apart": {n: look_ups for n, (look_ups, _) in grids.items()},
    }
    # A dense peer visits 5,050 relays a sample: beyond 100,000 samples it would take minutes.
    by_length = {"evaluate": lengths} | _peers_over(LENGTHS[:2], lambda n: (CELLS, n))
    by_grid = ours_by_grid | _peers_over(GRIDS, lambda n: (n, SAMPLES))
    _draw(file, by_length, by_grid)


def _peers_over(
    sizes: Sequence[int], problem: Callable[[int], tuple[int, int]]
) -> dict[str, dict[int, float]]:
    """Seconds of every peer at every size; `problem` gives (cells, samples)."""
    taken: dict[str, dict[int, float]] = {}
    for size in sizes:
        cells, samples = problem(size)
        weights = random_weights(cells)
        for name, seconds in least_seconds(peers(weights, modulated_sine(samples)), 1).items():
            taken.setdefault(name, {})[size] = seconds
    return taken


@styled
def _draw(
    file: str, by_length: dict[str, dict[int, float]], by_grid: dict[str, dict[int, float]]
) -> None:
    settings: Any = matplotlib.rcParams
    settings.update({"text.parse_math": True, "svg.hashsalt": "hysid"})  # powers of ten; no dates
    figure = Figure(figsize=(8.4, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for axes, growths in ((left, by_length), (right, by_grid)):
        for name, seconds in growths.items():
            axes.loglog(list(seconds), list(seconds.values()), label=name, **LINES[name])
    left.set(xlabel=f"samples, on a {CELLS}x{CELLS} grid", ylabel="time (s)")
    right.set(xlabel=f"cells along a side of the grid, {SAMPLES:,} samples")
    right.set_xticks(GRIDS, [str(n) for n in GRIDS])
    right.minorticks_off()
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.savefig(file, metadata={"Date": None} if file.endswith(".svg") else None)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    picture(sys.argv[1])
