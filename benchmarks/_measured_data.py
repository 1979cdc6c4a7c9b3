"""Measured files with the columns a task asks for: derived, not copied."""

import csv
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from hysteresis import read_csv, read_table
from hysteresis.records._table import Table


def foam_stress(folder: Path, out: Path) -> Path:
    """Strain and stress of the three specimens that are fitted and the one that is held out."""
    cards = read_table(folder / "foam-midsole-compression/samples.csv")
    table = read_table(folder / "foam-midsole-compression/tidy.csv")
    size = {
        name: (float(d), float(h))
        for name, d, h in zip(
            *(cards.text[k] for k in ("sample", "diameter_mm", "height_mm")), strict=True
        )
    }
    names = ("leap-comp-3", "turbo-comp-1", "new-heel-comp-1", "turbo-comp-3")
    rows = []
    for name, t, d, F in _rows(table, "sample", "time_s", "compression_mm", "force_N"):
        if name in names:
            diameter, height = size[name]
            stress = 1e3 * float(F) / (np.pi / 4 * diameter**2)
            rows.append((name, t, float(d) / height, stress))
    return _written(out / "foam-stress.csv", ("sample", "time (s)", "strain", "stress (kPa)"), rows)


def foam_hold(folder: Path, out: Path) -> Path:
    """What follows the six cycles is a slow ramp and a hold, where a specimen has one."""
    file = folder / "foam-midsole-compression/tidy.csv"
    rows = []
    table = read_table(file)
    for name in dict.fromkeys(table.text["sample"].tolist()):
        record = read_csv(
            table, input="compression_mm", output="force_N", time="time_s",
            where={"sample": [name]},
        )  # fmt: skip
        assert record.time is not None
        after = np.arange(len(record)) > np.flatnonzero(record.cycle == 6)[-1]
        # A rest at the last minimum is no ramp.
        if not after.any() or np.ptp(record.input[after]) < 0.5 * np.ptp(record.input):
            continue
        part = np.where(after, "hold", "cycles")
        rows += zip(
            [name] * len(record), record.time, record.input, record.output, part, strict=True
        )
    header = ("sample", "time (s)", "compression (mm)", "force (N)", "part")
    return _written(out / "foam-hold.csv", header, rows)


def eflesh(folder: Path, out: Path) -> Path:
    """Both normal runs: the main channel, the depth (-z) and the load where it was fresh."""
    table = read_table(folder / "eflesh-magnetic-tactile/tidy_normal.csv")
    columns = ("run", "time_s", "z_mm", "load_reading", "main_channel")
    rows = [
        (run, t, -float(z), table.text[main][k], load)
        for k, (run, t, z, load, main) in enumerate(_rows(table, *columns))
    ]
    header = ("run", "time (s)", "depth (mm)", "main", "load")
    return _written(out / "eflesh.csv", header, rows)


def eflesh_loads(folder: Path, out: Path) -> Path:
    """The rows with a fresh load."""
    table = read_table(eflesh(folder, out))
    header = ("run", "time (s)", "depth (mm)", "main", "load")
    rows = [row for row in _rows(table, *header) if row[-1] not in ("", "nan", "NaN")]
    return _written(out / "eflesh-loads.csv", header, rows)


def vhb_taut(folder: Path, out: Path) -> Path:
    """Displacements are left out where the film is slack: force near zero after its maximum."""
    table = read_table(folder / "vhb4910-tape-tension/tidy_loading_unloading.csv")
    rows: list[tuple[str, ...]] = []
    names, *numbers = (table.text[k] for k in ("test", "time_s", "displacement_mm", "force_N"))
    for name in dict.fromkeys(names.tolist()):
        t, d, F = (a[names == name] for a in numbers)
        past = np.arange(len(d)) > np.argmax(d.astype(float))
        slack = past & (F.astype(float) < 0.02)
        rows += zip([name] * len(t), t, np.where(slack, "", d), F, strict=True)
    header = ("test", "time (s)", "displacement (mm)", "force (N)")
    return _written(out / "vhb-taut.csv", header, rows)


def _rows(table: Table, *columns: str) -> Iterable[tuple[str, ...]]:
    return zip(*(table.text[column] for column in columns), strict=True)


def _written(file: Path, header: Iterable[str], rows: Iterable[Iterable[object]]) -> Path:
    with file.open("w", newline="", encoding="utf-8") as handle:
        csv.writer(handle).writerows([list(header), *rows])
    return file
