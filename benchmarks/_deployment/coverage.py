"""Coverage of guaranteed bands: whole unseen runs of ten sensors, over 200 random splits.

python -m benchmarks._deployment.coverage [--quick] [--json]

A model is fitted to the first runs of a sensor. Of the others, which it has not seen, 19 chosen at random
make the band with a guarantee of 90 per cent, and the rest are counted: a run is held if all its inputs lie
in its band. The oracle's band of constant shape is as wide as the 90 per cent quantile of the scores of all
these runs.
"""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from compensate import invert
from compensate.uncertainty._guaranteed import rank, run_scores
from hysid.intake._selection import Selection
from hysteresis import Record
from hysteresis.rigs import SpongeRig
from identify import fit

from .._measure import Row, judged, noted, options, report
from ..accuracy import EGAIN, data_folder

GUARANTEE, RUNS, SPLITS = 0.9, 19, 200
FAR, WIDE = 3.0, 1.3
"""Per cent that coverage may be off; widths over the oracle's."""


class Runs(NamedTuple):
    """Runs that are fitted, and those that are split."""

    fitted: Record
    split: Record


def coverage_rows(quick: bool) -> list[Row]:
    """Of each sensor: coverage, and width over the oracle's, as means over the splits."""
    rows: list[Row] = []
    for name, runs in _sensors(quick):
        compensator = invert(fit(runs.fitted, model="Preisach").model)
        scores = run_scores(compensator, runs.split)
        held, wide = _over_splits(scores)
        what = f"{name}, {len(scores)} runs: "
        rows += [
            judged(f"{what}coverage of unseen runs off 90 %, per cent", abs(held - 90), FAR),
            judged(f"{what}width over the oracle's", wide, WIDE),
        ]
    if not rows:
        rows.append(noted("coverage of unseen runs", np.nan, reason="the data are not here"))
    return rows


def _over_splits(scores: np.ndarray) -> tuple[float, float]:
    random = np.random.default_rng(0)
    k, oracle = rank(RUNS, GUARANTEE), np.quantile(scores, GUARANTEE, method="inverted_cdf")
    held, wide = [], []
    for _ in range(SPLITS):
        order = random.permutation(scores)
        factor = np.sort(order[:RUNS])[k - 1]
        held.append(float((order[RUNS:] <= factor).mean()))
        wide.append(factor / oracle)
    return 100 * float(np.mean(held)), float(np.mean(wide))


def _sensors(quick: bool) -> Iterator[tuple[str, Runs]]:
    for seed in range(1 if quick else 2):
        yield f"virtual sponge {seed + 1}", _sponge(seed)
    folder = data_folder()
    if not folder.exists() or quick:
        return
    yield from _egain(folder)
    yield from _laminate(folder)
    selection = Selection("command (V)", "position (um)", "time (s)")
    records, _ = selection.records(selection.read(folder / "piezo-manipulator/tidy.csv"))
    ((record, _),) = records.values()
    yield "piezo manipulator", Runs(*record.split_rows(record.cycle > 8))


def _sponge(seed: int) -> Runs:
    random = np.random.default_rng(seed)
    rise = np.linspace(0, 1, 40, endpoint=False)
    shape = np.append(rise, 1 - rise)
    u = np.concatenate([random.uniform(8, 20) * shape for _ in range(90)])
    y = np.asarray(SpongeRig().follow(u, dt=0.5)) + 0.05 * random.normal(size=len(u))
    cut = [slice(10 * 80, 30 * 80), slice(30 * 80, 90 * 80)]
    return Runs(*(Record.from_arrays(u[rows], y[rows], dt=0.5) for rows in cut))


def _egain(folder: Path) -> Iterator[tuple[str, Runs]]:
    """Presses of a liquid-metal sensor at three places."""
    selection = Selection(
        "force_pos", "voltage", dt=0.05, each="x_location", group=("split", "trial")
    )
    records, _ = selection.records(selection.read(folder / EGAIN))
    for name, (record, _) in records.items():
        labels = np.random.default_rng(0).permutation(list(record.labels))[:160]
        fitted, split = (record.take_sequences(list(part)) for part in (labels[:60], labels[60:]))
        yield f"liquid metal, place {name}", Runs(fitted, split)


def _laminate(folder: Path) -> Iterator[tuple[str, Runs]]:
    """Fatigue cycles of five laminates, which creep on; runs at random are exchangeable all the same."""
    selection = Selection("force (kN)", "displacement (mm)", dt=1.0, each="specimen")
    records, _ = selection.records(selection.read(folder / "gfrp-fatigue-loops/tidy.csv"))
    for name, (record, _) in records.items():
        first = record.cycle <= 10
        yield f"laminate {name}", Runs(*record.split_rows(~first))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run every sensor and print the table."""
    chosen = options("benchmarks._deployment.coverage", __doc__, arguments)
    jax.config.update("jax_enable_x64", True)
    report(coverage_rows(chosen.quick), chosen.json)


if __name__ == "__main__":
    main(sys.argv[1:])
