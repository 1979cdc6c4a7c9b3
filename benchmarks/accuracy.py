"""Held-out error of `hysid fit --model auto` on measured data by third parties.

python -m benchmarks.accuracy [--quick] [--json]

The data are not in the repository: they lie in the folder that HYSID_DATA names, or beside the
checkout in ../shared/data. Every figure comes from the same code as the command line.
"""

import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax

from hysid._jobs import fit
from hysid._selection import Selection

from ._measure import Row, judged, noted, options, report


class Task(NamedTuple):
    """A file, what is held out of it, and the bar for the held-out NRMSE (per cent).

    `span`: the error is taken in per cent of this instead of the output's range.
    """

    what: str
    file: str
    selection: Selection
    bar: float
    initial: str = "auto"
    span: float | None = None


TASKS = (
    Task(
        "foam, compression -> force",
        "foam-midsole-compression/tidy.csv",
        Selection("compression_mm", "force_N", "time_s", each="sample", test_cycles=3),
        2.9,
    ),
    Task(
        "eGaIn, voltage -> force",
        "egain-microfluidic-pressure/tidy.csv",
        Selection(
            "voltage", "force_pos", dt=0.05, each="x_location", group=("split", "trial"),
            test_where=("split=test",),
        ),
        7.5,
    ),
    Task(
        "VHB, displacement -> force",
        "vhb4910-tape-tension/tidy_loading_unloading.csv",
        Selection(
            "displacement_mm", "force_N", "time_s", group=("test",),
            test_where=("test=0d01_2d5,0d05_2d0,0d05_2d5_1",),
        ),
        7.5,
    ),
    Task(
        "FORC, field -> moment, even curves",
        "forc-magnetic/tidy_feco_nanowires.csv",
        Selection("field_Oe", "moment_emu", group=("curve",), test_where=("curve%2=0",)),
        0.7,
        initial="positive",
    ),
    Task(
        "quadrupole, runs 4 to 6, of the loop's opening",
        "slac-quadrupole-minor-loops/tidy.csv",
        Selection(
            "current_A", "integrated_gradient_T", group=("run",), where=("run=3,4,5,6",),
            test_where=("run=4,5,6",),
        ),
        11.0,
        span=0.038,
    ),
)  # fmt: skip


def data_folder() -> Path:
    """Where the measurements are, if they are."""
    named = os.environ.get("HYSID_DATA")
    return Path(named) if named else Path(__file__).resolve().parents[2] / "shared" / "data"


def row(task: Task, folder: Path) -> Row:
    """Fit one task and judge its held-out error; the model chosen stands in the name."""
    file = folder / task.file
    if not file.is_file():
        return noted(task.what, float("nan"), reason="the data are not here")
    with tempfile.TemporaryDirectory() as out:
        document: dict[str, Any] = fit(
            file, task.selection, Path(out) / "fit", initial=task.initial, model="auto"
        )
    test = document["metrics"]["test"]
    value = test["nrmse_percent"] if task.span is None else 100 * test["rmse"] / task.span
    return judged(f"{task.what} ({document['model']})", value, task.bar)


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit every data set and print the table."""
    chosen = options("benchmarks.accuracy", __doc__, arguments)
    jax.config.update("jax_enable_x64", True)
    report([row(task, data_folder()) for task in TASKS], chosen.json)


if __name__ == "__main__":
    main(sys.argv[1:])
