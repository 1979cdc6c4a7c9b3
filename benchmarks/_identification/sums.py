"""Whether intervals of the sums of weights hold the truth, where the truth is not of the grid.

The truth is a grid of 80 x 80 relays with a Gaussian density, drawn anew for each record, beside a line.
Noise is 1 % of the range, white or AR(1). `identify.fit` chooses grid, blocks and prior strength, or the
parts of a composition, as for a user, and `identify.sample` draws noise, prior strength and weights.
"""

import sys
from collections.abc import Iterator
from typing import NamedTuple

import jax
import numpy as np

import identify
from hysteresis import Record
from hysteresis.numerics._functions import NORMAL_95
from identify.linear._preisach_unknowns import SUMS

from .._measure import Row, noted

RECORDS, QUICK = 100, 10
SEED = 20261123
"""Fixed before the first run."""

SIDE, EACH = 80, 19
"""Relays along each threshold, of which those with alpha >= beta are there; rows between two turns."""

NOISE, PHI = 0.01, 0.7
"""Standard deviation, of the output's range; correlation of neighbouring rows where it has one."""

LOW, HIGH = 86.0, 94.0
"""Of 100 intervals, 90 give or take 6 hold the truth in 95 of 100 studies."""


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
    phi: float, records: int, size: float = NOISE, model: str = "Preisach"
) -> Iterator[tuple[Truth, identify.FitResult]]:
    """Truths and their fits, one after the other."""
    for k in range(records):
        random = np.random.default_rng([SEED, k, round(100 * phi)])
        one = truth(random)
        yield one, identify.fit(noisy(one, phi, random, size), model)


def sums_rows(quick: bool) -> list[Row]:
    """Coverage of every sum of a grid under white and AR(1) noise: by the fit, and by its posterior."""
    return _coverage("Preisach", quick)


def composition_rows(quick: bool) -> list[Row]:
    """The same of compositions."""
    return _coverage("Composition", quick)


def _coverage(model: str, quick: bool) -> list[Row]:
    jax.config.update("jax_enable_x64", True)
    records, rows = QUICK if quick else RECORDS, []
    for phi in (0.0, PHI):
        name = f"{model}, {f'AR(1) {phi:g}' if phi else 'white'}"
        count = _Count()
        for one, fit in fits(phi, records, model=model):
            count.add(one, fit, identify.sample(fit, ensembles=2))
            print(f"  {name}: {count.records} records", file=sys.stderr, flush=True)
        rows += count.rows(name, judged=not quick)
    return rows


class _Count:
    """How often the intervals of sums held the truth, by what said them and by the sum."""

    def __init__(self) -> None:
        self.held: dict[tuple[str, str], list[bool]] = {}
        self.pulls: dict[tuple[str, str], list[float]] = {}
        self.records = self.unidentified = self.open = self.converged = 0

    def add(self, one: Truth, fit: identify.FitResult, drawn: identify.internal.Posterior) -> None:
        """A record, its fit and its posterior."""
        self.records += 1
        self.converged += drawn.converged
        for p in fit.parameters:
            if p.name not in one.sums:
                continue
            value = one.sums[p.name]
            if p.status == "unidentified":
                self.unidentified += 1
            elif p.stderr is None:
                low = -np.inf if p.low is None else p.low
                high = np.inf if p.high is None else p.high
                self._note("range of the fit", p.name, low <= value <= high)
            elif p.name in SUMS:
                pull = (p.value - value) / p.stderr
                self._note("90 % interval of the fit", p.name, abs(pull) < NORMAL_95, pull)
        found = {s.name: s for s in drawn.summaries}
        self.open += sum(name not in found for name in SUMS)
        for name in SUMS:
            if (s := found.get(name)) is not None:
                value = one.sums[name]
                inside = s.q05 <= value <= s.q95
                self._note("90 % interval of the posterior", name, inside, (s.mean - value) / s.sd)

    def _note(self, by: str, name: str, inside: bool, pull: float | None = None) -> None:
        self.held.setdefault((by, name), []).append(bool(inside))
        if pull is not None:
            self.pulls.setdefault((by, name), []).append(pull)

    def rows(self, name: str, judged: bool) -> list[Row]:
        """The table."""
        why = f"{self.records} records cannot tell 90 % from 85 %"
        rows = [
            noted(f"{name}: sums that the fit calls unidentified", self.unidentified),
            noted(f"{name}: sums that the posterior leaves out", self.open),
            noted(f"{name}: posteriors that converged, %", 100 * self.converged / self.records),
        ]
        for (by, sum_), inside in self.held.items():
            coverage = 100 * float(np.mean(inside))
            met = coverage >= LOW and (by == "range of the fit" or coverage <= HIGH)
            what = f"{name}: {sum_}, coverage of the {by}, % (86 to 94)"
            rows.append(Row(what, coverage, None, None, met if judged else None, why))
            if (by, sum_) in self.pulls:
                pulls = self.pulls[by, sum_]
                rows.append(noted("    mean pull", float(np.mean(pulls))))
                rows.append(noted("    deviation of the pulls", float(np.std(pulls))))
        return rows
