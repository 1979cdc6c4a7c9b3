"""Blind estimate of the gains of two layers from readings in use, without known places or forces."""

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from hysteresis import InputError

PEAK, ANGLES = 0.05, 400
"""Part of the highest pile that counts as one; directions that are tried."""

LEAST = 100
"""Readings of pressed places."""


def gains_in_use(
    readings: ArrayLike, known: ArrayLike, *, pressed: float = 0.5, blur: float = 0.03
) -> Float[np.ndarray, "2 2"]:
    """Gains G of two places in two layers, from readings z = G s of both, with the places' signals s >= 0.

        direction of G_k: one of the outermost two directions of z in which readings accumulate

    A contact pushes and never pulls, so a reading of both places lies between their directions, and on one
    of them where that place is pressed alone. Independent component analysis needs independent signals;
    this method only needs each place to be pressed alone now and then.

    The readings do not tell which direction belongs to which place, nor how large the signal of 1 N is:
    order and lengths of the columns are those of `known`, such as the gains of another sensor of this kind.

    **Arguments:**

    - `readings`: z, (samples, 2) in V, zero at rest.
    - `known`: (layers, places), V per unit of signal.

    **Other arguments:**

    - `pressed`: readings shorter than this, in V, are ignored: use some ten times the noise.
    - `blur`: by how much directions are smoothed, 0.005 to 0.2 rad. A finger, which is placed anew for
      every press, needs more than a machine; places whose directions are close allow less.

    **Returns:** G, (layers, places).

    **Raises:** `InputError` for other shapes and numbers out of range, too few readings, and places that
    are never pressed alone.

    **Source:** the mixture to which Kim and Park (2018) would apply independent component analysis. This
    method uses only that signals are not negative, so that mixtures lie between single presses.

    **Example:**

        >>> one, none = np.linspace(0.0, 3.0, 100), np.zeros(100)
        >>> signals = np.column_stack([np.r_[one, none], np.r_[none, one]])
        >>> readings = signals @ np.array([[1.1, 0.5], [0.4, 1.1]]).T
        >>> compensate.internal.gains_in_use(readings, [[1.0, 0.6], [0.5, 1.0]]).round(2).tolist()
        [[1.05, 0.48], [0.38, 1.06]]
    """
    z, given = np.asarray(readings, float), np.asarray(known, float)
    if z.ndim != 2 or z.shape[1] != 2 or given.shape != (2, 2):
        raise InputError(
            "wrong-channels", f"readings of shape {z.shape} and gains of shape {given.shape}.",
            fix="give (samples, 2) and (2, 2): two layers, two places.",
        )  # fmt: skip
    if not (np.isfinite(given).all() and (given > 0).all()):
        raise InputError(
            "parameter-out-of-bounds",
            "known gains have to be above 0: a press makes every layer read more.",
        )
    if not (0 < pressed < np.inf and 0.005 <= blur <= 0.2):
        raise InputError(
            "bad-option", f"pressed = {pressed:g} V, blur = {blur:g} rad.",
            fix="give volts above 0, and 0.005 to 0.2 rad.",
        )  # fmt: skip
    z = z[np.isfinite(z).all(1)]
    strength = np.hypot(*z.T)
    used = strength > pressed
    if used.sum() < LEAST:
        raise InputError(
            "too-few-rows", f"{used.sum()} readings are above {pressed:g} V.",
            fix=f"give {LEAST} or more while the places are pressed, or a lower `pressed`.",
        )  # fmt: skip
    peaks = _piles(np.arctan2(z[used, 1], z[used, 0]), strength[used], blur)
    lengths, angles = np.hypot(*given), np.arctan2(given[1], given[0])
    if peaks[-1] - peaks[0] < np.ptp(angles) / 2:
        raise InputError(
            "no-excitation",
            f"the readings point {np.degrees(peaks[-1] - peaks[0]):.0f} degrees apart at most, the known "
            f"gains {np.degrees(np.ptp(angles)):.0f}.",
            cause="both places are always pressed together, or only one is pressed at all.",
            fix="press each place alone a few times.",
        )
    ends = peaks[[0, -1]][np.argsort(np.argsort(angles))]
    return lengths * np.array([np.cos(ends), np.sin(ends)])


def _piles(
    angle: Float[np.ndarray, " readings"], strength: Float[np.ndarray, " readings"], blur: float
) -> Float[np.ndarray, " piles"]:
    """Directions in which readings cluster, in rad from the first layer's axis, in ascending order."""
    # Blurred in bins, so that the work does not grow with bins times readings.
    edges = np.linspace(-np.pi / 4, 3 * np.pi / 4, 2 * ANGLES + 1)
    pile, _ = np.histogram(angle, edges, weights=strength)
    centre = (edges[1:] + edges[:-1]) / 2
    bin_width = edges[1] - edges[0]
    reach = int(4 * blur / bin_width)
    away = bin_width * np.arange(-reach, reach + 1)
    pile = np.convolve(pile, np.exp(-0.5 * (away / blur) ** 2), mode="same")
    inner = pile[1:-1]
    top = (inner > pile[:-2]) & (inner >= pile[2:]) & (inner > PEAK * pile.max())
    return centre[1:-1][top] if top.any() else centre[[int(pile.argmax())]]
