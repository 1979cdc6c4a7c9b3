"""Kim and Park (2018): force, place, several places, and several forces, from a skin's few readings."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from compensate.microchannel._localizer import Confusion
from identify.training._train import Trained

from ._frame import Measure, Paper, Say, compared
from ._skin import PLACES, Skin
from ._skin_pair import OURS_FOR_ONE, SkinPair, error, found_peaks, of_pair

EPOCHS, PAIRS = 1000, 3
"""Of the network of (A), a tenth of them of those of (D); sensors of which (D) is made."""
QUICK_EPOCHS, QUICK_PAIRS = 60, 1
"""The same in five minutes on two cores."""


class Laboratory(NamedTuple):
    """A virtual skin, and its experiments with two contacts where they are made."""

    skin: Skin
    pair: SkinPair | None


def _skin(measure: Callable[[Skin, bool], Any]) -> Measure:
    return lambda one, ours: float(measure(one.skin, ours))


def _pair(measure: Callable[[SkinPair, bool], Any]) -> Measure:
    return lambda one, ours: None if one.pair is None else float(measure(one.pair, ours))


def _network(skin: Skin, ours: bool) -> Trained:
    return skin.network if ours else skin.timeless


def _places(skin: Skin, ours: bool) -> Confusion:
    """By five nearest neighbours, or by ours."""
    return skin.likeliest if ours else skin.votes


def _taken(place: str, other: str) -> Measure:
    at = PLACES.index(place), PLACES.index(other)
    return _skin(lambda skin, ours: _places(skin, ours).counts[at])


PAPER = Paper("kim2018", {
    "mse_start": _skin(lambda skin, _: np.mean(np.square(skin.taught.force))),
    "mse_end": _skin(lambda skin, ours: _network(skin, ours).train[-1]),
    "training": _skin(lambda skin, ours: _network(skin, ours).seconds),
    "loops": _skin(lambda skin, ours: skin.rms(skin.by_network if ours else skin.by_timeless)),
    **{f"right_{place}": _taken(place, place) for place in PLACES},
    "accuracy": _skin(lambda skin, ours: 100 * _places(skin, ours).accuracy),
    "b_for_c": _taken("B", "C"),
    "d_for_e": _taken("D", "E"),
    "logic": _skin(lambda skin, _: sum(p == found for p, found in skin.decisions)),
    "peaks": _pair(lambda pair, ours: found_peaks(pair.together, ours)),
    "peaks_placed": _pair(lambda pair, ours: found_peaks(pair.placed, ours)),
    "alone": _pair(lambda pair, ours: np.mean([error(one, ours) for one in pair.alone])),
    "together": _pair(lambda pair, ours: error(pair.together, ours)),
    "placed": _pair(lambda pair, ours: error(pair.placed, ours)),
    "step": _pair(lambda pair, ours: pair.ours_us if ours else pair.paper_us),
})  # fmt: skip


def carry_out(
    rigs: int, *, seed: int, ours: bool, epochs: int | None, quick: bool, say: Say
) -> dict[str, Any]:
    """(A) to (C) over all sensors, (D) over three; tables of the first."""
    epochs = epochs or (QUICK_EPOCHS if quick else EPOCHS)
    pairs, of_two = QUICK_PAIRS if quick else PAIRS, max(1, epochs // 10)
    laboratories = [
        Laboratory(Skin(seed + n, epochs), SkinPair(seed + n, of_two) if n < pairs else None)
        for n in range(rigs)
    ]

    def progress(done: int) -> None:
        two = " with two contacts" if done <= pairs else ""
        say(f"sensor {done} of {rigs}{two}")

    trained = PAPER.said["trained"].format(epochs, of_two, OURS_FOR_ONE * of_two)
    rows = compared(PAPER.published, laboratories, ours, progress)
    first = laboratories[0].skin
    tables = {
        "Table I. Levels of each combination": str(first.logic),
        f"Table II. Five nearest neighbours, sensor {first.seed}": str(first.votes),
    }
    if ours:
        tables[f"Table II by ours, sensor {first.seed}"] = str(first.likeliest)
    return {
        "rig": f"{PAPER.said['rig']} {trained}", "epochs": epochs, "rows": rows,
        "findings": _findings(laboratories, ours), "tables": tables,
    }  # fmt: skip


def _findings(laboratories: Sequence[Laboratory], with_ours: bool) -> list[dict[str, Any]]:
    """What the paper says in words, and whether the sentence is true of all virtual sensors."""
    skins = [one.skin for one in laboratories]
    pairs = [one.pair for one in laboratories if one.pair is not None]
    network = float(np.mean([skin.rms(skin.by_timeless) for skin in skins]))
    curve = float(np.mean([_static_error(skin) for skin in skins]))
    wrong = np.array([20 - np.diag(skin.votes.counts[:, :5]) for skin in skins])
    missing = zip(PLACES, wrong.mean(axis=0), strict=True)
    sound = sum(all(p == found for p, found in skin.decisions) for skin in skins)
    late = np.array([peak.late for pair in pairs for peak in of_pair(pair.together)])
    missed, peaks, late = int(np.isnan(late).sum()), len(late), late[np.isfinite(late)]
    together = float(np.mean([error(pair.together) for pair in pairs]))
    numbers: dict[str, float] = {}
    if with_ours:
        for name in ("together", "placed"):
            both = [getattr(pair, name) for pair in pairs]
            numbers[f"ratio_{name}"] = float(np.mean([error(x, True) / error(x) for x in both]))
        steps = np.mean([(pair.paper_us, pair.ours_us) for pair in pairs], axis=0)
        numbers["steps"] = steps[0] / steps[1]
    true = {
        "network": network < 0.5 * curve,
        "places": not wrong[:, [0, 2, 4]].any() and wrong[:, [1, 3]].any(),
        "combinations": sound == len(skins),
        "peaks": not missed and late.min() < 0 < late.max(),
        "contacts": together > network,
    }
    return PAPER.findings(
        true, with_ours, network=network, curve=curve, sound=sound, count=len(skins),
        wrong=", ".join(f"{p} {n:.2g}" for p, n in missing), missed=missed, peaks=peaks,
        early=-1e3 * late.min(), latest=1e3 * late.max(), mean=1e3 * late.mean(), together=together,
        **numbers,
    )  # fmt: skip


def _static_error(skin: Skin) -> float:
    """Of a curve of the fifth order from reading to force, N."""
    z, F = (np.concatenate(part) for part in (skin.taught.reading, skin.taught.force))
    curve = np.polynomial.Polynomial.fit(z, F, 5)
    return skin.rms([curve(z) for z in skin.loops.reading])
