"""What Kim and Park (2018) print, and how a virtual skin measures each number."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from compensate.microchannel import Confusion
from identify import Trained

from ._published import (
    INFERRED,
    NOT_COMPARABLE,
    PREDICTED,
    TUNED,
    UNPRINTED,
    Measure,
    Published,
    finding,
)
from ._skin import DELAY, PLACES, Skin
from ._skin_pair import SkinPair, error, found_peaks, of_pair


class Laboratory(NamedTuple):
    """A virtual skin, and its experiments with two contacts where they are made."""

    skin: Skin
    pair: SkinPair | None


def _skin(measure: Callable[[Skin, bool], Any]) -> Measure:
    return lambda one, ours: float(measure(one.skin, ours))


def _pair(measure: Callable[[SkinPair, bool], Any]) -> Measure:
    return lambda one, ours: None if one.pair is None else float(measure(one.pair, ours))


def _network(skin: Skin, ours: bool) -> Trained:
    return (skin.network if ours else skin.timeless).trained


def _places(skin: Skin, ours: bool) -> Confusion:
    """By five nearest neighbours, or by ours."""
    return skin.likeliest if ours else skin.votes


def _taken(place: str, other: str) -> Measure:
    return _skin(
        lambda skin, ours: _places(skin, ours).counts[PLACES.index(place), PLACES.index(other)]
    )


SECTION_A, SECTION_B, SECTION_C, SECTION_D = "IV A", "IV B, table II", "IV C, table III", "IV D"
"""The paper's sections in which the numbers are printed."""

FINGER = "Placement, sensitivities and noise were chosen to give table II; another finger, one press each."
COLUMN = "The text of table II has lost its columns: that these presses were taken for this place is ours."
CREEP = "The virtual sensor creeps, and the Preisach transform has no time."
CURVE = "The paper shows a curve without numbers."
MACHINE = "The paper presses by finger; a machine always meets the middle of a place."
TWO = "Fingers as half sines, placed at random within a location; found: within 1 s, half to twice as high."
CORRECT = {"A": 20, "B": 18, "C": 20, "D": 15, "E": 20}

PUBLISHED = (
    Published("mse_start", "(A) mean square of the forces to learn", SECTION_A, "N^2", 20.07, 0.005,
              _skin(lambda skin, _: np.mean(np.square(skin.taught.force))), INFERRED,
              "Taken as the error of a network that says 0; the machine's range is inferred from it."),
    Published("mse_end", "(A) its error^2 at the last epoch", SECTION_A, "N^2", 0.003, 0.0005,
              _skin(lambda skin, ours: _network(skin, ours).train[-1]), PREDICTED, CREEP, both=True),
    Published("training", "(A) training", SECTION_A, "s", 331.0, 0.5,
              _skin(lambda skin, ours: _network(skin, ours).seconds), NOT_COMPARABLE,
              "Another computer: this row says nothing about the sensor.", judged=False, both=True),
    Published("loops", "(A) force of four loops", "fig 6, no number", "N", None, 0.0,
              _skin(lambda skin, ours: skin.rms(skin.by_network if ours else skin.by_timeless)),
              UNPRINTED, CURVE, both=True),
    *(Published(f"right_{place}", f"(B) presses of {place} found, of 20", SECTION_B, "1", float(n), 0.0,
                _taken(place, place), TUNED, FINGER, repeats=20, both=True)
      for place, n in CORRECT.items()),
    Published("accuracy", "(B) all presses found", SECTION_B, "%", 93.0, 0.5,
              _skin(lambda skin, ours: 100 * _places(skin, ours).accuracy), TUNED, FINGER, repeats=100,
              percent=True, both=True),
    Published("b_for_c", "(B) presses of B taken for C", SECTION_B, "1", 2.0, 0.0,
              _taken("B", "C"), INFERRED, COLUMN, repeats=20, both=True),
    Published("d_for_e", "(B) presses of D taken for E", SECTION_B, "1", 5.0, 0.0,
              _taken("D", "E"), INFERRED, COLUMN, repeats=20, both=True),
    Published("logic", "(C) presses of several places found, of 21", SECTION_C, "1", 21.0, 0.0,
              _skin(lambda skin, _: sum(p == found for p, found in skin.decisions)), PREDICTED,
              "All fingers press with 4 N, which the table knows; the paper's forces are not printed.",
              repeats=21),
    Published("logic_unequal", "(C) the same with unequal, unknown forces", "not in the paper", "1", None,
              0.0, _skin(lambda skin, _: sum(p == found for p, found in skin.unequal)), UNPRINTED,
              "Each finger presses with 1.5 to 8 N; scatter is learnt from 60 presses with a gauge."),
    Published("logic_ranks", "(C) the same by the published ranks", "table I, no such test", "1", None,
              0.0, _skin(lambda skin, _: sum(p == found for p, found in skin.by_ranks)), UNPRINTED,
              "The nearest sums of the ranks 3, 2 and 1, the reading of one rank at 4 N known."),
    Published("peaks", "(D) peaks of two fingers found, of 16", SECTION_D, "1", 16.0, 0.0,
              _pair(lambda pair, ours: found_peaks(pair.together, ours)), PREDICTED, TWO, repeats=16,
              both=True),
    Published("peaks_placed", "(D) peaks of a machine's presses, of 16", "not in the paper", "1", None, 0.0,
              _pair(lambda pair, ours: found_peaks(pair.placed, ours)), UNPRINTED,
              MACHINE, both=True),
    Published("alone", "(D) force of one finger, on B and on D", "not in the paper", "N", None, 0.0,
              _pair(lambda pair, ours: np.mean([error(one, ours) for one in pair.alone])), UNPRINTED, TWO,
              both=True),
    Published("together", "(D) force of two fingers", "fig 8, no number", "N", None, 0.0,
              _pair(lambda pair, ours: error(pair.together, ours)), UNPRINTED, TWO, both=True),
    Published("placed", "(D) force of a machine's two presses", "not in the paper", "N", None, 0.0,
              _pair(lambda pair, ours: error(pair.placed, ours)), UNPRINTED,
              MACHINE, both=True),
    Published("step", "(D) time of a reading", "not in the paper", "us", None, 0.0,
              _pair(lambda pair, ours: pair.ours_us if ours else pair.paper_us), UNPRINTED,
              "The published search as we wrote it, on this computer.", both=True),
)  # fmt: skip


