"""What the fitted parameters hang on: the first cycle, outliers, any one cycle."""

from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from hysteresis import Note
from hysteresis._parameter import ParameterInfo
from hysteresis._verdict import warning

from .._levels import CHANCE, FACTOR, GROUPS, MUCH, NOTHING
from ..parameters._settings import numbers_of
from ..parameters._transform import transform_for
from ..posterior._log_posterior import Target, likeliest_near, target
from ..records._new_record import predict
from ..results._fit_result import FitResult
from ..results._repeatability import cycles_or_sequences
from ._profile_likelihood import solve
from ._whiteness import innovations

SHORT = 10
"""Rows of a sequence that is no cycle of its own."""


class Without(NamedTuple):
    """The fit without some of its rows.

    - `said`: which. `rows`: how many. `values` (parameters,): in their units.
    - `changes` (parameters,): in standard errors, NaN for a parameter that has none. `expected`: what
      chance alone would make of that, sqrt(f / (1 - f)) for the fraction f of the rows.
    """

    said: str
    rows: int
    values: Float[np.ndarray, " parameters"]
    changes: Float[np.ndarray, " parameters"]
    expected: float

    @property
    def most(self) -> float:
        """The largest change."""
        return float(np.nan_to_num(np.abs(self.changes)).max(initial=0.0))

    @property
    def clear(self) -> bool:
        """Whether a parameter moves by more than chance, and by more than two errors."""
        return self.most > max(3 * self.expected, 2.0)


class Sensitivity(NamedTuple):
    """Parameters of the fit, and what they are without some rows."""

    names: tuple[str, ...]
    cases: tuple[Without, ...]

    @property
    def said(self) -> tuple[str, ...]:
        """The cases that matter, in words."""
        found = []
        for case in self.cases:
            if case.clear:
                k = int(np.nanargmax(np.abs(case.changes)))
                found.append(
                    f"Without {case.said}, {self.names[k]} moves by {case.most:.1f} standard errors to"
                    f" {case.values[k]:.4g}."
                )
        if not self.cases:
            return ("One cycle, so nothing can be left out.",)
        most = max(case.most for case in self.cases)
        calm = (
            f"No cycle, and no outlier, moves a parameter beyond chance ({most:.1f} standard errors"
            " at most)."
        )
        return tuple(found) or (calm,)


def sensitivity(fit: FitResult) -> Sensitivity:
    """The likelihood's maximum without the first cycle, without each cycle in turn, and without rows that
    are farther off than chance puts any in one of a hundred records. Sequences stand for cycles where there
    are several.

    Rows left out are not scored, but still drive the model and the noise. Each case is sought from the
    optimum by Newton's method; that takes a few steps.

    **Example:**

        >>> found = identify.sensitivity(fit)
        >>> [case.said for case in found.cases]
        ['the first cycle', 'cycle 2', 'cycle 3', 'cycle 4']
    """
    aim, used = target(fit), fit.used
    names = tuple(p.name for p in fit.parameters if p.name in aim.names)
    at = [aim.names.index(name) for name in names]
    error = np.array([p.stderr or np.nan for p in fit.parameters if p.name in aim.names], float)

    def values(scored: np.ndarray) -> np.ndarray:
        weights = jnp.asarray(scored.astype(float))
        everything = jnp.ones(len(aim.names), bool)
        found = likeliest_near(aim, aim.start, everything, weights)
        return aim.values(np.asarray(found.point))[at]

    whole, cases = values(used), []
    for said, left_out in _cases(fit):
        found = values(used & ~left_out)
        share = float((used & left_out).sum() / used.sum())
        chance = float(np.sqrt(share / (1 - share)))
        rows = int((used & left_out).sum())
        cases.append(Without(said, rows, found, (found - whole) / error, chance))
    return Sensitivity(names, tuple(cases))


def _cases(fit: FitResult) -> Iterator[tuple[str, np.ndarray]]:
    """What is left out, and those rows."""
    record, used = fit.train, fit.used
    kind = "sequence" if len(record.labels) > 1 else "cycle"
    labels, which = cycles_or_sequences(record)
    counts = np.bincount(which[used])
    numbers = [n for n in range(1, len(counts)) if counts[n] > SHORT]
    if len(numbers) > 1:
        groups = np.array_split(numbers, min(len(numbers), GROUPS))
        for group in groups:
            names = [labels[n].removeprefix("cycle ") for n in group]
            first = group[0] == numbers[0] and len(group) == 1
            said = f"the first {kind}" if first else f"{kind} {names[0]}"
            if len(group) > 1:
                said = f"{kind}s {names[0]} to {names[-1]}"
            yield said, np.isin(which, group)
    most = float(-scipy.special.ndtri(CHANCE / (2 * used.sum())))  # of so many normal deviations
    far = used & (np.abs(innovations(fit)) > most)
    if count := int(far.sum()):
        yield f"{count} row{'s'[: count > 1]} beyond {most:.2g} deviations", far


