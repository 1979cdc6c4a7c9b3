"""Held-out error of `hysid fit --model auto` on measured data by third parties.

python -m benchmarks.accuracy [--quick] [--json] [--only TEXT] [--freeze]

Each row is said on stderr as soon as it is known, because all of them take 45 minutes of processor time.
At the end stand the verdicts beside what the fits are worth: of each level the range of the errors, and how
many fits a baseline beats on the test rows beyond the standard error of the difference. Virtual rigs under
other motions follow, with verdicts of their own.

Beside ours stands the error of a recurrent network trained on the same rows (`_accuracy/network.py`),
which `--freeze` trains anew, a minute a row, instead of fitting.

The data are not in the repository: they lie in the folder that HYSID_DATA names, or beside the
checkout in ../shared/data. Every figure comes from the same code as the command line.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

import identify
from hysid.commands._asked import Fit
from hysid.intake._folders import folders_of
from hysid.intake._selection import Selection
from hysteresis import InputError, Record

from . import _measured_data as data
from . import _other_rigs
from ._accuracy import creep, known, lags, motions, network, specimens, two_inputs
from ._accuracy.verdicts import Judged, calibration, is_beaten
from ._measure import Row, judged, noted, options, report, said

Prepare = Callable[[Path, Path], Path]


class Task(NamedTuple):
    """A file, what is held out of it, and the bar for the held-out NRMSE (per cent).

    - `file`: in the data folder, or what makes one from that folder and an empty one.
    - `span`: the error is taken in per cent of this instead of the output's range.
    - `part`: `"train"` where nothing is held out.
    - `references`: the same error of a line, a quintic and the best black box, or ridge regression.
    """

    what: str
    file: str | Prepare
    selection: Selection
    bar: float
    references: tuple[float, float, float]
    initial: str = "auto"
    span: float | None = None
    part: str = "test"


BAND = identify.LEVELS.index(0.9)
LEAST_HELD, MOST_HELD = 80.0, 97.0
"""Per cent of held-out rows that 90 % bands may hold."""

CREEP = "creep and relaxation"
"""What `--only` has to be part of for those rows."""
FOAM = "foam-midsole-compression/tidy.csv"
EGAIN = "egain-microfluidic-pressure/tidy.csv"
EGAIN_SPLIT = {"dt": 0.05, "each": "x_location", "group": ("split", "trial")}
VHB_TEST = ("test=0d01_2d5,0d05_2d0,0d05_2d5_1",)
EFLESH_TEST = ("run=normal_015037",)
DAMPER_TEST = "run=a_30lb_0.25Hz_1in,a_30lb_0.5Hz_1in,a_30lb_1Hz_1in"
SEAL_RUNS = "run=" + ",".join(f"Circle_{bar}bar" for bar in (1, 2, 3, 4, 6, 7))
SLEEVE_STRIPS = tuple(f"resistance {k} (-)" for k in range(1, 6))
SLEEVE_SESSIONS = "session=S1_2_squat,S3_4_squat,S5_6_squat,S7_8_squat,S9_10_squat"
SKIN_CHANNELS = tuple(f"channel {k} (V)" for k in range(16))
EFLESH_CHANNELS = tuple(f"s{k:02d}" for k in range(15))

TASKS = (
    Task(
        "foam, compression -> force", FOAM,
        Selection("compression_mm", "force_N", "time_s", each="sample", test_cycles=3),
        0.6, (8.5, 3.9, 0.47),
    ),
    Task(
        "foam, force -> compression", FOAM,
        Selection("force_N", "compression_mm", "time_s", each="sample", test_cycles=3),
        0.7, (9.5, 5.0, 0.44),
    ),
    Task(
        "foam, strain -> stress, another specimen", data.foam_stress,
        Selection("strain", "stress (kPa)", "time (s)", group=("sample",),
                  test_where=("sample=turbo-comp-3",)),
        2.5, (8.6, 5.2, 2.5),
    ),
    Task(
        "foam, the slow ramp and hold after the cycles", data.foam_hold,
        Selection("compression (mm)", "force (N)", "time (s)", each="sample",
                  test_where=("part=hold",)),
        2.0, (8.1, 4.7, 2.5),
    ),
    Task(
        "eGaIn, force -> voltage", EGAIN,
        Selection("force_pos", "voltage", **EGAIN_SPLIT, test_where=("split=test",)),
        3.0, (15.0, 15.7, 2.86),
    ),
    Task(
        "eGaIn, voltage -> force", EGAIN,
        Selection("voltage", "force_pos", **EGAIN_SPLIT, test_where=("split=test",)),
        3.0, (13.1, 11.5, 2.79),
    ),
    Task(
        "eFlesh, main channel -> load", data.eflesh,
        Selection("main", "load", "time (s)", group=("run",), nan="omit", test_where=EFLESH_TEST),
        1.3, (2.5, 2.2, 1.8),
    ),
    Task(
        "eFlesh, all channels -> load", "eflesh-magnetic-tactile/tidy_normal.csv",
        Selection(EFLESH_CHANNELS, "load_reading", "time_s", group=("run",), nan="omit",
                  test_where=EFLESH_TEST),
        0.9, (2.3, 1.3, 1.2),
    ),
    Task(
        "eFlesh, depth -> load", data.eflesh,
        Selection("depth (mm)", "load", "time (s)", group=("run",), nan="omit",
                  test_where=EFLESH_TEST),
        1.3, (8.4, 4.3, 2.0),
    ),
    Task(
        "eFlesh, load -> depth", data.eflesh_loads,
        Selection("load", "depth (mm)", "time (s)", group=("run",), test_where=EFLESH_TEST),
        2.1, (8.2, 5.0, 2.2),
    ),
    Task(
        "VHB, displacement -> force", "vhb4910-tape-tension/tidy_loading_unloading.csv",
        Selection("displacement_mm", "force_N", "time_s", group=("test",), test_where=VHB_TEST),
        1.0, (19.0, 18.0, 2.0),
    ),
    Task(
        "VHB, force -> displacement, slack left out", data.vhb_taut,
        Selection("force (N)", "displacement (mm)", "time (s)", group=("test",), nan="omit",
                  test_where=VHB_TEST),
        1.3, (17.0, 18.0, 1.8),
    ),
    Task(
        "FORC, field -> moment, even curves", "forc-magnetic/tidy_feco_nanowires.csv",
        Selection("field_Oe", "moment_emu", group=("curve",), test_where=("curve%2=0",)),
        0.08, (22.0, 15.0, 0.6), initial="positive",
    ),
    Task(
        "quadrupole, runs 4 to 6, of the loop's opening", "slac-quadrupole-minor-loops/tidy.csv",
        Selection("current_A", "integrated_gradient_T", group=("run",), where=("run=3,4,5,6",),
                  test_where=("run=4,5,6",)),
        8.0, (27.0, 31.0, 19.0), span=0.038,
    ),
    Task(
        "cryogel, in-sample", "cryogel-sponge-compression/tidy_50Hz.csv",
        Selection("displacement_mm", "force_N", "time_s", group=("sample",)),
        0.2, (10.5, 2.2, 0.07), part="train",
    ),
    Task(
        "piezo manipulator, voltage -> position", "piezo-manipulator/tidy.csv",
        Selection("command (V)", "position (um)", "time (s)", test_tail=0.3),
        0.19, (7.43, 7.41, 0.24),
    ),
    Task(
        "soft block, displacement -> force", "foam-instron-cyclic/tidy.csv",
        Selection("displacement (mm)", "force (N)", "time (s)", test_tail=0.3),
        0.77, (6.81, 5.35, 0.96),
    ),
    Task(
        "friction damper, an amplitude between", "friction-damper/tidy.csv",
        Selection("displacement (mm)", "force (kN)", "time (s)", group=("run",),
                  where=("band tension (lbf)=30",), test_where=(DAMPER_TEST,)),
        3.96, (27.79, 28.71, 4.95),
    ),
    Task(
        "ferrite, flux density -> field", "magnet-3c90/tidy.csv",
        Selection("B (T)", "H (A/m)", "t (s)", group=("sequence",),
                  test_where=("sequence%5=0",)),
        2.35, (3.87, 2.94, 3.09),
    ),
    Task(
        "pneumatic seal, a pressure between", "pneumatic-friction/tidy.csv",
        Selection(("position (mm)", "nominal pressure (bar)"), "force (N)", "time (s)",
                  group=("run",), where=(SEAL_RUNS,), test_where=("run=Circle_3bar",)),
        8.68, (41.69, 41.86, 10.85),
    ),
    Task(
        "molecular magnet, a temperature between", "magnetometer-loops/tidy.csv",
        Selection(("field (Oe)", "temperature (K)"), "moment (emu)", group=("loop",),
                  where=("loop=mvsh1_2K,mvsh1_6K,mvsh1_8K,mvsh1_12K",),
                  test_where=("loop=mvsh1_6K",)),
        3.42, (14.19, 4.28, 8.52),
    ),
    Task(
        "knitted sleeve, five strips -> angle, another session", "knit-sleeve/tidy.csv",
        Selection(SLEEVE_STRIPS, "angle (deg)", "time (s)", group=("session",),
                  where=(SLEEVE_SESSIONS,), test_where=("session=S9_10_squat",)),
        8.04, (11.3, 10.05, 12.99),
    ),
    Task(
        "hydrogel skin, sixteen channels -> load, the last 30 per cent", "hydrogel-skin/tidy.csv",
        Selection(SKIN_CHANNELS, "load cells (V)", "time (s)", test_tail=0.3),
        8.5, (19.04, 30.24, 8.86),
    ),
    Task(
        "laminate, force -> displacement, later cycles", "gfrp-fatigue-loops/tidy.csv",
        Selection("force (kN)", "displacement (mm)", dt=1.0, each="specimen", test_tail=0.5),
        7.63, (69.3, 76.42, 9.54),
    ),
    Task(
        "steel coupon, the last cycles", "structural-cyclic/RESSPyLab_example_1.csv",
        Selection("e_true", "Sigma_true", test_tail=0.3),
        3.5, (66.0, 66.0, 9.7),
    ),
)  # fmt: skip


def data_folder() -> Path:
    """Where the measurements are, if they are."""
    named = os.environ.get("HYSID_DATA")
    return Path(named) if named else Path(__file__).resolve().parents[2] / "shared" / "data"


class Fitted(NamedTuple):
    """What came of a task: its row, the verdicts of its fits, several where each value has its own, and
    what share of their held-out rows 90 % bands hold, the mean over fits."""

    row: Row
    verdicts: tuple[Judged, ...] = ()
    held: float | None = None


def _held(task: Task, document: dict[str, Any], folder: Path) -> float | None:
    if task.part != "test":
        return None
    fits = (identify.load(folder / one) for one in folders_of(folder, document).values())
    try:
        return 100 * float(np.mean([identify.predictive(fit).coverage[BAND] for fit in fits]))
    except InputError as error:
        if error.code != "no-posterior":
            raise
        return None


def _verdicts(task: Task, document: dict[str, Any]) -> tuple[Judged, ...]:
    if task.part != "test":
        return ()
    found = []
    for value, one in document.get("each", {"": document}).items():
        test, best = one["metrics"]["test"], min(one["baselines"], key=lambda x: x["nrmse_percent"])
        span = test["rmse"] / test["nrmse_percent"] if task.span is None else task.span / 100
        theirs = [np.array(x["test_blocks"]) for x in one["baselines"]]
        beaten = is_beaten(np.array(one["test_blocks"]), theirs)
        what = f"{task.what}, {value}" if value else task.what
        ours, other = test["rmse"] / span, best["rmse"] / span
        found.append(Judged(what, one["verdict"]["level"], ours, best["name"], other, beaten))
    return tuple(found)


def _file(task: Task, folder: Path, out: str) -> Path:
    """The file of a task, made in `out` where it is not there as it is."""
    return folder / task.file if isinstance(task.file, str) else task.file(folder, Path(out))


def frozen(task: Task, folder: Path) -> Row:
    """Train the networks on a task's rows, and keep their error."""

    def error(record: Record, predicted: np.ndarray) -> float:
        found = identify.internal.metrics(record.output, predicted, record.mask)
        return found.nrmse_percent if task.span is None else 100 * found.rmse / task.span

    with tempfile.TemporaryDirectory() as out:
        file = _file(task, folder, out)
        pairs = task.selection.records(task.selection.read(file))[0].values()
    entry = network.freeze(task.what, pairs, error)
    return noted(f"{task.what} (network of {entry['parameters']} parameters)", entry["error"])


