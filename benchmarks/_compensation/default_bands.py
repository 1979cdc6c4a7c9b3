"""Coverage of the band that `hysid.invert(fit)` shows by default, on held-out loops.

Shipped data, each with several choices of what is held out, and virtual rigs with loops at random. The
errors of a loop are one draw, so one choice says little, and the mean of a kind is judged.
"""

from collections.abc import Callable, Iterator

import numpy as np

import hysid
from compensate import estimate
from compensate.internal import CalibratedCompensator
from hysteresis import Record
from hysteresis.internal import FoamBlock
from hysteresis.numerics._functions import NORMAL_95
from hysteresis.rigs import SpongeRig

from .._measure import Row, noted
from .._rig_records import READING_NOISE, Sheet, mixed_cycles, one_place
from ..datasets import FOLDER

LOW, HIGH = 86.0, 94.0
SEEDS, FEW = 8, 2
STEP_N, STEP_S = 0.5, 1.5

Split = tuple[Record, Record]

LOOPS = ((3,), (4,), (5,), (6,), (7,), (8,), (9,), (4, 6), (3, 5), (7, 9), (8, 9), (5, 8))
CYCLES = ((11, 12, 13), (4, 7, 10), (5, 9, 12), (3, 6, 8))
SESSIONS = ((2, 4, 6), (1, 3, 5), (1, 4, 5), (2, 3, 6))


def minor_loops(count: int) -> Iterator[Split]:
    """The shipped sponge, every choice without one or two of its loops."""
    table = np.genfromtxt(FOLDER / "sponge-50mm-minor-loops.csv", delimiter=",", skip_header=1)
    time, force, depth, loop = table.T
    for held in LOOPS if count > FEW else LOOPS[:count]:
        yield _split(force, depth, time, np.isin(loop, held))


def mixed(count: int) -> Iterator[Split]:
    """The shipped sponge whose cycles differ."""
    time, force, depth, cycle = _columns(mixed_cycles())[:4]
    for held in CYCLES[:count]:
        yield _split(force, depth, time, np.isin(cycle, held))


def skin(count: int) -> Iterator[Split]:
    """The shipped skin: half of its sessions."""
    session, _, time, force, volt = _columns(one_place())[:5]
    for held in SESSIONS[:count]:
        yield _split(force, volt, time, np.isin(session, held), session)


def random_loops(rig: FoamBlock | SpongeRig) -> Callable[[int], Iterator[Split]]:
    """Six to ten loops of one to seven turning points at random, a third of which are held out."""

    def splits(count: int) -> Iterator[Split]:
        for seed in range(count):
            random = np.random.default_rng([seed, 99])
            loops = int(random.integers(6, 11))
            force, loop = _path(random, loops)
            depth = rig.follow(force, dt=STEP_S) + random.normal(0, READING_NOISE, len(force))
            held = random.choice(np.arange(1, loops), size=max(2, loops // 3), replace=False)
            yield _split(force, depth, STEP_S * np.arange(len(force)), np.isin(loop, held))

    return splits


KINDS = {
    "shipped sponge, minor loops": minor_loops,
    "shipped sponge, cycles that differ": mixed,
    "shipped skin, sessions": skin,
    "virtual foam, loops at random": random_loops(FoamBlock()),
    "virtual sponge, loops at random": random_loops(SpongeRig()),
}


def default_rows(quick: bool) -> list[Row]:
    """Of each kind the mean coverage, its least, and the width over that which holds 90 %."""
    rows, every = [], []
    for kind, splits in KINDS.items():
        found = np.array([_judged(*split) for split in splits(FEW if quick else SEEDS)])
        every.append(found)
        mean, least = 100 * float(found[:, 0].mean()), 100 * float(found[:, 0].min())
        what = f"default 90 % band, {kind} ({len(found)}): held-out inputs in it, %"
        met = None if quick else LOW <= mean <= HIGH
        rows.append(Row(what, mean, LOW, None, met, "86 to 94", at_least=True))
        rows.append(noted("    least of them, %", least))
        rows.append(
            noted("    half width over the 90 % quantile of errors", float(found[:, 1].mean()))
        )
    both = np.concatenate(every)
    mean = 100 * float(both[:, 0].mean())
    what = f"default 90 % band, all choices ({len(both)}): held-out inputs in it, %"
    met = None if quick else LOW <= mean <= HIGH
    spread = noted("    deviation from choice to choice", 100 * float(both[:, 0].std()))
    return [Row(what, mean, LOW, None, met, "86 to 94", at_least=True), spread, *rows]


def _judged(train: Record, test: Record) -> tuple[float, float]:
    """Coverage of one choice, and the mean half width over the error that nine tenths do not exceed."""
    fit = hysid.fit(train, "Preisach", test=test)
    band = hysid.invert(fit)
    assert fit.test is not None
    assert isinstance(band, CalibratedCompensator)
    found, counted = estimate(band, fit.test), fit.test.mask
    off = np.abs(np.asarray(found.value) - fit.test.input)[counted]
    half = NORMAL_95 * float(np.mean(np.asarray(found.deviation)[counted]))
    # Once the held-out rows have widened it, what it holds of them is no test.
    return float(band.coverage_before), half / float(np.quantile(off, 0.9))


def _path(random: np.random.Generator, loops: int) -> tuple[np.ndarray, np.ndarray]:
    """Forces in steps, N, and the number of the loop of each; the first reaches 20 N."""
    force, loop = [0.0], [0]
    for k in range(loops):
        points = [0.0]
        for n in range(2 * int(random.integers(1, 5)) - 1):
            last = points[-1]
            if k == n == 0:
                points.append(20.0)
            elif n % 2:
                points.append(random.uniform(0, max(last - 1, 0.1)))
            else:
                points.append(random.uniform(min(last + 1, 20), 20))
        for start, end in zip(points, [*points[1:], 0.0], strict=True):
            steps = max(int(np.ceil(abs(end - start) / STEP_N)), 1)
            force += np.linspace(start, end, steps + 1)[1:].tolist()
            loop += [k] * steps
    return np.array(force), np.array(loop)


def _columns(sheet: Sheet) -> list[np.ndarray]:
    return [values.round(decimals) for values, decimals in sheet.columns.values()]


def _split(
    force: np.ndarray,
    output: np.ndarray,
    time: np.ndarray,
    held: np.ndarray,
    groups: np.ndarray | None = None,
) -> Split:
    return Record.from_arrays(force, output, time, groups).split_rows(held)
