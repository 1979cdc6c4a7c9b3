"""What Tsuji et al. (2014) print, and how a virtual rig measures each number."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ._armor import (
    OURS,
    WORN,
    Rig,
    body_errors,
    changed,
    linear_range,
    nonlinearity,
    surface_errors,
)
from ._published import PREDICTED, TUNED, Measure, Published, finding

STAGE = "A foam in layers, one block for all rigs, read by a stage with 0.05 mm of noise."
SHEET = "The sheet around the probe is stiffer than a block, by one factor for these three numbers."
BODY = "The sensor's ratings, gauges and mounting are assumed: the paper prints 1 % of its ratings alone."


def _body(method: str) -> Measure:
    return lambda rig, ours: float(np.mean(body_errors(rig, OURS if ours else method)))


def _surface(name: str) -> Measure:
    return lambda rig, ours: float(np.mean(surface_errors(rig, OURS if ours else name)))


def _largest(rig: Rig, ours: bool) -> float:
    return max(float(np.max(surface_errors(rig, k))) for k in ((OURS,) if ours else "123"))


SPONGE, EVALUATION, WHOLE, AGING = (
    "Soft material characteristics", "Evaluation of compensation", "Whole-body tactile sensing",
    "Evaluation of aging",
)  # fmt: skip
"""The paper's sections in which the numbers are printed."""

PUBLISHED = (
    Published("mean_gap", "mean gap between the branches at one force", SPONGE, "mm", 3.93, 0.005,
              lambda rig, _: rig.fresh.statistics().mean_gap, TUNED,
              f"{STAGE} Mean over 2 to 18 N; the paper does not say over which forces."),
    Published("largest_gap", "largest gap", SPONGE, "mm", 5.67, 0.005,
              lambda rig, _: rig.fresh.statistics().largest_gap, TUNED,
              "The largest of noisy readings lies above that of the curve."),
    Published("largest_gap_force", "force of the largest gap", SPONGE, "N", 8.0, 1.0,
              lambda rig, _: rig.fresh.statistics().largest_gap_force, TUNED,
              "Where the gap is flat, noise picks the force."),
    Published("largest_gap_test", "test of the largest gap", SPONGE, "1", 1.0, 0.5,
              lambda rig, _: float(rig.fresh.statistics().largest_gap_cycle), TUNED, STAGE),
    Published("linear_limit", "end of the linear range", SPONGE, "N", 25.0, 1.0,
              lambda rig, _: linear_range(rig.to_40).limit, TUNED,
              "Here where the mean leaves the line by more than its bar; the paper read it off fig 7."),
    Published("aged_K", "K after six months, approximation 2", AGING, "mm/N", 1.298, 0.0005,
              lambda rig, _: rig.aged.statistics().both.K, TUNED,
              "The values of the aged sponge, taken for the fresh one: table 1 is not available."),
    Published("aged_b", "b after six months, approximation 2", AGING, "mm", 6.186, 0.0005,
              lambda rig, _: rig.aged.statistics().both.b, TUNED,
              "The values of the aged sponge, taken for the fresh one: table 1 is not available."),
    Published("error_1", "error in z, approximation 1", EVALUATION, "mm", 1.7, 0.05, _surface("1"),
              TUNED, SHEET, both=True),
    Published("error_2", "error in z, approximation 2", EVALUATION, "mm", 3.3, 0.05, _surface("2"),
              TUNED, SHEET, both=True),
    Published("error_3", "error in z, approximation 3", EVALUATION, "mm", 4.7, 0.05, _surface("3"),
              TUNED, SHEET, both=True),
    Published("error_largest", "largest error of all of them", EVALUATION, "mm", 10.0, 0.0,
              _largest, PREDICTED,
              "Unevenness of the cover and the hand is one normal number for each press.",
              at_most=True, both=True),
    Published("body_a", "error of 45 points, (a) soft, uncompensated", WHOLE, "mm", 27.2, 0.05,
              _body("a"), PREDICTED, BODY),
    Published("body_b", "error of 45 points, (b) soft, approximation 2", WHOLE, "mm", 16.3, 0.05,
              _body("b"), PREDICTED, BODY, both=True),
    Published("body_c", "error of 45 points, (c) rigid", WHOLE, "mm", 13.2, 0.05, _body("c"), TUNED,
              "Ratings, jig and mounting of a strain-gauge sensor were chosen to give this number."),
)  # fmt: skip