def fitted(task: Task, folder: Path) -> Fitted:
    """Fit one task and judge its error; the model chosen and what else there is stand in the name."""
    with tempfile.TemporaryDirectory() as out:
        if not (folder / task.file if isinstance(task.file, str) else folder).exists():
            missing = noted(task.what, float("nan"), reason="the data are not here")
            return Fitted(missing)
        file = _file(task, folder, out)
        begin = time.process_time()
        try:
            document: dict[str, Any] = (
                Fit(
                    file=file,
                    selection=task.selection.as_json(),
                    out=Path(out) / "fit",
                    initial=task.initial,
                )
                .run()
                .document
            )
        except InputError as error:
            refused = judged(f"{task.what} ({error.code})", float("nan"), task.bar)
            return Fitted(refused)
        seconds = time.process_time() - begin
        held = _held(task, document, Path(out) / "fit")
    test = document["metrics"][task.part]
    value = test["nrmse_percent"] if task.span is None else 100 * test["rmse"] / task.span
    line, quintic, black_box = task.references
    beside = f"{document['model']}; line {line:g}, quintic {quintic:g}, black box {black_box:g}"
    best = min(document.get("baselines", ()), key=lambda one: one["nrmse_percent"], default=None)
    if best is not None and task.span is None and task.part == "test":
        beside += f", {best['name']} {best['nrmse_percent']:.3g}"
    if (rival := network.frozen().get(task.what)) is not None:
        beside += f", network of {rival['parameters']} parameters {rival['error']:.3g}"
    beside += f"; {document['verdict']['level']}; {seconds:.0f} s of processor time"
    if held is not None:
        beside += f"; 90 % bands hold {held:.0f} %"
    row = judged(f"{task.what} ({beside})", value, task.bar)
    return Fitted(row, _verdicts(task, document), held)


