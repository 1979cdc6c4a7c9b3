"""Whether the band that a fit shows holds: on other motions, on the same, and as all consumers tell it."""

import json
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

import identify
from compensate import estimate
from compensate.internal import CalibratedCompensator
from hysid import invert
from hysid.commands._asked import Export, Fit, Predict, Qualify
from hysid.commands._demo import demo_data
from hysid.intake._selection import Selection
from hysteresis import Record
from hysteresis.internal import FoamBlock
from hysteresis.numerics._functions import NORMAL_95
from hysteresis.rigs import SpongeRig

from .. import _other_rigs as others
from .._measure import Row, judged, noted, said

LOW, HIGH, WIDER = 80.0, 96.0, 1.6
FAST = 8.0
NOISE = 0.002

Samples = np.ndarray


class Rig(NamedTuple):
    """A law from inputs and a time step to outputs, driven from `low` to `high` at a mean speed."""

    law: Callable[[Samples, float], Samples]
    low: float
    high: float
    speed: float
    step: float


def _resampled(output: Callable[[Samples, Samples], Samples], u: Samples, step: float) -> Samples:
    """What a rig of `_other_rigs` reads at another step than its own."""
    asked = step * np.arange(len(u))
    t = np.arange(0, asked[-1] + others.STEP / 2, others.STEP)
    return np.interp(asked, t, output(t, np.interp(t, asked, u)))


def _small(output: Callable[[Samples, Samples], Samples], low: float = 0.0) -> Rig:
    return Rig(partial(_resampled, output), low, 1.0, (1.0 - low) / 1.2, others.STEP)


RIGS = {
    "foam": Rig(lambda u, step: FoamBlock().follow(u, step), 0.0, 20.0, 1.0, 0.5),
    "sponge": Rig(lambda u, step: SpongeRig().follow(u, step), 0.0, 20.0, 1.0, 0.5),
    "wire rope": _small(others.wire_rope),
    "geared drive": _small(others.geared_drive),
    "magnet": _small(lambda t, u: others.magnetisation(u), -1.0),
}
"""Rigs whose physics no model here contains."""


def _along(turns: list[float], speeds: list[float], step: float) -> Samples:
    t = np.cumsum([0.0, *np.maximum(np.abs(np.diff(turns)) / speeds, step)])
    return np.interp(np.arange(0, t[-1] + step / 2, step), t, turns)


def _equal(rig: Rig, random: np.random.Generator) -> Samples:
    """Six cycles of one peak and one speed."""
    return _along([rig.low, *[rig.high, rig.low] * 6], [rig.speed] * 12, rig.step)


def _mixed(rig: Rig, random: np.random.Generator) -> Samples:
    """Nine cycles to other peaks, at a half, one, and two times the speed; the first to the highest."""
    parts = np.append(1.0, random.uniform(0.3, 1.0, 8))
    speeds = np.repeat(rig.speed * random.choice([0.5, 1.0, 2.0], 9), 2).tolist()
    ends = [end for part in parts for end in (rig.low + (rig.high - rig.low) * part, rig.low)]
    return _along([rig.low, *ends], speeds, rig.step)


def _smooth(rig: Rig, random: np.random.Generator) -> Samples:
    """A smooth random force over the whole range: white noise through a Gaussian filter."""
    span = rig.high - rig.low
    n, period = int(24 * span / rig.speed / rig.step), 2.5 * span / rig.speed / rig.step
    white = random.normal(size=n + int(8 * period))
    f = np.fft.rfftfreq(len(white))
    smooth = np.fft.irfft(np.fft.rfft(white) * np.exp(-((f * period) ** 2) / 2), len(white))[:n]
    return rig.low + span * (smooth - smooth.min()) / np.ptp(smooth)


def _loops(rig: Rig, random: np.random.Generator) -> Samples:
    """Twelve times two small loops, anywhere in the middle of the range."""
    ends = []
    for _ in range(12):
        middle, half = random.uniform(0.15, 0.85), random.uniform(0.05, 0.15)
        ends += [middle + half, middle - half] * 2
    turns = [rig.low, *(rig.low + (rig.high - rig.low) * np.array(ends)).tolist()]
    return _along(turns, [rig.speed] * len(ends), rig.step)


MOTIONS = {"equal cycles": _equal, "mixed cycles": _mixed, "smooth": _smooth, "small loops": _loops}
TRAINED = ("equal cycles", "mixed cycles", "smooth")
RATES = {"eight times as fast": FAST, "eight times as slow": 1 / FAST}


