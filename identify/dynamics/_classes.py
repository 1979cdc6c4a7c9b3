"""Which hysteresis an oscillator has: classes fitted one after the other, ranked by their evidence."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hysteresis import InputError
from hysteresis.dynamics._recorder import stages_of

from ._duhem_search import SIZES, refined, started
from ._linear_approximation import LinearApproximation
from ._measured_motion import MeasuredMotion
from ._output_error import Optimum, Setting, with_evidence
from ._plays_search import candidates

CLASSES = ("BoucWen", "Duhem", "GeneralizedPlays")

COARSER = 4
"""The search for a start takes so many times fewer steps of integration."""

FAR_FROM_ONE = 2.0
"""chi2 per row from which plays are tried from another start."""

TELLS = 20.0
"""Difference of chi2 by which one recorder explains a record better than another."""

STEADY, MOST_WARM = 12.0, 20
"""Time constants of the decay, of a quarter of the linear damping, before steady state."""


class Tried(NamedTuple):
    """A class and its best fit."""

    name: str
    found: Optimum

    @property
    def title(self) -> str:
        """The class with what sets it apart from others of its kind, such as how many knots it has."""
        own = self.found.family.words
        if self.name == "BoucWen":
            return self.name
        said = f"{self.name}, {own['knots']} knots"
        return said if own.get("symmetric", True) else f"{said}, not symmetric"

    @property
    def words(self) -> dict[str, object]:
        """Plain data for a file."""
        own = self.found
        return {
            "class": self.name,
            "chi2": own.chi,
            "effective_parameters": own.effective,
            "bic": own.bic,
            "deviations": list(own.deviations),
            **{k: v for k, v in own.family.words.items() if k != "first"},
        }


class Search(NamedTuple):
    """What a search ended with.

    - `tried`: every class, the best one first; of it the final fit. `chi2`: of every start.
    - `setting`: of the final fit.
    """

    tried: tuple[Tried, ...]
    setting: Setting
    chi2: tuple[float, ...]


def search(
    motion: MeasuredMotion,
    linear: LinearApproximation,
    hysteresis: str | None,
    *,
    oversampling: int = 20,
    starts: int = 32,
    seed: int = 0,
    say: Callable[[str], None] = lambda _: None,
) -> Search:
    """Fit the class `hysteresis`, or all of them where it is None, and take the one of greatest evidence.

    Raises `InputError` `fit-broke` where no start led to a motion that stays finite.
    """
    warm = periods_to_steady_state(motion, linear)
    coarse = Setting.of(motion, max(1, oversampling // COARSER), (), warm)
    tried: list[Tried] = []
    chi2: list[float] = []

    def note(name: str, found: Optimum) -> None:
        if not np.isfinite(found.chi):
            return
        tried.append(Tried(name, found))
        said = f"Oscillator({tried[-1].title}): chi2 per row {found.chi:.4g}"
        say(f"{said}, {found.effective:.0f} parameters")

    if hysteresis != "GeneralizedPlays":
        # Other classes are tried where the grid of starts does not do.
        best, chi2 = started(coarse, linear, starts if hysteresis == "BoucWen" else 0, seed)
        note("BoucWen", best)
        if hysteresis != "BoucWen" and np.isfinite(best.chi):
            _more_knots(coarse, best, note)
    explained = bool(tried) and min(one.found.chi for one in tried) < motion.explained
    if hysteresis == "GeneralizedPlays" or (hysteresis is None and not explained):
        for start in candidates(motion, linear):
            found = with_evidence(coarse, start.family, start.q)
            note("GeneralizedPlays", found)
            if found.chi < FAR_FROM_ONE:
                break
    if not tried:
        raise InputError(
            "fit-broke",
            "no oscillator with hysteresis follows this motion from any start.",
            cause="the record is too short, too noisy, or not that of a mass on a spring.",
            fix="measure a longer record about the resonance.",
        )
    order = sorted(tried, key=lambda one: one.found.bic)
    best = order[0]
    setting = _recorder(motion, best.found, oversampling, warm)
    final = _final(setting, best.found)
    say(f"Oscillator({best.name}): chi2 per row {final.chi:.4g} at {oversampling} steps a sample")
    return Search((Tried(best.name, final), *order[1:]), setting, tuple(chi2))


def _more_knots(coarse: Setting, best: Optimum, note: Callable[[str, Optimum], None]) -> None:
    """Duhem operators with more knots, equal for both directions and not, while the evidence rises."""
    for knots in SIZES:
        both = [refined(coarse, best, knots, symmetric) for symmetric in (True, False)]
        new = min(both, key=lambda one: one.bic)
        note("Duhem", new)
        if new.bic > best.bic:
            return
        best = new


def _final(setting: Setting, found: Optimum) -> Optimum:
    """The same fit in steps as fine as those of the model, its priors once more by the evidence."""
    steps, tolerance = (4, 1e-4) if found.family.groups else (15, 1e-7)
    return with_evidence(
        setting, found.family, found.q, deviations=found.deviations, rounds=2, steps=steps,
        tolerance=tolerance, damping=1e-6,
    )  # fmt: skip


def _recorder(motion: MeasuredMotion, found: Optimum, oversampling: int, warm: int) -> Setting:
    """The setting whose recorder explains the record best; decimation in stages unless the data tell."""
    stages = stages_of(oversampling)
    settings = [
        Setting.of(motion, oversampling, kept, warm)
        for kept in dict.fromkeys((stages, (), (oversampling,) if oversampling > 1 else ()))
    ]
    left = []
    for setting in settings:
        y, _ = setting.simulated(found.family, found.q, jacobian=False)
        off = motion.whitened(motion.displacement - y)
        left.append(float(off @ off) / motion.sigma**2)
    best = int(np.argmin(left))
    return settings[best] if left[best] < left[0] - TELLS * max(1.0, found.chi) else settings[0]


def periods_to_steady_state(
    motion: MeasuredMotion, linear: LinearApproximation, rows: int | None = None
) -> int:
    """How many periods, of the motion or of so many rows, pass from rest until the transient is gone."""
    rate = max(linear.damping, 0.0) / (8 * linear.mass)
    time = (rows or len(motion.force)) * motion.dt
    return int(np.clip(np.ceil(STEADY / max(rate * time, 1e-9)), 1, MOST_WARM))