# Which combinations of parameters the data know, and which they leave open, in words.

FACTORS = (MUCH, 2.0, 10.0, 100.0, FACTOR)
"""By which the leading parameter of a direction is moved, until that shows."""

HARDLY = 0.5
"""Deviations of the noise, the root of twice the drop in log-likelihood, that hardly show."""


class Direction(NamedTuple):
    """A way to move parameters together that hardly shows in the output.

    - `moves`: value before and after, of each parameter that takes part; `effect`: root of twice the drop
      of the log-likelihood, in deviations of the noise.
    """

    moves: dict[str, tuple[float, float]]
    effect: float
    said: str


class Sloppiness(NamedTuple):
    """The Fisher information of a fit over the free space (logarithms of positive parameters).

    - `eigenvalues` (parameters,): falling; 1 / sqrt is the error along `vectors[:, k]`.
    - `condition`: the largest over the smallest, infinity where that is rounding.
    - `directions`: those that hardly show.
    """

    names: tuple[str, ...]
    eigenvalues: Float[np.ndarray, " parameters"]
    vectors: Float[np.ndarray, "parameters parameters"]
    condition: float
    directions: tuple[Direction, ...]

    @property
    def said(self) -> tuple[str, ...]:
        """All directions in words, or that there is none."""
        known = "Every combination of the parameters is known to better than a quarter."
        return tuple(d.said for d in self.directions) or (known,)


def sloppiness(fit: FitResult) -> Sloppiness:
    """Spectrum of the Fisher information J'J, J the derivative of the whitened residuals in the free
    numbers, and what the sloppy directions mean.

    Of a direction whose error allows a factor of 1.25 the leading parameter is moved, the others are
    optimised anew, and the largest factor is told whose drop in likelihood hardly shows. What would
    tell more is said only where the parameters' units show it: a viscosity needs other rates or holds.

    Raises `InputError` for a fit without free parameters.

    Source: Transtrum, Machta, Brown, Daniels, Myers, Sethna, Perspective: Sloppiness and emergent theories
    in physics, biology, and beyond, J. Chemical Physics 143 (2015).

    **Example:**

        >>> found = identify.sloppiness(fit)
        >>> found.names, round(found.condition)
        (('K', 'b'), 22)
    """
    aim = target(fit)
    infos = {name: info for name, info, _ in numbers_of(fit.model)}
    names = tuple(name for name in aim.names if name in infos)
    J = np.asarray(_jacobian(aim, aim.start))[:, : len(names)]
    size = 1.0 if fit.noise_model is None else float(np.sqrt(fit.noise_model.information))
    W = size * np.stack([innovations(fit, column) for column in J.T], axis=1)
    values, vectors = np.linalg.eigh(W.T @ W)
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    rounding = 1e-13 * values[0]
    directions: list[Direction] = []
    told: set[str] = set()
    for k in reversed(range(len(names))):
        if values[k] > 1 / np.log(FACTORS[0]) ** 2:
            break
        # Directions that are equally unknown come mixed: each parameter is told of once.
        lead = max(
            range(len(names)), key=lambda i, k=k: abs(vectors[i, k]) * (names[i] not in told)
        )
        if names[lead] in told:
            continue
        found = _direction(aim, lead, len(names), infos, bool(values[k] <= rounding))
        if found is not None:
            directions.append(found)
            told |= set(found.moves)
    condition = float(values[0] / values[-1]) if values[-1] > rounding else float("inf")
    return Sloppiness(names, values, vectors, condition, tuple(directions))


