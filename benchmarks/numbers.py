"""The numbers that a rig is asked for: of loops, beside closed forms and another program, and of spectra.

python -m benchmarks.numbers [--quick] [--json] [--only TEXT]

`closed forms`: loops of a dashpot and a spring, of friction, of Rayleigh's law and of Bouc and Wen, whose
energy, width and damping have equations; the largest relative difference.

`intervals`: noisy loops that begin between two rows, of two kinds and three samplings, and with noise that
keeps 0.9 from row to row; how often the 90 % intervals hold the truth, for the figure that has it least
often and the one that has it most often.

`steep`: the same of loops over a field, of two slopes, whose rows are even or ten times as dense where they
are steep.

`time`: processor seconds for the table of a million rows in 2,000 loops.

`pmagpy`: loops of a magnetometer in ../shared/data (HYSID_DATA names another folder), beside what PmagPy
says of the same rows. PMAGPY names the Python that has it; without both these rows are left open.

`micromag`: what a magnetometer wrote into its files of rows that it corrected itself, beside our numbers of
these rows; HYSTLAB names the folder Example_Data of HystLab, whose files they are.

`spectra`: public master curves, shift factors, a ramp and hold, creep beside lmfit, and material cards.
"""

import json
import os
import re
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from hysteresis import Record, read_csv
from hysteresis.records._loop_table import LoopTable

from . import _spectra
from ._measure import Row, judged, noted, run_parts
from .accuracy import data_folder

NORMAL_90 = 1.6449
FIGURES = (
    "energy lost", "energy in", "width at mid-range", "largest width", "loop width", "closure", "stiffness",
    "secant stiffness, loading", "tangent stiffness, loading", "damping ratio", "highest input",
    "highest output", "output at lowest input",
)  # fmt: skip
"""Figures whose intervals are judged."""

_PMAGPY = """
import json, sys, warnings
import numpy as np
from pmagpy import rockmag
warnings.simplefilter("ignore")
found = {}
for name, (field, moment) in json.load(sys.stdin).items():
    field, moment = np.array(field) / 1e4, np.array(moment)
    grid = rockmag.grid_hyst_loop(field, moment)
    found[name] = {
        "coercive field": 1e4 * float(rockmag.calc_Bc(field, moment)),
        "remanence": float(rockmag.calc_Mr_Mrh_Mih_Brh(*grid)[1]),
        "saturation": float(rockmag.linear_HF_fit(field, moment, 0.7)[1]),
    }
print(json.dumps(found))
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the parts, and print."""
    parts = {
        "closed forms": _closed_forms,
        "intervals": _intervals,
        "steep": _steep,
        "time": _time,
        "pmagpy": _pmagpy,
        "micromag": _micromag,
        "spectra": _spectra.rows,
    }
    run_parts("benchmarks.numbers", __doc__, parts, arguments)


def _table(u: np.ndarray, y: np.ndarray) -> LoopTable:
    return Record.from_arrays(u, y, input_unit="mm", output_unit="N").loops()