STRONGLY = 1.5
"""Times the nonlinearity of the others from which that of a thin sponge is seen in a figure."""

MIDDLE = np.array([10, 29, 48, 67]) - 1
"""Rows of the 76 points that lie in the middle of the surface."""


def findings(rigs: Sequence[Rig]) -> list[dict[str, Any]]:
    """What the paper says in words, and whether the sentence is true of every or the mean rig."""
    changes = [changed(rig.fresh, rig.aged) for rig in rigs]
    seen = sum(change.p < 0.05 for change in changes)
    told = sum(changed(rig.fresh, rig.worn).p < 0.05 for rig in rigs)
    bent = {h: nonlinearity(rigs[0].of_thickness(h, noise=False)) for h in (50.0, 30.0, 10.0)}
    errors = [[float(np.mean(surface_errors(rig, k))) for k in "123"] for rig in rigs]
    first = [np.argmin(row) == 0 for row in errors]
    K, b = (2 * float(np.mean([getattr(c, f) for c in changes])) for f in ("K_error", "b_error"))
    around = np.array([surface_errors(rig, "1") for rig in rigs])
    middle, rest = around[:, MIDDLE].mean(1), np.delete(around, MIDDLE, axis=1).mean(1)
    more = middle - rest
    chance = float(np.std(more, ddof=1) / np.sqrt(len(rigs))) if len(rigs) > 1 else np.inf
    averages = np.mean(errors, axis=0)
    largest = np.array([_largest(rig, False) for rig in rigs])
    a, b_part, c = (
        100 * float(np.mean([body_errors(rig, k) for rig in rigs])) / rigs[0].width(k)
        for k in "abc"
    )
    return [
        finding(
            "After six months of use the basic property of the sponge did not change (fig 9).",
            f"Two records of a virtual sponge that does not age differ in {seen} of {len(rigs)} rigs at "
            f"the level of 5 %, which chance does in {0.05 * len(rigs):.2g}. Of one that has lost "
            f"{100 * WORN:.0f} % of its struts they differ in {told} of {len(rigs)}. A change of "
            f"{K:.2g} mm/N in K or of {b:.2g} mm in b would have been seen.",
            seen <= 0.05 * len(rigs) + 2 * np.sqrt(0.05 * 0.95 * len(rigs)) and told == len(rigs),
        ),
        finding(
            "Sponges of 50 and 30 mm are more linear than one of 10 mm, with strong nonlinearity (fig 10).",
            "Without reading noise the first loading leaves its line by "
            + ", ".join(f"{x:.2f} % at {h:g} mm" for h, x in bent.items())
            + f" of its range. Strongly is taken for {STRONGLY:g} times as much as the others.",
            bent[10.0] > STRONGLY * max(bent[50.0], bent[30.0]),
        ),
        finding(
            "The error is least with approximation 1, because the force increases (fig 12).",
            f"So it is in {sum(first)} of {len(rigs)} rigs.",
            all(first),
        ),
        finding(
            "Errors at points 10, 29, 48 and 67, in the middle of the surface, are ascribed to the frame, "
            "which deforms most there (fig 12).",
            f"Approximation 1 errs by {middle.mean():.1f} mm there and by {rest.mean():.1f} mm elsewhere: "
            f"a difference of {more.mean():.2f} mm with a standard error of {chance:.2f} mm.",
            more.mean() > 2 * chance,
        ),
        finding(
            "The average error of each approximation is below 5 mm, and no error above 10 mm (fig 12).",
            f"The averages are {', '.join(f'{x:.1f}' for x in averages)} mm in the mean over the rigs, "
            f"all below 5 mm in {sum(max(row) < 5 for row in errors)} of {len(rigs)}. The largest error "
            f"of a rig is {largest.mean():.1f} mm in the mean, and up to 10 mm in {sum(largest <= 10)}.",
            np.max(averages) < 5 and largest.mean() <= 10,
        ),
        finding(
            "Relative to the size of the shell, (b) and (c) differ quite little (fig 14).",
            f"The paper prints no relative errors. Its errors over 600 and 500 mm are 4.5, 2.7 and 2.6 %; "
            f"here they are {a:.2f}, {b_part:.2f} and {c:.2f} %. Quite little is taken for a quarter of "
            "what softness had cost in (a).",
            abs(b_part - c) < 0.25 * (a - c),
        ),
    ]
