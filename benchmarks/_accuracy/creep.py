"""Creep and relaxation of polymers and a foam: errors at equal numbers of parameters, and of foretelling.

The references are another package's fits, given to one digit; ours are rounded to it. Their rows are not
named: even in log time, two hundred to the record, ours give its figures for polystyrene.
"""

from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from identify import Response, spectrum
from identify.spectra._spectrum import Spectrum

from .._measure import Row, judged, noted

FOLDER = "polymer-creep-relaxation"
NUMBERS = (4, 6, 8)
"""Parameters at which the references are given."""
BINS = 200
FIRST = 1 / 3
"""The part of a record from which the rest is foretold."""
NOISE = 1.645


class Creep(NamedTuple):
    """A record in the folder: a header of `skip` lines, then time and J or G, read from `begin` on."""

    what: str
    kind: Literal["creep", "relaxation"]
    name: str
    skip: int
    references: tuple[float, float, float]
    begin: float = 0.0

    def read(self, folder: Path) -> np.ndarray:
        """Times and outputs, (2, rows)."""
        return np.loadtxt(folder / FOLDER / self.name, skiprows=self.skip)[:, :2].T


RECORDS = (
    Creep("polystyrene", "creep", "creep_ps130_data.csv", 1, (12.7, 4.5, 2.1)),
    # Before a hundredth of a second its readings are noise of either sign.
    Creep("polyethylene", "creep", "CM3_Creep.creep", 3, (19.3, 12.3, 9.9), 0.01),
    Creep("liquid foam", "relaxation", "stressrelaxation_liquidfoam_data.csv", 1, (4.8, 2.6, 1.9)),
)


def rows(folder: Path) -> list[Row]:
    """All figures of all records, in per cent."""
    found = []
    for record in RECORDS:
        if not (folder / FOLDER / record.name).exists():
            found.append(noted(record.what, float("nan"), reason="the data are not here"))
            continue
        t, y = record.read(folder)
        found += _in_sample(record, t, y)
        found += _foretold(record, t[t >= record.begin], y[t >= record.begin])
    return found


def _in_sample(record: Creep, t: np.ndarray, y: np.ndarray) -> list[Row]:
    tried = spectrum(Response(*even_in_log_time(t, y), record.kind))
    found = []
    for most, reference in zip(NUMBERS, record.references, strict=True):
        short = [row for row in tried.table if row.parameters <= most and not row.dense]
        best = min(short, key=lambda row: row.rms)
        what = f"{record.what}, {record.kind}, {best.parameters} parameters, relative rms error"
        found.append(judged(what, round(100 * best.rms, 1), reference))
    chosen = tried.row
    what = f"{record.what}, {record.kind}, order by evidence ({chosen.parameters} parameters)"
    if record.name.startswith("creep_ps130"):
        return [*found, judged(what, 100 * chosen.rms, 1.5)]
    return [*found, noted(what, 100 * chosen.rms)]


def _foretold(record: Creep, t: np.ndarray, y: np.ndarray) -> list[Row]:
    head = t <= FIRST * t[-1]
    found: Spectrum = spectrum(Response(t[head], y[head], record.kind))
    value, low, high = found.predict(t[~head])
    noise = NOISE * found.noise.sigma * value
    inside = (low - noise <= y[~head]) & (y[~head] <= high + noise)
    what = f"{record.what}, {record.kind}, from its first third"
    return [
        judged(f"{what}: rows in the 90 % range", 100 * inside.mean(), 90.0, at_least=True),
        noted(f"{what}: width of that range at the end", 100 * (high - low)[-1] / value[-1]),
        noted(f"{what}: error at the end", 100 * abs(value[-1] / y[-1] - 1)),
    ]


def even_in_log_time(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of the rows in bins evenly spaced in log time."""
    t, y = t[t > 0], y[t > 0]
    edges = np.geomspace(t.min() * 0.999, t.max() * 1.001, BINS + 1)
    at = np.digitize(t, edges)
    return tuple(np.array([x[at == k].mean() for k in np.unique(at)]) for x in (t, y))  # type: ignore[return-value]
