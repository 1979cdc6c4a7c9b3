"""The Fine Steering Mirror: hysteresis inside many resonances, three inputs, three outputs, three levels.

python -m benchmarks.mirror [--train FOLDER] [--drive FOLDER --out FOLDER] [--groups N] [--leave_out LEVEL]
[--quick]

An official benchmark (nonlinearbenchmark.org; Floren et al., ISMA 2024; data:
github.com/merijnfloren/fsm-benchmark-data, CC BY 4.0): u_{level}_train.npy and y_{level}_train.npy of
(samples, channels, realisations, periods), one period at 6,400 Hz, in steady state. A model is fitted to
the training files alone; the figures are its errors on a realisation of each level that is held out, and
which has chosen modes and groups: rms of the error of the mean period over that of the output, mean over
outputs.

With `--drive` and `--out` the final model, which has seen the held-out realisations too, is driven by every
u_*_test.npy of a folder, and y_*_test.npy is written for each. `--leave_out 200mV` fits without that level
and judges on it. `--groups`: most groups of three channels. `--quick` takes two groups.
"""

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import jax
import numpy as np

import identify
from identify.dynamics._feedback_fit import FeedbackFit
from identify.internal import PeriodicTest

from ._measure import Row, judged, noted, options, report

RATE = 6400.0
FOLDER = Path(__file__).parents[2] / "shared" / "mirror"
LEVELS = ("100mV", "200mV", "300mV")
BARS = {"100mV": 3.3, "200mV": 2.9, "300mV": 2.9}
SECONDS, LEFT_OUT = 900.0, 4.6


def tests_of(folder: Path, level: str) -> list[PeriodicTest]:
    """A test for each realisation."""
    u, y = (np.load(folder / f"{x}_{level}_train.npy") for x in "uy")
    return [
        PeriodicTest(u[:, :, r].mean(2), y[:, :, r].transpose(2, 0, 1), 1 / RATE)
        for r in range(u.shape[2])
    ]


def error(fit: FeedbackFit, tests: list[PeriodicTest]) -> float:
    """In per cent of the output's root mean square."""
    each = []
    for test in tests:
        left = test.y - fit.model.steady(test.u, test.dt)
        each.append(np.sqrt((left**2).mean(1) / (test.y**2).mean(1)))
    return 100 * float(np.mean(each))


def main(arguments: Sequence[str] | None = None) -> None:
    given = options(
        "benchmarks.mirror", __doc__, arguments, train="folder of u_*_train.npy and y_*_train.npy",
        drive="folder of u_*_test.npy", out="folder for y_*_test.npy", groups="most groups of channels",
        leave_out="a level that no test of the fit has, such as 200mV",
    )  # fmt: skip
    if given.leave_out not in (None, *LEVELS) or (given.drive is None) != (given.out is None):
        sys.exit(f"--leave_out takes one of {', '.join(LEVELS)}; --drive and --out go together.")
    jax.config.update("jax_enable_x64", True)
    folder = Path(given.train) if given.train else FOLDER
    levels = [level for level in LEVELS if level != given.leave_out]
    begin = time.perf_counter()
    fit = identify.fit_feedback(
        [test for level in levels for test in tests_of(folder, level)],
        groups=int(given.groups or (2 if given.quick else 4)),
        say=lambda line: print(line, file=sys.stderr, flush=True),
    )
    rows: list[Row] = []
    for level, found, before in zip(levels, fit.errors, fit.linear_errors, strict=True):
        what = f"{level}, a realisation held out (%)"
        whole = given.leave_out is None  # the bars are those of a fit to all levels
        rows.append(judged(what, 100 * found, BARS[level]) if whole else noted(what, 100 * found))
        rows.append(noted(f"{level}, modes without channels (%)", 100 * before))
    rows.append(judged("processor time (s)", fit.seconds, SECONDS))
    rows.append(noted("time on the clock (s)", time.perf_counter() - begin))
    rows.append(noted("channels", len(fit.model.channels)))
    if given.leave_out:
        off = error(fit, tests_of(folder, given.leave_out))
        rows.append(judged(f"{given.leave_out}, a level without a test (%)", off, LEFT_OUT))
    if given.drive:
        drive(fit, Path(given.drive), Path(given.out))
    report(rows, given.json)


def drive(fit: FeedbackFit, inputs: Path, outputs: Path) -> None:
    """Write the outputs of every test file."""
    outputs.mkdir(parents=True, exist_ok=True)
    for file in sorted(inputs.glob("u_*_test.npy")):
        u = np.load(file)
        each = [fit.model.steady(u[:, :, r].mean(2), 1 / RATE) for r in range(u.shape[2])]
        y = np.stack(each, 2)[..., None].repeat(u.shape[3], 3)
        np.save(outputs / f"y{file.name[1:]}", y)


if __name__ == "__main__":
    main()