def bands(held: Sequence[float]) -> list[Row]:
    """Of the sets the part whose 90 % bands hold about so much of the held-out rows."""
    inside = [LEAST_HELD <= one <= MOST_HELD for one in held]
    ends = f"{LEAST_HELD:g} to {MOST_HELD:g} %"
    what = f"sets whose 90 % bands hold {ends} of held-out rows, % of {len(held)}"
    return [judged(what, 100 * float(np.mean(inside)), 75.0, at_least=True)] if held else []


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit every data set and print the table."""
    chosen = options(
        "benchmarks.accuracy", __doc__, arguments,
        {"freeze": "train the rival networks and keep their errors"},
        only="tasks with this in their name",
    )  # fmt: skip
    jax.config.update("jax_enable_x64", True)
    tasks = [task for task in TASKS if (chosen.only or "") in task.what]
    found: list[Row] = []
    if chosen.freeze:
        found += [said(frozen(task, data_folder())) for task in tasks]
        if (chosen.only or "") in known.KNOWN:
            found.append(said(known.frozen(data_folder())))
        report(found, chosen.json)
        return
    verdicts: list[Judged] = []
    held: list[float] = []
    for task in tasks:
        one = fitted(task, data_folder())
        found.append(said(one.row))
        verdicts += one.verdicts
        held += [] if one.held is None else [one.held]
    found += map(said, bands(held))
    if (chosen.only or "") in CREEP:
        found += map(said, creep.rows(data_folder()))
    if (chosen.only or "") in specimens.LIKE:
        found += map(said, specimens.rows(data_folder()))
    if (chosen.only or "") in lags.LAGS:
        found += map(said, lags.rows())
    if (chosen.only or "") in known.KNOWN:
        found += map(said, known.rows(data_folder()))
    for what, rigs in ((_other_rigs.VIRTUAL, _other_rigs.rows), (two_inputs.TWO, two_inputs.rows)):
        for row, verdict in rigs() if (chosen.only or "") in what else ():
            found.append(said(row))
            verdicts.append(verdict)
    found += map(said, calibration(verdicts))
    if (chosen.only or "") in motions.OTHER:
        found += map(said, motions.rows())
    report(found, chosen.json)


if __name__ == "__main__":
    main(sys.argv[1:])
