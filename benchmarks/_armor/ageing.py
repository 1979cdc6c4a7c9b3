"""Has a sponge aged? Pairs of five-cycle records of a virtual foam, unchanged, and with softer struts.

The records are fitted as `hysid fit FILE --model LinearSponge --range 2,20` does, and compared as
`hysid compare --change` does. What differs is the noise of the gauge, and from cycle to cycle what the
foam does: it softens, and creeps.
"""

from functools import cache

import numpy as np
from jaxtyping import Float

import hysid
import identify
from hysteresis import Record
from hysteresis.internal import FoamBlock, force_path

from .._measure import Row, judged, noted

FORCE = force_path((0.0,) + (20.0, 0.0) * 5, 2.0)
DT, NOISE = 6.0, 0.1
"""s from sample to sample; mm, of the gauge."""

PAIRS, FEW, LEVEL = 200, 20, 0.01
"""Pairs; those of a quick run; p below which a change counts."""

SOFTER, MUCH = 0.05, 0.20
"""Displacements larger by these parts."""


@cache
def path() -> Float[np.ndarray, " samples"]:
    """Displacement of a block, mm."""
    return np.asarray(FoamBlock().follow(FORCE, dt=DT))


def fitted(random: np.random.Generator, softer: float = 0.0) -> identify.FitResult:
    """The line of one record."""
    d = (1 + softer) * path() + random.normal(0, NOISE, len(FORCE))
    record = Record.from_arrays(FORCE, d, dt=DT, input_unit="N", output_unit="mm")
    # No noise model explains what a line misses of a loop, so least squares stays; it is asked for at once,
    # which takes a third of the time.
    return hysid.fit(record.select(range=(2.0, 20.0)), model="LinearSponge", noise="gaussian")


def ageing_rows(quick: bool) -> list[Row]:
    """How often an unchanged sponge is said to have changed, and one that is 5 % softer not."""
    pairs, random = FEW if quick else PAIRS, np.random.default_rng(2014)
    before = [fitted(random) for _ in range(pairs)]
    same = [identify.change(one, fitted(random)) for one in before]
    softer = [identify.change(one, fitted(random, SOFTER)) for one in before]
    much = [identify.change(one, fitted(random, MUCH)) for one in before[:FEW]]
    alarms = float(np.mean([found.p < LEVEL for found in same]))
    power = float(np.mean([found.p < LEVEL for found in softer]))
    # The binomial deviation of 200 pairs at a rate of 0.01 is 0.007.
    bar = LEVEL + 1.64 * (LEVEL * (1 - LEVEL) / pairs) ** 0.5
    named = float(np.mean([found.parameters[0].clear for found in much]))
    return [
        judged(f"ageing, {pairs} unchanged pairs: false alarms at p < 0.01", alarms, bar),
        judged(f"ageing, {pairs} pairs, 5 % softer: power", power, 0.9, at_least=True),
        judged(
            f"ageing, {len(much)} pairs, 20 % softer: attributed to K", named, 1.0, at_least=True
        ),
        noted("    median p of the unchanged pairs", float(np.median([one.p for one in same]))),
    ]
