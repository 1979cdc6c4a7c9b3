"""Fits of a record in other units, moved far off, and made again."""

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np

import identify
from hysteresis import Record
from tests.test_hysid.command import COLUMNS, ENVIRONMENT, put, sponge, text

from .._measure import Row, judged

MODELS = ("LinearSponge", "Burgers", "Preisach", "Composition")
SHIFTED = ("LinearSponge", "Preisach", "Composition")
"""Those with an offset of their own."""
FACTORS = (1e-9, 1e-3, 1e3, 1e9)
RANGES = 1e6
"""Offsets, in ranges of the column."""


def equivariance() -> list[Row]:
    """The prediction of a changed record, changed back, beside that of the record: largest difference."""
    t, force, stroke = (np.array(column, float) for column in list(zip(*sponge(), strict=True))[:3])
    size, rows = float(np.ptp(stroke)), []

    def predicted(model: str, a: float = 1, b: float = 0, c: float = 1, d: float = 0) -> np.ndarray:
        record = Record.from_arrays(a * force + b, c * stroke + d, time=t)
        return (identify.fit(record, model).predict(record) - d) / c

    for model in MODELS:
        plain = predicted(model)
        scaled = [predicted(model, a=k) for k in FACTORS] + [predicted(model, c=k) for k in FACTORS]
        off = max(float(np.abs(one - plain).max()) for one in scaled) / size
        what = f"{model}: columns times 1e-9 to 1e9, of {len(scaled)}, largest difference over the range"
        rows.append(judged(what, off, 1e-6))
        if model in SHIFTED:
            shifted = predicted(model, b=RANGES * np.ptp(force)), predicted(model, d=RANGES * size)
            for column, one in zip(("input", "output"), shifted, strict=True):
                off = float(np.abs(one - plain).max()) / size
                what = f"{model}: {column} moved by {RANGES:g} ranges, largest difference"
                rows.append(judged(what, off, 1e-6))
    return rows


def repetition() -> list[Row]:
    """Files of the same command in two processes."""
    put(text(sponge()))
    found: dict[str, dict[str, str]] = {}
    for name in ("one", "again"):
        command = [sys.executable, "-m", "hysid", "fit", "run.csv", *COLUMNS]
        command += ["--model", "Preisach", "--out", name]
        subprocess.run(command, env=ENVIRONMENT, check=True, capture_output=True)
        found[name] = {
            file.name: hashlib.sha256(file.read_bytes()).hexdigest()
            for file in sorted(Path(name).glob("*.npz"))
        }
    other = sum(found["one"][file] != found["again"][file] for file in found["one"])
    what = f"arrays of a fit made again: other bytes, of {len(found['one'])} files"
    return [judged(what, other, 0)]