def without_effect(fit: FitResult, names: list[str]) -> list[Note]:
    """A note for each of these parameters whose doubling changes the output by less than a millionth of
    its range."""
    model, used = fit.model, fit.used
    bounds = transform_for(model, fit.train, fit.settings)
    said, flows = [], any("time" in info.unit.split() for _, info, _ in numbers_of(model))
    mend = "add a creep hold" if flows else "leave it out"
    output = predict(model, fit.train)[used]
    for name in names:
        if name not in bounds.names:  # a number of a spectrum, not of its model
            continue
        values = bounds.values(model)
        values[bounds.names.index(name)] *= 2
        doubled = predict(bounds.insert(model, jnp.asarray(values)), fit.train)[used]
        if np.abs(doubled - output).max() < NOTHING * (np.ptp(output) or 1.0):
            change = f"{name} changes the fit by < {NOTHING:g} of its range when doubled"
            said.append(warning("without-effect", f"{change}: fix it, or {mend}."))
    return said


@eqx.filter_jit
def _jacobian(aim: Target, point: Array) -> Array:
    return jax.jacfwd(aim.residuals)(point)


def _direction(
    aim: Target, lead: int, count: int, infos: dict[str, ParameterInfo], exact: bool
) -> Direction | None:
    """The largest move of a parameter that hardly shows while the others follow, either way."""
    start = np.asarray(aim.start)
    moves = np.arange(len(start)) != lead
    top = float(solve(aim, start, ~moves | moves).value)
    best, most = None, 0.0
    for way in (1.0, -1.0):
        before, here = start, start
        for factor in FACTORS:
            # On along the way of the last step.
            step = way * np.log(factor) - (here - start)[lead]
            gone = (here - before)[lead]
            begin = here + (here - before) * np.clip(step / gone, 0.0, 3.0) if gone else here
            found = solve(aim, np.where(moves, begin, here + step), moves)
            before, here = here, np.asarray(found.point)
            effect = np.sqrt(2 * max(top - float(found.value), 0.0))
            if not effect < HARDLY:
                break
            value = [float(aim.values(x)[lead]) for x in (start, here)]
            # At a bound a number may go on for ever without going anywhere.
            if factor > most and abs(value[1] - value[0]) > 1e-3 * abs(value[0]):
                best, most = _described(aim, here, count, infos, float(effect), exact), factor
    return best


def _described(
    aim: Target,
    free: np.ndarray,
    count: int,
    infos: dict[str, ParameterInfo],
    effect: float,
    exact: bool,
) -> Direction:
    start = np.asarray(aim.start)
    away = (free - start)[:count]
    # All that change by a tenth take part, however far the leading one goes.
    least = min(0.2 * float(np.abs(away).max()), 0.1)
    part = [int(i) for i in np.argsort(-np.abs(away)) if abs(away[i]) > least]
    before, after = aim.values(start), aim.values(free)
    moves = {aim.names[i]: (float(before[i]), float(after[i])) for i in part}
    names = list(moves)
    # The free number of a positive parameter is its logarithm.
    logs = [
        a * b > 0 and bool(np.isclose(abs(np.log(b / a)), abs(away[i])))
        for i, (a, b) in zip(part, moves.values(), strict=True)
    ]
    known = ""
    if len(part) == 2 and all(logs):
        one, other = away[part]
        if abs(abs(one) - abs(other)) < 0.1 * abs(one):
            sign = "/" if one * other > 0 else " × "
            known = f": only {names[0]}{sign}{names[1]} is known"
        else:
            known = ": only one combination of them is known"
    elif len(part) > 1:
        known = f": of the {len(part)} only combinations are known"
    changes = [_change(n, *moves[n], log) for n, log in zip(names, logs, strict=True)]
    said = changes[0]
    if len(changes) > 1:
        factors = [b / a for a, b in moves.values()]
        if all(logs) and np.ptp(np.log(factors)) < 0.1 and factors[0] > 1:
            both = "both" if len(names) == 2 else "all"
            said = f"{_listed(names)} can {both} be multiplied by {factors[0]:.4g}"
        else:
            said = f"{changes[0]} while {_listed([c.replace(' can be ', ' is ') for c in changes[1:]])}"
    said += f" with hardly a change in the output ({effect:.1g} noise deviations){known}."
    if any("time" in infos[name].unit.split() for name in names):
        said += " A creep hold, or cycles at another rate, would tell."
    elif exact and len(names) > 1:
        said += " Nothing in this record tells them apart: fix one of them."
    return Direction(moves, effect, said)


def _change(name: str, before: float, after: float, log: bool) -> str:
    if not log:
        return f"{name} can be moved from {before:.3g} to {after:.3g}"
    if after > before:
        return f"{name} can be multiplied by {after / before:.4g}"
    return f"{name} can be divided by {before / after:.4g}"


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