def _closed_forms(quick: bool) -> list[Row]:
    rows = 20_000
    angle = 2 * np.pi * np.arange(2 * rows + 1) / rows - np.pi / 2
    ramp = np.interp(np.arange(4 * rows + 1) / rows, range(5), [-1, 1, -1, 1, -1])
    rises = np.diff(ramp, append=ramp[-2]) > 0
    stop = [-0.5]
    for step in np.diff(ramp).tolist():
        stop.append(min(max(stop[-1] + 4 * step, -0.5), 0.5))
    top, rising = _bouc_wen(2.0, 2 * ramp[: rows + 1])
    bouc_wen = np.concatenate([rising, -rising[1:], rising[1:], -rising[1:]])
    lost = 2 * (4 - 2 * top - top**2 / 2)
    cases = {
        "viscous": (_table(2 * np.sin(angle), 6 * np.sin(angle) + 1.4 * np.cos(angle)), {
            "energy lost": 2.8 * np.pi, "width at mid-range": -2.8, "damping ratio": 0.7 / 6,
        }),
        "friction": (_table(ramp, 2 * ramp + np.array(stop)), {
            "energy lost": 1.75, "width at mid-range": -1.0, "damping ratio": 2 * 1.75 / (np.pi * 2 * 5),
        }),
        "Rayleigh": (_table(ramp, 1.6 * ramp + np.where(rises, 0.3, -0.3) * (1 - ramp**2)), {
            "energy lost": 0.8, "width at mid-range": -0.6, "damping ratio": 1.6 / (np.pi * 2 * 3.2),
        }),
        "Bouc-Wen": (_table(2 * ramp, bouc_wen), {
            "energy lost": lost, "width at mid-range": -2 * rising[rows // 2],
            "damping ratio": lost / (np.pi * 4 * top),
        }),
    }  # fmt: skip
    found = []
    for name, (table, truth) in cases.items():
        off = [abs(table[figure].value[-1] / value - 1) for figure, value in truth.items()]
        found.append(judged(f"{name} loop: {', '.join(truth)}", max(off), 1e-6))
    return found


def _bouc_wen(size: float, x: np.ndarray) -> tuple[float, np.ndarray]:
    """The settled z(x) of z' = x' (1 - |z| (1 + sign(x' z)) / 2) on the way up, and its end.

    It is a line below z = 0 and 1 - exp(-s) above.
    """
    top = 0.5
    for _ in range(100):
        top = 1 - np.exp(-(2 * size - top))
    over = x + size - top
    return top, np.where(over < 0, over, 1 - np.exp(-np.maximum(over, 0)))


def _intervals(quick: bool) -> list[Row]:
    loops, rows = 34 if quick else 167, (100.37, 300.37, 1000.37)
    found = _of_noise("noisy loops", 0.0, rows, loops, quick)
    return found + _of_noise("loops with lasting noise", 0.9, (600.37, 6000.37), loops, quick)


def _of_noise(
    what: str, keeps: float, samplings: Sequence[float], loops: int, quick: bool
) -> list[Row]:
    """Of loops of two kinds with noise that keeps this part from row to row."""
    random, shares = np.random.default_rng(5), []
    for maker in (_viscous, _settled_bouc_wen):
        truth = _table(*maker(2 * np.pi * np.arange(40_001) / 20_000 - np.pi / 2))
        for rows in samplings:
            angle = 2 * np.pi * np.arange(int((loops + 2) * rows)) / rows + 1.7
            x, y = maker(angle)
            noise = random.normal(size=(2, len(x)))
            noise = scipy.signal.lfilter([np.sqrt(1 - keeps**2)], [1, -keeps], noise)
            table = _table(x + 0.002 * noise[0], y + 0.02 * noise[1])
            within = slice(1, loops + 1)
            shares.append([
                np.mean(
                    np.abs(table[name].value[within] - truth[name].value[-1])
                    <= NORMAL_90 * table[name].error[within]
                )
                for name in FIGURES
            ])  # fmt: skip
    by_figure = dict(zip(FIGURES, np.mean(shares, axis=0), strict=True))
    return _least_and_most(f"{len(shares) * loops} {what}", by_figure, quick)


def _least_and_most(what: str, shares: Mapping[Any, float], quick: bool) -> list[Row]:
    """The figures whose intervals hold the truth least and most often."""
    ends = sorted(shares, key=shares.__getitem__)
    found = []
    for name, bar, low in ((ends[0], 86.0, True), (ends[-1], 94.0, False)):
        row, share = f"{what}: 90 % intervals hold the truth, %, {name}", 100 * float(shares[name])
        if quick:
            found.append(noted(row, share, reason="200 loops do not tell it to 2 %"))
        else:
            found.append(judged(row, share, bar, at_least=low))
    return found


def _steep(quick: bool) -> list[Row]:
    """A field that begins and ends at its largest value, and a moment that is a tangens hyperbolicus."""
    number, held = 33 if quick else 167, []
    for steep in (3, 30):
        truth = {
            "highest input": 1, "lowest input": -1,
            "coercive field": 0.6 / steep, "remanence": np.tanh(0.6),
            "width at mid-range": 2 * np.tanh(0.6), "largest width": 2 * np.tanh(0.6),
        }  # fmt: skip
        for dense in (1.0, 0.3, 0.1):
            fall = np.linspace(1, -1, 801)
            fall = fall[(np.abs(fall) < dense) | (np.arange(801) % 10 == 0)]
            field = np.concatenate([fall, fall[-2::-1]])
            way = np.where(np.arange(len(field)) <= field.argmin(), -1, 1)
            moment = np.tanh(steep * field - 0.6 * way)
            for seed in range(number):
                noise = np.random.default_rng(seed).normal(size=(2, len(field)))
                table = Record.from_arrays(
                    field + 1e-4 * noise[0],
                    moment + 1e-3 * noise[1],
                    input_unit="T",
                    output_unit="A*m²",
                ).loops()
                held.append([
                    abs(table[name].value[-1] - value) <= NORMAL_90 * table[name].error[-1]
                    for name, value in truth.items()
                ])  # fmt: skip
    by_figure = dict(zip(truth, np.mean(held, axis=0), strict=True))
    return _least_and_most(f"{len(held)} loops over a field", by_figure, quick)


def _viscous(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return 2 * np.sin(angle), 6 * np.sin(angle) + 1.4 * np.cos(angle)


def _settled_bouc_wen(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x = 2 * np.sin(angle)
    way = np.where(np.cos(angle) >= 0, 1.0, -1.0)
    return x, 2 * x + 3 * way * _bouc_wen(2.0, way * x)[1]


def _time(quick: bool) -> list[Row]:
    rows = 1_000_000
    angle = np.linspace(0, 2 * np.pi * 2000, rows)
    x, y = _viscous(angle)
    noise = np.random.default_rng(0).normal(size=(2, rows))
    record = Record.from_arrays(
        x + 0.004 * noise[0], y + 0.02 * noise[1], angle, input_unit="mm", output_unit="N"
    )
    begin = time.process_time()
    table = record.loops()
    taken = time.process_time() - begin
    return [judged(f"a million rows, {len(table)} loops: processor seconds", taken, 2.0)]


def _pmagpy(quick: bool) -> list[Row]:
    what = "PmagPy on the same loops: coercive field, remanence, saturation, largest difference, %"
    file = data_folder() / "magnetometer-loops" / "tidy.csv"
    python = os.environ.get("PMAGPY", "")
    if not python or not file.exists():
        missing = (
            "PMAGPY names no Python that has pmagpy" if file.exists() else "the data are not here"
        )
        return [Row(what, float("nan"), 1.0, reason=missing)]
    names = ("mvsh1_2K", "mvsh1_6K", "mvsh1_8K", "mvsh11_5K")  # of 1,000 rows and more, with a loop
    record = read_csv(
        file, input="field (Oe)", output="moment (emu)", group="loop", where={"loop": names}
    )
    table = record.loops()
    rows = {}
    for label, where in record.sequences():
        k = int(np.flatnonzero(table.run == label)[0])
        own = slice(*np.searchsorted(record.line[where], [table.first[k], table.last[k] + 1]))
        rows[label] = record.input[where][own].tolist(), record.output[where][own].tolist()
    done = subprocess.run(
        [python, "-c", _PMAGPY], input=json.dumps(rows), capture_output=True, text=True, check=True
    )
    theirs = json.loads(done.stdout)
    return [
        _beside(f"{what} ({label}", table, k, theirs[label]) for k, label in enumerate(table.run)
    ]


def _micromag(quick: bool) -> list[Row]:
    what = "MicroMag's own numbers: coercive field, remanence, largest difference, %"
    files = sorted(Path(os.environ.get("HYSTLAB", "")).glob("*/*.hys"))
    if not os.environ.get("HYSTLAB") or not files:
        return [Row(what, float("nan"), 1.0, reason="HYSTLAB names no folder of its files")]
    found = []
    for file in files:
        text = file.read_text("latin-1")
        told = dict(re.findall(r"^(Remanence|Coercivity) +([-+.E\d]+)", text, re.MULTILINE))
        rows = [line.split(",")[-2:] for line in text.splitlines() if re.match(r"[-+].*,.*,", line)]
        if told and rows:
            field, moment = np.array(rows, float).T  # the last two columns are corrected
            table = Record.from_arrays(field, moment, input_unit="T", output_unit="A*m²").loops()
            theirs = {"coercive field": told["Coercivity"], "remanence": told["Remanence"]}
            numbers = {name: float(value) for name, value in theirs.items()}
            found.append(_beside(f"{what} ({file.stem}", table, 0, numbers))
    return found


def _beside(what: str, table: LoopTable, k: int, theirs: dict[str, float]) -> Row:
    """The figure of a loop that is farthest from another program's."""
    off = {name: abs(table[name].value[k] / value - 1) for name, value in theirs.items()}
    worst = max(off, key=off.__getitem__)
    error = 100 * table[worst].error[k] / table[worst].value[k]
    row, told = f"{what}: {worst})", 100 * off[worst]
    if error < 0.5:  # else the noise of the readings leaves more open than the bar
        return judged(row, told, 1.0)
    return noted(row, told, reason=f"the noise leaves {error:.2g} % open")


if __name__ == "__main__":
    main()
