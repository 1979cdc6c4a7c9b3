"""What Kim and Park (2018) print, and how a virtual skin measures each number."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from compensate.microchannel import Confusion

from ._published import Measure, Published, finding
from ._skin import DELAY, PLACES, Skin
from ._skin_pair import Peak, Pressed, SkinPair, error, found_peaks, peaks


class Laboratory(NamedTuple):
    """A virtual skin, and its experiments with two contacts where they are made."""

    skin: Skin
    pair: SkinPair | None


def _skin(measure: Callable[[Skin], Any]) -> Measure:
    return lambda one: float(measure(one.skin))


def _pair(measure: Callable[[SkinPair], Any]) -> Measure:
    return lambda one: None if one.pair is None else float(measure(one.pair))


def _right(place: str, by: Callable[[Skin], Confusion]) -> Measure:
    k = PLACES.index(place)
    return _skin(lambda skin: by(skin).counts[k, k])


def _taken(place: str, other: str, by: Callable[[Skin], Confusion]) -> Measure:
    return _skin(lambda skin: by(skin).counts[PLACES.index(place), PLACES.index(other)])


def votes(skin: Skin) -> Confusion:
    """By five nearest neighbours."""
    return skin.votes


def likeliest(skin: Skin) -> Confusion:
    """By ours."""
    return skin.likeliest


FINGER = (
    "Fingers miss the middle of a place, by as much as gives the paper's 93 % together; how that falls on "
    "the five places is the virtual sensor's own."
)
NO_TIME = (
    "The Preisach transform has no time, and the virtual sensor creeps: what is left is the creep."
)
OTHER_FORCES = (
    "It is the mean square of the forces, if an untrained network says 0. Those of the virtual machine lie "
    "more often in the middle than even ones from 0 to 7.8 N."
)
PEAK = "A peak is found where an estimated one is within a second, and half to twice as high."
CORRECT = {"A": 20, "B": 18, "C": 20, "D": 15, "E": 20}

PUBLISHED = (
    Published("mse_start", "(A) mean square of the forces to learn", "IV A", "N^2", 20.07, 0.005,
              _skin(lambda skin: np.mean(np.square(skin.taught.force))), OTHER_FORCES),
    Published("mse_end", "(A) its error^2 at the last epoch", "IV A", "N^2", 0.003, 0.0005,
              _skin(lambda skin: skin.timeless.trained.train[-1]), NO_TIME),
    Published("training", "(A) training", "IV A", "s", 331.0, 0.5,
              _skin(lambda skin: skin.timeless.trained.seconds), at_most=True),
    Published("loops", "(A) force of four loops", "fig 6", "N", None, 0.0,
              _skin(lambda skin: skin.rms(skin.by_timeless))),
    *(Published(f"right_{place}", f"(B) presses of {place} found, of 20", "table II", "1", float(n), 0.0,
                _right(place, votes), FINGER) for place, n in CORRECT.items()),
    Published("accuracy", "(B) all presses found", "table II", "%", 93.0, 0.5,
              _skin(lambda skin: 100 * skin.votes.accuracy), FINGER),
    Published("b_for_c", "(B) presses of B taken for C", "table II", "1", 2.0, 0.0,
              _taken("B", "C", votes), FINGER),
    Published("d_for_e", "(B) presses of D taken for E", "table II", "1", 5.0, 0.0,
              _taken("D", "E", votes), FINGER),
    Published("logic", "(C) presses of several places found, of 21", "table III", "1", 21.0, 0.0,
              _skin(lambda skin: sum(p == found.places for p, found in skin.decisions)),
              "Two fingers off their middles at once can look like another combination."),
    Published("peaks", "(D) peaks of two fingers found, of 16", "fig 8", "1", 16.0, 0.0,
              _pair(lambda pair: found_peaks(pair.together)),
              PEAK),
    Published("peaks_placed", "(D) peaks of a machine's presses, of 16", "fig 8", "1", 16.0, 0.0,
              _pair(lambda pair: found_peaks(pair.placed)), PEAK),
    Published("alone", "(D) force of one finger, on B and on D", "IV D", "N", None, 0.0,
              _pair(lambda pair: np.mean([error(one) for one in pair.alone]))),
    Published("together", "(D) force of two fingers", "fig 8", "N", None, 0.0,
              _pair(lambda pair: error(pair.together))),
    Published("placed", "(D) force of a machine's two presses", "fig 8", "N", None, 0.0,
              _pair(lambda pair: error(pair.placed))),
    Published("step", "(D) time of a reading", "III D", "us", None, 0.0,
              _pair(lambda pair: pair.paper_us)),
)  # fmt: skip

BETTER: dict[str, Measure] = {
    "mse_end": _skin(lambda skin: skin.network.trained.train[-1]),
    "training": _skin(lambda skin: skin.network.trained.seconds),
    "loops": _skin(lambda skin: skin.rms(skin.by_network)),
    **{f"right_{place}": _right(place, likeliest) for place in PLACES},
    "accuracy": _skin(lambda skin: 100 * skin.likeliest.accuracy),
    "b_for_c": _taken("B", "C", likeliest),
    "d_for_e": _taken("D", "E", likeliest),
    "peaks": _pair(lambda pair: found_peaks(pair.together, ours=True)),
    "peaks_placed": _pair(lambda pair: found_peaks(pair.placed, ours=True)),
    "alone": _pair(lambda pair: np.mean([error(one, ours=True) for one in pair.alone])),
    "together": _pair(lambda pair: error(pair.together, ours=True)),
    "placed": _pair(lambda pair: error(pair.placed, ours=True)),
    "step": _pair(lambda pair: pair.ours_us),
}
"""What our method makes of a number: its key -> the same number by it, of one laboratory."""


def findings(laboratories: Sequence[Laboratory], with_ours: bool) -> list[dict[str, Any]]:
    """What the paper says in words, and whether it holds here."""
    skins = [one.skin for one in laboratories]
    pairs = [one.pair for one in laboratories if one.pair is not None]
    network = float(np.mean([skin.rms(skin.by_timeless) for skin in skins]))
    curve = float(np.mean([static_error(skin) for skin in skins]))
    wrong = np.mean([20 - np.diag(skin.votes.counts[:, :5]) for skin in skins], axis=0)
    sound = sum(all(p == found.places for p, found in skin.decisions) for skin in skins)
    alone = float(np.mean([error(one) for pair in pairs for one in pair.alone]))
    late = np.array([peak.late for pair in pairs for peak in of_pair(pair.together)])
    late = late[np.isfinite(late)]
    together = float(np.mean([error(pair.together) for pair in pairs]))
    said = [
        finding(
            "A fully connected network expresses force and voltage although they depend on history.",
            f"It errs by {network:.3f} N on unseen loops, a curve of the fifth order without any history "
            f"by {curve:.3f} N.",
            network < 0.5 * curve,
        ),
        finding(
            "All presses of A, C and E are found, some of B and D are not.",
            "Not found, of 20: "
            + ", ".join(f"{place} {n:.2g}" for place, n in zip(PLACES, wrong, strict=True))
            + ".",
            wrong[[0, 2, 4]].max() < wrong[[1, 3]].min(),
        ),
        finding(
            "The logic makes no false estimate.",
            f"So with {sound} of {len(skins)} sensors.",
            2 * sound > len(skins),
        ),
        finding(
            "The recurrent networks work for single presses of B and D.",
            f"They err by {alone:.2f} N, with two fingers at once by {together:.2f} N.",
            alone < together,
        ),
        finding(
            "Peaks at both places are found, some of them early and some late.",
            f"Estimated peaks are from {-1e3 * late.min():.0f} ms early to {1e3 * late.max():.0f} ms late, "
            f"{1e3 * late.mean():.0f} ms late in the mean.",
            late.min() < 0 < late.max(),
        ),
    ]  # fmt: skip
    if not with_ours:
        return said
    ours = {
        name: np.mean(
            [error(getattr(pair, name), True) / error(getattr(pair, name)) for pair in pairs]
        )
        for name in ("together", "placed")
    }
    after = float(np.mean([skin.rms_late for skin in skins]))
    steps = np.mean([(pair.paper_us, pair.ours_us) for pair in pairs], axis=0)
    return [
        *said,
        finding(
            "Accurate forces of two contacts are not easy in this way.",
            f"Ours err {ours['together']:.2f} times as much with two fingers, whose places within a "
            f"location nobody knows, and {ours['placed']:.2f} times with a machine's contacts; a reading "
            f"takes {steps[0] / steps[1]:.0f} times less.",
            ours["placed"] < 0.5,
        ),
        finding(
            "A network of a single contact suits control in real time better than a recurrent one.",
            f"Ours needs one pass of 25 and 12 units a reading. What is told {DELAY} readings later, by a "
            f"filter through a network of the sensor, errs by {after:.3f} N.",
            after < network,
        ),
    ]


def of_pair(pressed: Pressed, ours: bool = False) -> list[Peak]:
    """True peaks beside the paper's estimates, or ours."""
    return peaks(pressed.truth, pressed.ours if ours else pressed.paper)


def static_error(skin: Skin) -> float:
    """Of a curve of the fifth order from reading to force, N."""
    z, F = (np.concatenate(part) for part in (skin.taught.reading, skin.taught.force))
    curve = np.polynomial.Polynomial.fit(z, F, 5)
    return skin.rms([curve(z) for z in skin.loops.reading])
