"""Whether 90 % intervals of fitted constants hold the truth, over 200 records of their own each.

- K and b of the linear sponge: five cycles on `FoamBlock`, which is more than any model; the truth is the
  line that the same test gives without noise.
- `loop.width` of a Preisach grid: 120 x 120 relays, which no grid of a fit can be, with 0.5 % of noise.
- Burgers: jumps, rests and ramps with 1 % of noise, parameters drawn within a factor of 1.5.
"""

import sys
from collections.abc import Callable, Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

import identify
from hysteresis import Record
from hysteresis.internal import FoamBlock
from hysteresis.numerics._functions import NORMAL_95
from hysteresis.rigs._sponge import SpongeCycles

from .._identification.sums import noisy, truth
from .._measure import Row, judged, noted
from ..recovery import cases

RECORDS, QUICK = 200, 20
LOW, HIGH = 86.0, 94.0
"""Of 200 sound intervals 90 % hold the truth, give or take 2.1 %: two of those on either side."""

SEED = 20261125
"""Fixed before the first run."""

FOAM_NOISE, GRID_NOISE, RELAYS = 0.05, 0.005, 120
"""mm of a displacement gauge; of the output's range; along each threshold."""


class Held(NamedTuple):
    """Of one quantity in one record: whether its interval holds the truth, and its pull in half widths."""

    name: str
    inside: bool
    pull: float


def rows(quick: bool) -> list[Row]:
    """A row for each quantity: per cent of its intervals that hold the truth."""
    found = []
    for run in (sponge, grid, burgers):
        found += _rows(run, QUICK if quick else RECORDS, quick)
    return found


@cache
def clean_test() -> SpongeCycles:
    """The test on the foam without noise."""
    return FoamBlock().five_cycles()


def sponge(k: int) -> Iterator[Held]:
    """K and b of one noisy test on the foam."""
    cycles = clean_test()
    pressed = cycles.force >= 1.5  # the model's contact force
    line = np.polyfit(cycles.force[pressed], cycles.displacement[pressed], 1)
    noise = np.random.default_rng([SEED, k]).normal(0, FOAM_NOISE, len(cycles.force))
    record = Record.from_arrays(
        cycles.force, cycles.displacement + noise, cycles.time, input_unit="N", output_unit="mm"
    )
    fit = identify.fit(record, "LinearSponge", starts=2)
    yield from _held(fit, dict(zip(("K", "b"), line.tolist(), strict=True)))


def grid(k: int) -> Iterator[Held]:
    """Loop width of one record of relays beside a line."""
    random = np.random.default_rng([SEED, k, RELAYS])
    one = truth(random, side=RELAYS)
    fit = identify.fit(noisy(one, 0.0, random, GRID_NOISE), "Preisach")
    yield from _held(fit, {"loop.width": one.sums["loop.width"]})


def burgers(k: int) -> Iterator[Held]:
    """All parameters of one creep test."""
    case = next(one for one in cases() if one.name == "Burgers")
    random = np.random.default_rng([SEED, k, 4])
    model = case.draw(random)
    y = np.asarray(model.simulate(case.t, case.u))
    y = y + random.normal(0, 0.01 * np.ptp(y), len(y))
    fit = identify.fit(Record.from_arrays(case.u, y, case.t), "Burgers", starts=8)
    names = ("E1", "eta1", "E2", "eta2", "offset")
    yield from _held(fit, {name: float(getattr(model, name)) for name in names})


def _held(fit: identify.FitResult, true: dict[str, float]) -> Iterator[Held]:
    known = {p.name: p for p in fit.parameters}
    for name, value in true.items():
        p = known[name]
        half = NORMAL_95 * (p.stderr or np.nan)
        low = p.value - half if p.low is None else p.low
        high = p.value + half if p.high is None else p.high
        yield Held(name, bool(low <= value <= high), 2 * (p.value - value) / (high - low))


def _rows(run: Callable[[int], Iterator[Held]], records: int, quick: bool) -> list[Row]:
    of: dict[str, list[Held]] = {}
    for k in range(records):
        for held in run(k):
            of.setdefault(held.name, []).append(held)
        if (k + 1) % 20 == 0:
            print(f"  {run.__name__}: {k + 1} records", file=sys.stderr, flush=True)
    found = []
    for name, several in of.items():
        share = 100 * float(np.mean([one.inside for one in several]))
        pull = float(np.nanmean([one.pull for one in several]))  # NaN where it is unidentified
        what = f"{run.__name__}: {name}, 90 % intervals of {records} records that hold the truth, %"
        if quick:
            found.append(
                noted(what, share, reason=f"{records} records cannot tell {LOW:g} % from 90")
            )
        else:
            row = judged(what, share, LOW, at_least=True)
            found.append(row._replace(met=LOW <= share <= HIGH))
        found.append(noted(f"{name}: mean error in half widths", pull))
    return found
