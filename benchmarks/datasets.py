"""Writes the data sets of `datasets/` and the figures in their cards, the same bytes every time.

python -m benchmarks.datasets            writes them
python -m benchmarks.datasets --check    writes nothing, exits 1 if a file would change
"""

import argparse
import hashlib
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hysteresis.rigs import SpongeRig

from ._rig_records import SHEETS, Sheet

FOLDER = Path(__file__).resolve().parent.parent / "datasets"
READING_NOISE = 0.05  # mm; with 0.15 the largest gap of the paper would move to another force
RATE = 1 / 3  # N/s, of all four tests: 2 N every 6 s

MINOR_LOOPS: tuple[tuple[float, ...], ...] = (
    (0, 20, 0),  # major loop, virgin
    (0, 20, 0),  # major loop, conditioned
    *((0, peak, 0) for peak in (4, 8, 12, 16)),  # reversals from the rising branch
    (0, 20, 16, 20, 12, 20, 8, 20, 4, 20, 0),  # reversals from the falling branch
    (0, 12, 4, 10, 6, 8, 6, 10, 4, 12, 0),  # loops within loops
    (0, 12, 6, 20, 6, 12, 0),  # one pair of limits, reached from below and from above
)
"""Turning points of the force, N, loop by loop."""


class Table(NamedTuple):
    """A data set: its columns and what its card says in figures."""

    rig: SpongeRig
    time: np.ndarray
    force: np.ndarray
    displacement: np.ndarray
    label: np.ndarray
    label_name: str
    figures: dict[str, str]

    @property
    def rows(self) -> int:
        """How many."""
        return self.force.size

    def csv(self) -> str:
        """The file's text: UTF-8, comma, decimal point, line feed."""
        header = f"time (s),force (N),displacement (mm),{self.label_name}\n"
        columns = zip(self.time, self.force, self.displacement, self.label, strict=True)
        # Adding 0.0 turns -0.0 into 0.0, which a gauge would show.
        return header + "".join(
            f"{t:.1f},{F:.3f},{round(float(d), 3) + 0.0:.3f},{n}\n" for t, F, d, n in columns
        )


def cycles(thickness_mm: float, seed: int) -> Table:
    """The paper's five cycles on a block of the given thickness."""
    rig = SpongeRig(thickness_mm=thickness_mm)
    record = rig.five_cycles(noise=READING_NOISE, seed=seed)
    record = record._replace(displacement=np.round(record.displacement, 3))
    of = record.statistics()
    figures = {
        "seed of the noise": str(seed),
        "mean gap, 2 to 18 N": f"{of.mean_gap:.3f} mm",
        "largest gap": f"{of.largest_gap:.3f} mm at {of.largest_gap_force:g} N "
        f"in cycle {of.largest_gap_cycle}",
        **{
            f"line, {name}": f"K = {line.K:.4f} mm/N, b = {line.b:.3f} mm"
            for name, line in (
                ("loading", of.loading),
                ("both branches", of.both),
                ("unloading", of.unloading),
            )
        },
        "work lost, cycles 1 to 5": ", ".join(f"{100 * loss:.1f} %" for loss in of.loss),
    }
    return Table(rig, *record, "cycle", figures)


def minor_loops(thickness_mm: float, seed: int) -> Table:
    """`MINOR_LOOPS` in steps of 0.5 N; the sample between two loops ends the earlier one."""
    force, loop = [0.0], [1]
    for n, turns in enumerate(MINOR_LOOPS, start=1):
        for start, end in pairwise(turns):
            ramp = np.linspace(start, end, round(abs(end - start) / 0.5) + 1)[1:]
            force += ramp.tolist()
            loop += [n] * ramp.size
    rig = SpongeRig(thickness_mm=thickness_mm)
    dt = 0.5 / RATE
    displacement = rig.follow(force, dt=dt)
    displacement += np.random.default_rng(seed).normal(0.0, READING_NOISE, displacement.size)
    figures = {
        "seed of the noise": str(seed),
        "loops": str(len(MINOR_LOOPS)),
        "reversals": str(int(np.sum(np.diff(np.sign(np.diff(force))) != 0))),
        "largest displacement": f"{np.max(displacement):.3f} mm",
    }
    return Table(
        rig,
        dt * np.arange(len(force)),
        np.array(force),
        displacement,
        np.array(loop),
        "loop",
        figures,
    )


TABLES: dict[str, Callable[[], Table | Sheet]] = {
    "sponge-50mm-cycles": lambda: cycles(50.0, seed=50),
    "sponge-30mm-cycles": lambda: cycles(30.0, seed=30),
    "sponge-10mm-cycles": lambda: cycles(10.0, seed=10),
    "sponge-50mm-minor-loops": lambda: minor_loops(50.0, seed=51),
    **SHEETS,
}
"""Data set by file stem."""

BEGIN, END = "<!-- figures: python -m benchmarks.datasets -->\n", "<!-- end of figures -->\n"


def figures(table: Table | Sheet, csv: str) -> str:
    """The part of a card that is computed: rows, checksum, statistics, rig."""
    rows = {
        "rows": str(table.rows),
        "SHA-256": f"`{hashlib.sha256(csv.encode()).hexdigest()}`",
        **table.figures,
    }
    rig = {field.name: getattr(table.rig, field.name) for field in fields(table.rig)}
    return "\n".join(
        [
            "| figure | value |",
            "|---|---|",
            *(f"| {name} | {value} |" for name, value in rows.items()),
            "",
            "| rig parameter | value |",
            "|---|---|",
            *(f"| `{name}` | {value} |" for name, value in rig.items()),
            "",
        ]
    )


def made(folder: Path = FOLDER) -> Iterator[tuple[Path, str]]:
    """Every file this module answers for, with the text it should hold."""
    for stem, table in TABLES.items():
        built = table()
        csv = built.csv()
        yield folder / f"{stem}.csv", csv
        card = folder / f"{stem}.md"
        before, _, rest = card.read_text(encoding="utf-8").partition(BEGIN)
        _, _, after = rest.partition(END)
        yield card, before + BEGIN + figures(built, csv) + END + after


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.datasets", description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing, report differences")
    check = parser.parse_args(arguments).check
    changed = 0
    for path, text in made():
        if path.is_file() and path.read_bytes() == text.encode():
            continue
        changed += 1
        if check:
            print(f"differs: datasets/{path.name}", file=sys.stderr)
        else:
            path.write_bytes(text.encode())
            print(f"wrote datasets/{path.name}", file=sys.stderr)
    return 1 if check and changed else 0


if __name__ == "__main__":
    sys.exit(main())
