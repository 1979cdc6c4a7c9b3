"""Which hysteresis an oscillator has: classes fitted one after the other, ranked by their evidence."""

from collections.abc import Callable

import numpy as np

from hysteresis import InputError
from hysteresis.dynamics._recorder import stages_of

from .._levels import NOTHING, SURE
from ._duhem_search import SIZES, refined, started
from ._linear_approximation import LinearApproximation
from ._measured_motion import MeasuredMotion
from ._output_error import Optimum, Setting, levenberg_marquardt
from ._plays_search import candidates

CLASSES = ("BoucWen", "Duhem", "GeneralizedPlays")

COARSER = 4
"""The search for a start takes so many times fewer steps of integration."""

FAR_FROM_ONE = 2.0
"""chi2 per row from which plays are tried from another start."""

MOST_WARM = 20
"""Periods before steady state, at most."""


def search(
    motion: MeasuredMotion,
    linear: LinearApproximation,
    hysteresis: str | None,
    *,
    oversampling: int = 20,
    starts: int = 32,
    seed: int = 0,
    say: Callable[[str], None] = lambda _: None,
) -> tuple[list[Optimum], list[float]]:
    """Fit the class `hysteresis`, or all of them where it is None, and take the one of greatest evidence.

    **Returns:** every class, the best one first, of which the final fit; chi2 of every start.

    Raises `InputError` `fit-broke` where no start led to a motion that stays finite.
    """
    warm = periods_to_steady_state(motion, linear)
    coarse = Setting.of(motion, max(1, oversampling // COARSER), (), warm)
    tried: list[Optimum] = []
    chi2: list[float] = []

    def note(found: Optimum) -> None:
        if np.isfinite(found.chi):
            tried.append(found)
            said = f"Oscillator({found.title}): chi2 per row {found.chi:.4g}"
            say(f"{said}, {found.effective:.0f} parameters")

    if hysteresis != "GeneralizedPlays":
        # Other classes are tried where the grid of starts does not do.
        best, chi2 = started(coarse, linear, starts if hysteresis == "BoucWen" else 0, seed)
        note(best)
        if hysteresis != "BoucWen" and np.isfinite(best.chi):
            _more_knots(coarse, best, note)
    explained = bool(tried) and min(one.chi for one in tried) < motion.explained
    if hysteresis == "GeneralizedPlays" or (hysteresis is None and not explained):
        for _, family, q in candidates(motion, linear):
            found = levenberg_marquardt(coarse, family, q, rounds=3, steps=8)
            note(found)
            if found.chi < FAR_FROM_ONE:
                break
    if not tried:
        raise InputError(
            "fit-broke",
            "no oscillator with hysteresis follows this motion from any start.",
            cause="the record is too short, too noisy, or not that of a mass on a spring.",
            fix="measure a longer record about the resonance.",
        )
    best, *others = sorted(tried, key=lambda one: one.bic)
    setting = _recorder(motion, best, oversampling, warm)
    # Steps as fine as those of the model, and its priors once more by the evidence.
    steps, tolerance = (4, 1e-4) if best.family.groups else (15, 1e-7)
    final = levenberg_marquardt(
        setting, best.family, best.q, deviations=best.deviations, rounds=2, steps=steps,
        tolerance=tolerance, damping=1e-6,
    )  # fmt: skip
    say(f"Oscillator({best.name}): chi2 per row {final.chi:.4g} at {oversampling} steps a sample")
    return [final, *others], chi2


def _more_knots(coarse: Setting, best: Optimum, note: Callable[[Optimum], None]) -> None:
    """Duhem operators with more knots, equal for both directions and not, while the evidence rises."""
    for knots in SIZES:
        both = [refined(coarse, best, knots, symmetric) for symmetric in (True, False)]
        new = min(both, key=lambda one: one.bic)
        note(new)
        if new.bic > best.bic:
            return
        best = new


def _recorder(motion: MeasuredMotion, found: Optimum, oversampling: int, warm: int) -> Setting:
    """The setting whose recorder explains the record best; decimation in stages unless the data tell."""
    ways = dict.fromkeys((stages_of(oversampling), (), (oversampling,)))
    settings = [Setting.of(motion, oversampling, stages, warm) for stages in ways]
    left = []
    for setting in settings:
        y, _ = setting.simulated(found.family, found.q, jacobian=False)
        off = motion.whitened(motion.displacement - y)
        left.append(float(off @ off) / motion.sigma**2)
    best = int(np.argmin(left))
    return settings[best] if left[best] < left[0] - SURE**2 * max(1.0, found.chi) else settings[0]


def periods_to_steady_state(
    motion: MeasuredMotion, linear: LinearApproximation, rows: int | None = None
) -> int:
    """How many periods, of the motion or of so many rows, pass from rest until the transient is gone, which
    decays by a quarter of the linear damping."""
    rate = max(linear.damping, 0.0) / (8 * linear.mass)
    time = (rows or len(motion.force)) * motion.dt
    return int(np.clip(np.ceil(-np.log(NOTHING) / max(rate * time, 1e-9)), 1, MOST_WARM))
