"""Oscillators with hysteresis, identified from noisy records and judged on records they have not seen.

python -m benchmarks.dynamics [--quick] [--json] [--only TEXT]

The records are those of the Bouc-Wen benchmark (Noël and Schoukens 2016) with seeds of our own, made by an
implementation that shares no code with the package (`benchmarks/_dynamics/plants.py`). Every fit has the
record alone: no start values and, where blind, no class. Errors are rms over all samples of a multisine
period in steady state and of a sweep from rest, both without noise. docs/peers.md has published figures.

`--quick` takes a twentieth of the seeds for coverage, and few of the others.
"""

import sys
import time
from collections.abc import Sequence
from functools import cache
from typing import Any

import jax
import numpy as np
from scipy.signal import lfilter

import identify
from hysteresis import Record
from identify.results._detail import Motion

from ._dynamics.plants import (
    NOISE,
    PERIOD,
    RATE,
    Plant,
    multisine,
    steady,
    training,
    unseen_multisine,
    unseen_sweep,
)
from ._dynamics.step import microseconds
from ._measure import Row, judged, noted, run_parts

TRUTH = {
    "mass": 2.0, "damping": 10.0, "stiffness": 5e4, "hysteresis.alpha": 5e4,
    "hysteresis.beta_gamma": 800.0, "hysteresis.beta_delta": -1100.0,
}  # fmt: skip
KNOWN, BLIND = "Oscillator(BoucWen)", "Oscillator"


def record_of(seed: int, kind: str = "boucwen", rows: int | None = None) -> Record:
    """The noisy training record of a seed."""
    return as_record(*training(seed, kind, rows=rows))


def as_record(u: Any, y: Any) -> Record:
    t = np.arange(len(u)) / RATE
    return Record.from_arrays(u, y, t, input_unit="N", output_unit="m")


@cache
def sweep(kind: str, seed: int) -> tuple[Any, Any]:
    return unseen_sweep(seed, kind)


def errors(fit: identify.FitResult, kind: str, seed: int) -> dict[str, float]:
    """Rms errors on the multisine and on the sweep, in m and in per cent of the rms of the motion."""
    assert isinstance(fit.detail, Motion)
    motion, found = fit.detail.recorded, {}
    for name, (u, y), in_steady_state in (
        ("multisine", unseen_multisine(seed, kind), True),
        ("sweep", sweep(kind, 0 if kind == "boucwen" else seed), False),
    ):
        predicted = (motion.steady if in_steady_state else motion.from_rest)(as_record(u, y))
        rms = float(np.sqrt(np.mean((predicted - y) ** 2)))
        found |= {name: rms, f"{name} %": 100 * rms / float(np.std(y))}
    return found


def fitted(record: Record, model: str) -> tuple[identify.FitResult, float]:
    # Of all threads together, so that what else the machine does is not counted.
    begin = time.process_time()
    fit = identify.fit(record, model)
    return fit, time.process_time() - begin


def held(fit: identify.FitResult) -> list[bool]:
    """Of each parameter: whether its 90 % interval holds the truth."""
    return [p.low <= TRUTH[p.name] <= p.high for p in fit.parameters]  # type: ignore[operator]


def known(quick: bool) -> list[Row]:
    """The class is known: errors of 20 seeds, time, and intervals of 100."""
    count, judged_on = (10, 5) if quick else (100, 20)
    found, seconds, inside = [], [], []
    for seed in range(1, count + 1):
        fit, taken = fitted(record_of(seed), KNOWN)
        inside.append(held(fit))
        if seed <= judged_on:
            found.append(errors(fit, "boucwen", seed))
            seconds.append(taken)
        print(
            f"  seed {seed}: {taken:.1f} s {found[-1] if seed <= judged_on else ''}",
            file=sys.stderr,
        )
    multisine = [one["multisine"] for one in found]
    share = 100 * np.array(inside).mean(0)
    rows = [
        judged(
            "multisine, 40,960 samples, class known (m), median",
            float(np.median(multisine)),
            1.2e-7,
        ),
        judged("multisine, 40,960 samples, class known (m), worst", max(multisine), 2.0e-7),
        judged(
            "sweep, same fit (m), median", float(np.median([one["sweep"] for one in found])), 1.0e-7
        ),
        judged("processor time, class known (s), median", float(np.median(seconds)), 5.0),
    ]
    if quick:
        said = f"{count} seeds are too few; the full run judges it"
        return [
            *rows,
            noted("90 % intervals cover, mean of six (%)", float(share.mean()), reason=said),
        ]
    # Of 100 seeds a sound interval holds the truth in 90, give or take 3.
    return [
        *rows,
        judged(
            "90 % intervals cover, the least of six (%)", float(share.min()), 86.0, at_least=True
        ),
        judged("90 % intervals cover, the most of six (%)", float(share.max()), 94.0),
    ]


