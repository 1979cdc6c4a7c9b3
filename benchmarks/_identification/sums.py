"""Whether intervals of a grid Preisach's sums hold the truth, where the truth is not of the grid.

The truth is a grid of 80 x 80 relays with a Gaussian density, drawn anew for each record, beside a line.
Noise is 1 % of the range, white or AR(1). `identify.fit` chooses grid, blocks and prior strength as it does
for a user.
"""

import sys
from collections.abc import Iterator
from typing import NamedTuple

import jax
import numpy as np

import identify
from hysteresis import Record
from hysteresis.numerics._normal import NORMAL_95

from .._measure import Row, noted

RECORDS, QUICK = 200, 20
SEED = 20261123
"""Fixed before the first run."""

SIDE, EACH = 80, 19
"""Relays along each threshold, of which those with alpha >= beta are there; rows between two turns."""

NOISE, PHI = 0.01, 0.7
"""Standard deviation, of the output's range; correlation of neighbouring rows where it has one."""

LOW, HIGH = 86.0, 94.0
"""Of 200 intervals, 180 give or take 8 hold the truth in 95 of 100 studies."""


class Truth(NamedTuple):
    """A record without noise, and its sums by name."""

    u: np.ndarray
    y: np.ndarray
    sums: dict[str, float]


def truth(random: np.random.Generator, side: int = SIDE, each: int = EACH) -> Truth:
    """Relays beside a line, driven over the range three times and over minor loops between."""
    i, j = np.tril_indices(side)
    alpha, beta = (i + 0.5) / side, (j + 0.5) / side
    middle, half = (alpha + beta) / 2, (alpha - beta) / 2
    centre, width = random.uniform(0.4, 0.6), random.uniform(0.15, 0.3)
    opening, spread = random.uniform(0.05, 0.2), random.uniform(0.04, 0.12)
    weights = np.exp(-(((middle - centre) / width) ** 2 + ((half - opening) / spread) ** 2) / 2)
    weights *= random.uniform(0.5, 1.5) / weights.sum()
    line, offset = random.uniform(0.2, 1.0), random.uniform(-0.5, 0.5)

    minor = random.uniform(0.1, 0.9, 14)
    turns = np.concatenate([[0.0, 1.0, 0.0], minor[:9], [1.0, 0.0], minor[9:], [1.0, 0.0]])
    u = np.interp(np.arange(each * (len(turns) - 1) + 1) / each, np.arange(len(turns)), turns)
    state, y = -np.ones(len(weights)), np.empty(len(u))
    for k, now in enumerate(u):
        state = np.where(now >= alpha, 1.0, np.where(now <= beta, -1.0, state))
        y[k] = weights @ state
    mass = weights.sum()
    sums = {
        "output.middle": offset + line / 2, "output.rise": line + 2 * mass,
        "loop.width": 2 * float(weights @ (alpha - beta)),
        "offset": offset, "reversible.rise": line, "density.mass": mass,
    }  # fmt: skip
    return Truth(u, y + line * u + offset, sums)


def noisy(one: Truth, phi: float, random: np.random.Generator, size: float = NOISE) -> Record:
    """The record with AR(1) noise."""
    noise = random.normal(size=len(one.y))
    for k in range(1, len(noise)):
        noise[k] = phi * noise[k - 1] + np.sqrt(1 - phi**2) * noise[k]
    return Record.from_arrays(one.u, one.y + size * np.ptp(one.y) * noise)


def fits(
    phi: float, records: int, size: float = NOISE
) -> Iterator[tuple[Truth, identify.FitResult]]:
    """Truths and their fits, one after the other."""
    for k in range(records):
        random = np.random.default_rng([SEED, k, round(100 * phi)])
        one = truth(random)
        yield one, identify.fit(noisy(one, phi, random, size), "Preisach")


def sums_rows(quick: bool) -> list[Row]:
    """Coverage of every sum under white and AR(1) noise, of the ranges, and the bias without noise."""
    jax.config.update("jax_enable_x64", True)
    records, rows = QUICK if quick else RECORDS, []
    why = f"{records} records cannot tell 90 % from 85 %"
    for phi in (0.0, PHI):
        name = f"AR(1) {phi:g}" if phi else "white"
        held: dict[str, list[bool]] = {}
        pulls: dict[str, list[float]] = {}
        drawn: dict[str, list[bool]] = {}
        open_: set[str] = set()
        unknown = 0
        for one, fit in fits(phi, records):
            for p in fit.parameters:
                value = one.sums[p.name]
                if p.status == "unidentified":
                    unknown += 1
                elif p.stderr is None:
                    open_.add(p.name)
                    low = -np.inf if p.low is None else p.low
                    high = np.inf if p.high is None else p.high
                    held.setdefault(p.name, []).append(low <= value <= high)
                else:
                    pull = (p.value - value) / p.stderr
                    pulls.setdefault(p.name, []).append(pull)
                    held.setdefault(p.name, []).append(abs(pull) < NORMAL_95)
            if len(drawn.get("loop.width", ())) < 50:
                posterior = identify.sample(fit, steps=50, ensembles=2)
                for s in posterior.summaries:
                    if s.name in one.sums:
                        inside = s.q05 <= one.sums[s.name] <= s.q95
                        drawn.setdefault(s.name, []).append(bool(inside))
        rows.append(noted(f"{name}: sums called unidentified", unknown))
        for sum_, inside in held.items():
            coverage = 100 * float(np.mean(inside))
            what = f"{name}: {sum_}, coverage of its {'range' if sum_ in open_ else '90 % interval'}, %"
            met = coverage >= LOW if sum_ in open_ else LOW <= coverage <= HIGH
            rows.append(Row(what, coverage, None, None, None if quick else bool(met), why))
            if sum_ in pulls:
                rows.append(noted("    mean pull", float(np.mean(pulls[sum_]))))
                rows.append(noted("    deviation of the pulls", float(np.std(pulls[sum_]))))
                rows.append(noted("    coverage of draws", 100 * float(np.mean(drawn[sum_]))))
            print(f"  {what} {coverage:.1f}", file=sys.stderr, flush=True)
    return rows