def findings(laboratories: Sequence[Laboratory], with_ours: bool) -> list[dict[str, Any]]:
    """What the paper says in words, and whether the sentence is true of all virtual sensors."""
    skins = [one.skin for one in laboratories]
    pairs = [one.pair for one in laboratories if one.pair is not None]
    network = float(np.mean([skin.rms(skin.by_timeless) for skin in skins]))
    curve = float(np.mean([static_error(skin) for skin in skins]))
    wrong = np.array([20 - np.diag(skin.votes.counts[:, :5]) for skin in skins])
    sound = sum(all(p == found for p, found in skin.decisions) for skin in skins)
    late = np.array([peak.late for pair in pairs for peak in of_pair(pair.together)])
    missed, late = int(np.isnan(late).sum()), late[np.isfinite(late)]
    together = float(np.mean([error(pair.together) for pair in pairs]))
    said = [
        finding(
            "The relationship of force and voltage can be expressed with a fully connected network, "
            "although the data depend on history (IV A).",
            f"It errs by {network:.3f} N on unseen loops, a curve of the fifth order without any history "
            f"by {curve:.3f} N. Expressed is taken for half of that.",
            network < 0.5 * curve,
        ),
        finding(
            "There are no errors at A, C and E, and small errors at B and D (IV B).",
            "Not found, of 20, in the mean of the sensors: "
            + ", ".join(f"{p} {n:.2g}" for p, n in zip(PLACES, wrong.mean(axis=0), strict=True))
            + ".",
            not wrong[:, [0, 2, 4]].any() and wrong[:, [1, 3]].any(),
        ),
        finding(
            "There is no false estimate of any combination of places (IV C).",
            f"So it is with {sound} of {len(skins)} sensors.",
            sound == len(skins),
        ),
        finding(
            "All 16 peaks are detected, some of them early and some late (IV D).",
            f"Missed: {missed} of {missed + len(late)} peaks. Those found are from "
            f"{-1e3 * late.min():.0f} ms early to {1e3 * late.max():.0f} ms late, "
            f"{1e3 * late.mean():.0f} ms late in the mean.",
            not missed and late.min() < 0 < late.max(),
        ),
        finding(
            "Accurate force estimation of several contacts is not easy in this method (IV D).",
            f"It errs by {together:.2f} N with two fingers, the network of one contact by {network:.3f} N.",
            together > network,
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
    said[-1]["reproduced"] += (
        f" Ours err {ours['together']:.2f} times as much with two fingers, whose places within a "
        f"location nobody knows, and {ours['placed']:.2f} times with a machine's contacts; the published "
        f"search takes {steps[0] / steps[1]:.0f} times as long."
    )
    said[0]["reproduced"] += (
        f" Ours errs by {after:.3f} N if it may answer {DELAY} readings later: a filter through a network "
        "of the sensor."
    )
    return said


def static_error(skin: Skin) -> float:
    """Of a curve of the fifth order from reading to force, N."""
    z, F = (np.concatenate(part) for part in (skin.taught.reading, skin.taught.force))
    curve = np.polynomial.Polynomial.fit(z, F, 5)
    return skin.rms([curve(z) for z in skin.loops.reading])