def short(quick: bool) -> list[Row]:
    """500 samples of a period of 8,192, so without a period."""
    found, blind, inside = [], [], []
    for seed in range(1, 4 if quick else 11):
        record = record_of(seed, rows=500)
        fit = fitted(record, KNOWN)[0]
        found.append(errors(fit, "boucwen", seed)["multisine"])
        inside.append(held(fit))
        blind.append(errors(fitted(record, BLIND)[0], "boucwen", seed)["multisine"])
    return [
        judged("multisine from 500 samples (m), median", float(np.median(found)), 1.5e-6),
        noted("multisine from 500 samples (m), worst", max(found)),
        noted("multisine from 500 samples, blind (m), median", float(np.median(blind))),
        noted(
            "90 % intervals from 500 samples cover, mean of six (%)", 100 * float(np.mean(inside))
        ),
    ]


def coloured(quick: bool) -> list[Row]:
    """Noise of an AR(1) process, which the fit has to see in what differs between the periods."""
    inside, chi2 = [], []
    for seed in range(1, 6 if quick else 41):
        random = np.random.default_rng([seed, 9])
        u, y = steady(Plant(), multisine(random, PERIOD // 4), 5)
        noise = np.asarray(lfilter([1.0], [1.0, -0.9], random.normal(size=len(y) + 500)))[500:]
        fit, _ = fitted(as_record(u, y + NOISE / np.std(noise) * noise), KNOWN)
        assert isinstance(fit.detail, Motion)
        inside.append(held(fit))
        chi2.append(fit.detail.chi2)
    share = 100 * float(np.mean(inside))
    return [
        noted("90 % intervals under AR(1) noise of 0.9 cover, mean of six (%)", share),
        noted("chi2 per row under AR(1) noise of 0.9, median", float(np.median(chi2))),
    ]


def posterior(quick: bool) -> list[Row]:
    """Draws until the ensembles agree; the deviations beside the standard errors."""
    fit, _ = fitted(as_record(*training(1, samples=PERIOD // (8 if quick else 4))), KNOWN)
    begin = time.process_time()
    drawn = identify.sample(fit)
    taken = time.process_time() - begin
    by_fit = {p.name: p.stderr for p in fit.parameters}
    ratios = [one.sd / by_fit[one.name] for one in drawn.summaries if one.name in by_fit]  # type: ignore[operator]
    return [
        noted("processor time of a posterior, until R-hat < 1.01 (s)", taken),
        noted("posterior deviation over standard error, least of six", min(ratios)),
        noted("posterior deviation over standard error, most of six", max(ratios)),
    ]


def blind(quick: bool) -> list[Row]:
    """Only a mass and some hysteresis is said."""
    seeds = {"boucwen": 2 if quick else 5, "drawn": 1 if quick else 5, "iwan": 1 if quick else 5,
             "preisach": 1 if quick else 5}  # fmt: skip
    bars = {"drawn": (0.05, 0.05), "iwan": (0.5, 1.0), "preisach": (1.0, 3.0)}
    rows, seconds = [], []
    for kind, count in seeds.items():
        found = []
        for seed in range(1, count + 1):
            fit, taken = fitted(record_of(seed, kind), BLIND)
            seconds.append(taken)
            found.append(errors(fit, kind, seed))
            print(f"  {kind} {seed}: {fit.name}, {taken:.1f} s, {found[-1]}", file=sys.stderr)
        if kind == "boucwen":
            value = max(one["multisine"] for one in found)
            rows.append(judged("multisine, blind (m), worst", value, 5e-7))
            continue
        for name, bar in zip(("multisine", "sweep"), bars[kind], strict=True):
            value = max(one[f"{name} %"] for one in found)
            rows.append(judged(f"blind {kind}, {name} (% of rms), worst", value, bar))
    return [*rows, judged("processor time, blind (s), worst", max(seconds), 30.0)]


def stepped(quick: bool) -> list[Row]:
    """One sample of the exported step in C99, with 20 steps of integration."""
    fit, _ = fitted(record_of(1), KNOWN)
    value = microseconds(fit, 20_000 if quick else 200_000)
    if value is None:
        return [noted("streaming step in C99 (microseconds)", float("nan"), reason="no C compiler")]
    return [judged("streaming step in C99 (microseconds)", value, 2.0)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the benchmark and print its table."""
    Plant().moved(np.zeros(4))  # compiled before anything is timed
    jax.config.update("jax_enable_x64", True)
    identify.fit(as_record(*training(1, samples=PERIOD // 4, periods=2)), KNOWN)
    parts = {"known": known, "short": short, "blind": blind, "coloured": coloured,
             "posterior": posterior, "step": stepped}  # fmt: skip
    run_parts("benchmarks.dynamics", __doc__, parts, arguments)


if __name__ == "__main__":
    main()