def _record(name: str, kind: str, seed: int) -> Record:
    """A rig under a motion, or under the mixed cycles at another speed, with noise."""
    rig, rate = RIGS[name], RATES.get(kind, 1.0)
    u = MOTIONS.get(kind, _mixed)(rig, np.random.default_rng([seed, len(kind)]))
    y = rig.law(u, rig.step / rate)
    noisy = y + NOISE * np.ptp(y) * np.random.default_rng([seed, 1]).normal(size=len(y))
    t = rig.step / rate * np.arange(len(u))
    return Record.from_arrays(u, noisy, t, input_unit="N", output_unit="mm")


def rows(quick: bool) -> list[Row]:
    """Coverage and width on motions of another kind and of the same, and whether consumers agree."""
    names = ["foam", "wire rope"] if quick else [*RIGS]
    trained = TRAINED[:2] if quick else TRAINED
    found = {
        (name, kind): _judged(name, kind, [*MOTIONS, *RATES]) for name in names for kind in trained
    }
    other, same, own, extra, growth = [], [], [], [], []
    for (_, kind), uses in found.items():
        for use, (held, width, wider) in uses.items():
            if use == kind:
                same.append(held)
                own.append(width)
                extra.append(wider)
            else:
                other.append(held)
                growth.append(wider)
    mean = float(np.mean(other))
    what = "band on motions of another kind: inputs in the 90 % band, %"
    rows = [
        said(Row(what, mean, LOW, None, LOW <= mean <= HIGH, "80 to 96", at_least=True)),
        noted("    of the rigs, trainings and motions, within 80 to 96, %", _inside(other)),
        noted("    least of them, %", float(np.min(other))),
        noted(
            "    times the width that the same band has without its motion", float(np.mean(growth))
        ),
    ]
    for kind in trained:
        each = [
            held for (_, k), uses in found.items() if k == kind for use, (held, *_) in uses.items()
            if use != kind
        ]  # fmt: skip
        mean = float(np.mean(each))
        what = f"    learnt on {kind}, %"
        rows.append(
            said(Row(what, mean, LOW, None, LOW <= mean <= HIGH, "80 to 96", at_least=True))
        )
    what = "band on motions of the same kind: width, over the one that holds 90 %"
    rows.append(said(judged(what, float(np.mean(own)), WIDER)))
    rows.append(
        said(judged("    its width over that without its motion, at most", max(extra), WIDER))
    )
    rows.append(noted("    inputs in the band, %", float(np.mean(same))))
    return [*rows, said(_agreement(quick))]


def _inside(held: list[float]) -> float:
    return 100 * float(np.mean([LOW <= one <= HIGH for one in held]))


def _judged(name: str, kind: str, uses: list[str]) -> dict[str, tuple[float, float, float]]:
    """Of each use of a band that was learnt on a kind of motion: % held, half width over the 90 % quantile
    of the errors, and over the half width without the motion. The first cycle conditions a new sample."""
    band = invert(identify.fit(_record(name, kind, 0), "Preisach"))
    assert isinstance(band, CalibratedCompensator)
    assert band.motions is not None
    still = band.motions._replace(growth=0 * band.motions.growth)
    plain = replace(band, motions=still)
    found = {}
    for use in uses:
        record = _record(name, use, 1)
        counted, shown = record.cycle > 1, estimate(band, record)
        off = np.abs(np.asarray(shown.value) - record.input)[counted]
        half, without = (
            NORMAL_95 * np.asarray(one.deviation)[counted]
            for one in (shown, estimate(plain, record))
        )
        held = 100 * float(np.mean(off <= half))
        found[use] = (held, half.mean() / np.quantile(off, 0.9), half.mean() / without.mean())
    return found


def _agreement(quick: bool) -> Row:
    """Coverages of one fit's held-out rows: those of invert, fit.json, predict, qualify and the export."""
    model = "LinearSponge" if quick else "Preisach"
    with tempfile.TemporaryDirectory() as out:
        folder, file = Path(out) / "fit", demo_data(Path(out))
        chosen = Selection(
            "force (N)", "displacement (mm)", "time (s)", test_where=("cycle=11,12,13",)
        )
        document = (
            Fit(file=file, selection=chosen.as_json(), out=folder, model=model).run().document
        )
        band = invert(identify.load(folder))
        assert isinstance(band, CalibratedCompensator)
        told = [
            document["compensator"]["band"]["coverage"],
            band.coverage,
            Predict(folder=folder, file=file, inverse=True).run().document["band"]["held_out"],
            Qualify(folder=folder, file=file).run().document["band"],
        ]
        Export(folder=folder, runtime=Path(out) / "it.json").run()
        told.append(json.loads((Path(out) / "it.json").read_text())["coverage"])
    apart = max(told) - min(told)
    return judged("the consumers' coverages of the same rows: apart by", apart, 0.0)
