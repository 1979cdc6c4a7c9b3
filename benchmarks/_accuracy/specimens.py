"""A new specimen like earlier ones: its error from the first cycle, over that without the others."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import identify
from hysid.intake._selection import Selection
from hysteresis import Record

from .._measure import Row, judged, noted

LIKE = "a new specimen like earlier ones"
"""What `--only` has to be part of for these rows."""
PRESSES = 5
"""Of many short sequences so many stand for a new specimen, from the beginning and from the middle."""
FOAM = "foam-midsole-compression/tidy.csv"
SETS = {
    "foam, compression -> force": (
        FOAM, Selection("compression_mm", "force_N", "time_s", each="sample")),
    "foam, force -> compression": (
        FOAM, Selection("force_N", "compression_mm", "time_s", each="sample")),
    "laminates": (
        "gfrp-fatigue-loops/tidy.csv",
        Selection("force (kN)", "displacement (mm)", dt=1.0, each="specimen")),
    "eGaIn, places": (
        "egain-microfluidic-pressure/tidy.csv",
        Selection("force_pos", "voltage", dt=0.05, each="x_location", group=("split", "trial"))),
}  # fmt: skip


def rows(folder: Path) -> Iterator[Row]:
    """Geometric means over the specimens of each set, each left out in turn."""
    over_alone: list[float] = []
    over_all: list[float] = []
    for name, (file, selection) in SETS.items():
        if not (folder / file).exists():
            yield noted(f"{LIKE}: {name}", float("nan"), reason="the data are not here")
            continue
        records = [one for one, _ in selection.records(selection.read(folder / file))[0].values()]
        fits = [identify.fit(one) for one in records]
        found = []
        for k, (record, whole) in enumerate(zip(records, fits, strict=True)):
            others = fits[:k] + fits[k + 1 :]
            for few, later in _beginnings(record):
                mixed, alone = identify.fit(few, like=others), identify.fit(few)
                found.append([_rms(one, record, later) for one in (mixed, alone, whole)])
        mixed, alone, whole = np.log(found).T
        over_alone += list(mixed - alone)
        over_all += list(mixed - whole)
        said = f"{LIKE}: {name}, error over that of"
        yield noted(f"{said} a fit to the beginning alone", float(np.exp(np.mean(mixed - alone))))
        yield noted(f"{said} a fit to all its cycles", float(np.exp(np.mean(mixed - whole))))
    if over_alone:
        said = f"{LIKE}: all {len(over_alone)}, error over that of"
        yield judged(f"{said} a fit to the beginning alone", np.exp(np.mean(over_alone)), 0.6)
        yield judged(f"{said} a fit to all its cycles", np.exp(np.mean(over_all)), 1.3)


def _beginnings(record: Record) -> Iterator[tuple[Record, np.ndarray]]:
    """Records of a beginning, and the rows that are told from it: after the first cycle, or of others."""
    if len(record.labels) == 1:
        yield record.exclude(record.cycle != 1), record.mask & (record.cycle > 1)
        return
    for first in (0, len(record.labels) // 2):
        few = record.labels[first : first + PRESSES]
        seen = np.concatenate([np.full(s.stop - s.start, x in few) for x, s in record.sequences()])
        yield record.take_sequences(few), record.mask & ~seen


def _rms(fit: identify.FitResult, record: Record, later: np.ndarray) -> float:
    return float(np.sqrt(np.mean((fit.predict(record) - record.output)[later] ** 2)))
