"""How often a warning about the data fires on files with which nothing is wrong.

A warning that most files get is read by nobody. The files are the measured sets of `benchmarks.accuracy`,
those of `datasets/`, and records of virtual rigs; each counts once, however many records it holds.
"""

import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from hysid.intake._selection import Selection
from hysteresis import InputError, Record
from hysteresis.internal import check_identifiable

from .. import _other_rigs
from .._measure import Row, judged, noted
from ..accuracy import TASKS, data_folder

ROW = "reproduction, cards, docs: claims of D"

MOST = 0.2
"""Of good files."""

SHIPPED = {
    "sponge-10mm-cycles": ("force (N)", "displacement (mm)"),
    "sponge-30mm-cycles": ("force (N)", "displacement (mm)"),
    "sponge-50mm-cycles": ("force (N)", "displacement (mm)"),
    "sponge-50mm-minor-loops": ("force (N)", "displacement (mm)"),
    "sponge-50mm-mixed-cycles": ("force (N)", "displacement (mm)"),
    "skin-one-place": ("force (N)", "layer 1 (V)"),
    "skin-two-places": ("force B (N)", "layer 1 (V)"),
}
"""Input and output of files of `datasets/`."""

DATASETS = Path(__file__).resolve().parents[2] / "datasets"


def files(quick: bool) -> Iterator[tuple[str, list[Record]]]:
    """The name of every file, and its records."""
    for name, (u, y) in SHIPPED.items():
        group = ("session",) if name.startswith("skin") else ()
        selection = Selection(u, y, "time (s)", group=group)
        yield name, _records(DATASETS / f"{name}.csv", selection)
    for name, rig in _other_rigs.RIGS.items():
        yield f"rig: {name}", [_other_rigs.record_of(rig)]
    if quick:
        return
    seen = set()
    with tempfile.TemporaryDirectory() as out:
        for task in TASKS:
            file = data_folder() / task.file if isinstance(task.file, str) else data_folder()
            known = task.file if isinstance(task.file, str) else task.file.__name__
            if known in seen or not file.exists():
                continue
            seen.add(known)
            if not isinstance(task.file, str):
                file = task.file(data_folder(), Path(out))
            yield task.what, _records(file, task.selection)


def _records(file: Path, selection: Selection) -> list[Record]:
    found, _ = selection.without_hold_out().records(selection.read(file))
    return [record for record, _ in found.values()]


def rows(quick: bool) -> list[Row]:
    """The share of files on which each warning fires; those that never fire in one row."""
    fires: Counter[str] = Counter()
    on: dict[str, list[str]] = {}
    count = 0
    for name, records in files(quick):
        count += 1
        codes = set()
        for record in records:
            try:
                codes |= {note.code for note in check_identifiable(record)}
            except InputError as error:
                codes.add(f"refused, {error.code}")
        fires.update(codes)
        for code in codes:
            on.setdefault(code, []).append(name)
    found = [
        judged(f"{ROW}: share of {count} good files with the warning {code}", times / count, MOST)
        for code, times in fires.most_common()
    ]
    for code, names in on.items():
        found.append(noted(f"  {code} fires on", len(names), reason="; ".join(names)[:300]))
    return found or [judged(f"{ROW}: share of {count} good files with any warning", 0.0, MOST)]
