"""Profile likelihood: how far one parameter can go while all others make up for it."""

from collections.abc import Iterable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from hysteresis import InputError, Note
from hysteresis._format import ends
from hysteresis._verdict import warning

from .._levels import CONFIDENCE, NOTHING, STEPS
from ..parametric._multistart import BEST
from ..posterior._log_posterior import Maximum, Target, likeliest_near, target
from ..results._fit_result import FitResult

REACH = -float(np.log(NOTHING))
"""How far an end is sought in a logarithm; of an unbounded parameter a million times its scale."""

OTHERS = 1
"""Further maxima that profiles go out from, at most."""


class Profile(NamedTuple):
    """The profile likelihood of one parameter.

    - `values`, `drop` (points,): rising values in the parameter's unit, and by how much the logarithm of
      the likelihood, all others at their best, lies below the greatest there.
    - `best`: the value of the greatest. `others`: values of further maxima that are as good by chance.
    - `low`, `high`: where the drop is that of `level`; None where there is no such end.
    - `said`: the interval, or why it has no end.
    """

    name: str
    unit: str
    values: Float[np.ndarray, " points"]
    drop: Float[np.ndarray, " points"]
    best: float
    others: tuple[float, ...]
    low: float | None
    high: float | None
    level: float
    said: str

    @property
    def bound(self) -> float:
        """The drop at the interval's ends."""
        return bound_of(self.level)


class Point(NamedTuple):
    """All free numbers, those that moved at their best, and the drop there."""

    free: Float[np.ndarray, " numbers"]
    drop: float


def bound_of(level: float) -> float:
    """Half the quantile of chi-square with one degree of freedom."""
    return float(scipy.special.chdtri(1, 1 - level)) / 2


def profile(fit: FitResult, name: str, *, level: float = CONFIDENCE) -> Profile:
    """The profile likelihood of the parameter `name`, and the interval in which it drops by less than
    half the `level` quantile of chi-square with one degree of freedom.

    Unlike a symmetric error it follows the likelihood where that is bent, holds under any change of the
    parameter's scale, and has no end where the data give none. From the maximum it goes out both ways, the
    others carried on along their path and optimised anew at every point; an end is found as a root. Other
    maxima that the starts of the fit came to are gone out from in the same way.

    Raises `InputError` where the fit has no such free parameter.

    Source: Murphy, van der Vaart, On profile likelihood, J. American Statistical Association 95 (2000).

    **Example:**

        >>> slope = identify.profile(fit, "K")
        >>> f"{slope.low:.1f} to {slope.high:.1f} {slope.unit}"
        '1.2 to 1.4 mm / N'
    """
    (found,) = profiles(fit, (name,), level=level)
    return found


def profiles(
    fit: FitResult, names: Iterable[str] | None = None, *, level: float = CONFIDENCE
) -> tuple[Profile, ...]:
    """The profiles of several parameters, all those of the model unless named; see `profile`."""
    aim = target(fit)
    units = {p.name: p.unit for p in fit.parameters}
    asked = [n for n in aim.names if n in units] if names is None else list(names)
    for name in asked:
        if name not in aim.names:
            raise InputError(
                "unknown-parameter",
                f"the fit has no free parameter {name!r}; have {', '.join(aim.names)}.",
            )
    maxima = _maxima(fit, aim, bound_of(level))
    return tuple(
        _profile(aim, aim.names.index(name), units.get(name, "1"), maxima, level) for name in asked
    )


def another_minimum(fit: FitResult) -> tuple[Note, bool] | None:
    """A note where the starts of a fit came to other parameters that are as good by chance, and whether
    these are but its branches in other places; None where they did not.

    They have to differ by more than six standard errors in one that has an error, with a worse fit on the
    straight way between.
    """
    errors = {p.name: p.stderr for p in fit.parameters if p.stderr}
    if (starts := fit.starts) is None or not errors or not starts.objective[0]:
        return None  # nothing is as good as an exact fit
    aim = target(fit)
    names = aim.bounds.names
    behind = fit.noise.effective / 2 * np.log(starts.objective / starts.objective[0])
    noise = np.asarray(aim.start)[len(names) :]
    points = [np.append(free, noise) for free in starts.free[behind < bound_of(CONFIDENCE)]]
    values = np.array([aim.values(point)[: len(names)] for point in points])
    size = np.array([errors.get(name, np.inf) for name in names])
    for point, other in zip(points, values, strict=True):
        apart = np.abs(other - values[0]) > 6 * size
        if apart.any() and _drop_between(aim, points[0], point) > 0.1:
            break
    else:
        return None
    listed = ", ".join(
        f"{name} {other[k]:.3g} or {values[0][k]:.3g}" for k, name in enumerate(names) if apart[k]
    )
    if np.allclose(np.sort(other), np.sort(values[0]), rtol=0.05):
        said = "Two minima are one with its branches exchanged"
        said += f" ({listed}): each is known, not which is which."
        return warning("second-minimum", said), True
    said = f"Two minima fit equally well: {listed}. The data do not tell which."
    return warning("second-minimum", said), False


def solve(aim: Target, begin: np.ndarray, moves: np.ndarray) -> Maximum:
    """The likelihood's maximum near `begin` over the numbers that move."""
    everything = jnp.ones(len(aim.measured))
    return likeliest_near(aim, jnp.asarray(begin), jnp.asarray(moves), everything)


class _Maxima(NamedTuple):
    """The greatest maximum, the errors of its numbers, and other maxima as good by chance."""

    top: np.ndarray
    value: float
    errors: np.ndarray
    others: list[np.ndarray]


def _maxima(fit: FitResult, aim: Target, bound: float) -> _Maxima:
    """Maxima less than `bound` below the greatest.

    The starts of a fit are short runs on some of the rows; where they differ they are followed to their
    end.
    """
    everything = np.ones(len(aim.names), bool)
    begins = [np.asarray(aim.start)]
    if fit.starts is not None and fit.starts.free.shape[1] == len(aim.bounds.names):
        model = len(aim.bounds.names)
        good = fit.starts.objective <= 1.5 * fit.starts.objective[0]
        for free in fit.starts.free[good]:
            begin = np.append(free, begins[0][model:])
            if all(np.abs(begin - other).max() > 0.1 for other in begins):
                begins.append(begin)
    found = [solve(aim, begin, everything) for begin in begins[:BEST]]
    ends = [end for end in found if np.isfinite(end.value)]
    ends.sort(key=lambda end: -round(float(end.value), 6))  # the fit's own first among equals
    top, others = np.asarray(ends[0].point), []
    for end in ends[1:]:
        other = np.asarray(end.point)
        apart = all(_drop_between(aim, other, found) > 0.1 for found in (top, *others))
        if float(ends[0].value - end.value) < bound and apart and len(others) < OTHERS:
            others.append(other)
    values, vectors = np.linalg.eigh(np.asarray(ends[0].curvature))
    errors = np.sqrt((vectors**2 / np.maximum(values, 1e-2)).sum(1))
    return _Maxima(top, float(ends[0].value), errors, others)


def _drop_between(aim: Target, one: np.ndarray, other: np.ndarray) -> float:
    """How far the likelihood falls on the straight way from one maximum to another."""
    way = jnp.linspace(0.0, 1.0, 21)[:, None]
    values = np.asarray(
        _along(aim, jnp.asarray(one)[None] * (1 - way) + jnp.asarray(other)[None] * way)
    )
    return float(min(values[0], values[-1]) - np.nan_to_num(values, nan=-np.inf).min())


@eqx.filter_jit
def _along(aim: Target, points: Array) -> Array:
    # One after the other: side by side each would hold all rows.
    return jax.lax.map(aim.log_likelihood, points)


class _Sought(NamedTuple):
    """One parameter's profile while it is being made."""

    aim: Target
    index: int
    greatest: float
    bound: float

    def at(self, z: float, near: np.ndarray) -> Point:
        """The others at their best, sought from `near`."""
        moves = np.arange(len(near)) != self.index
        found = solve(self.aim, np.where(moves, near, z), moves)
        drop = self.greatest - float(found.value)
        return Point(np.asarray(found.point), drop if np.isfinite(drop) else np.inf)

    def walk(self, top: Point, way: int, reach: float, step: float) -> list[Point]:
        """Points from a maximum outwards until the drop is beyond the bound, or the reach ends.

        Steps aim at changes of the root of twice the drop, which is a straight line for a Gaussian
        likelihood, between a sixth and two thirds.
        """
        path, begin = [top], top.free[self.index]
        for _ in range(STEPS):
            last = path[-1]
            z = last.free[self.index] + way * step
            if abs(z - begin) > reach:
                break
            near = last.free
            if len(path) > 1:
                before = path[-2].free
                gone = last.free[self.index] - before[self.index]
                near = near + np.clip((near - before) * (way * step / gone), -1.0, 1.0)
            new = self.at(z, near)
            if not np.isfinite(new.drop):
                new = self.at(z, last.free)
            change = abs(np.sqrt(2 * max(new.drop, 0.0)) - np.sqrt(2 * max(last.drop, 0.0)))
            if change > 0.7 and step > 1e-5 and last.drop < self.bound:
                step /= 2
                continue
            path.append(new)
            if new.drop > 1.3 * self.bound:
                break
            if change < 0.15:
                step *= 2
        return path

    def end(self, path: list[Point]) -> Point | None:
        """Where a walk crosses the bound for the last time; None where it does not."""
        inside = [k for k, point in enumerate(path) if point.drop < self.bound]
        if inside[-1] == len(path) - 1:
            return None
        inner, outer = path[inside[-1]], path[inside[-1] + 1]

        def beyond(z: float) -> float:
            drop = self.at(z, inner.free).drop
            return np.sqrt(2 * max(drop, 0.0)) - np.sqrt(2 * self.bound)

        a, b = inner.free[self.index], outer.free[self.index]
        # On a rough likelihood the way back may lead elsewhere: the interval is then a step too wide.
        if not beyond(a) < 0 < beyond(b):
            return outer
        z: Any = scipy.optimize.brentq(beyond, a, b, xtol=1e-7 * abs(b - a))
        return self.at(z, inner.free)


def _profile(aim: Target, index: int, unit: str, maxima: _Maxima, level: float) -> Profile:
    sought = _Sought(aim, index, maxima.value, bound_of(level))
    value = partial(_value, aim, index)
    tops = [Point(maxima.top, 0.0)]
    tops += [sought.at(float(other[index]), other) for other in maxima.others]
    step = float(np.clip(0.3 * maxima.errors[index], 1e-5, 0.5))
    bent = _is_bent(aim, index, maxima.top)
    reach = REACH if bent else 1 / NOTHING
    points: list[Point] = []
    ends: dict[int, list[Point | None]] = {-1: [], 1: []}
    for each in tops:
        for way in ends:
            path = sought.walk(each, way, reach, step)
            end = sought.end(path)
            ends[way].append(end)
            points += path[1:] if end is None else [*path[1:], end]
    points = _lowest([*tops, *points], index)
    found: dict[int, float | None] = {}
    for way, candidates in ends.items():
        known = [value(end.free) for end in candidates if end is not None]
        found[way] = (max if way > 0 else min)(known) if len(known) == len(candidates) else None
    low, high = sorted((-1, 1), key=lambda way: value(points[0 if way < 0 else -1].free))
    values = np.array([value(point.free) for point in points])
    order = np.argsort(values)
    best, further = value(maxima.top), tuple(sorted(value(t.free) for t in tops[1:]))
    far = float(values[order[0]]), float(values[order[-1]])
    said = _in_words(aim.names[index], unit, found[low], found[high], level, far, bent, best)
    spread = abs(np.subtract(*far)) or 1.0
    further = tuple(v for v in further if abs(v - best) > 1e-3 * spread)
    if further:
        listed = ", ".join(f"{v:.3g}" for v in further)
        said += f" The likelihood has another maximum as good at {listed}, beside {best:.3g}."
    drop = np.array([point.drop for point in points])
    return Profile(aim.names[index], unit, values[order], drop[order], best, further,
                   found[low], found[high], level, said)  # fmt: skip


def _value(aim: Target, index: int, free: np.ndarray) -> float:
    return float(aim.values(np.asarray(free))[index])


def _is_bent(aim: Target, index: int, free: np.ndarray) -> bool:
    """Whether the parameter is searched by a logarithm, or between two bounds: not in its own unit."""
    step = np.eye(len(free))[index]
    below, here, above = (_value(aim, index, free + k * step) for k in (-1.0, 0.0, 1.0))
    return abs(above - 2 * here + below) >= 1e-3 * abs(above - below)


def _lowest(points: list[Point], index: int) -> list[Point]:
    """The points of all walks in order, without those above the line between two others' lower ones."""
    points = sorted(points, key=lambda point: point.free[index])
    z, drop = (np.array(x) for x in zip(*((p.free[index], p.drop) for p in points), strict=True))
    kept = []
    for k, point in enumerate(points):
        around = [j for j in (k - 1, k + 1) if 0 <= j < len(points)]
        higher = len(around) == 2 and all(drop[k] > drop[j] + 0.5 for j in around)
        close = len(around) == 2 and z[k + 1] - z[k - 1] < 0.05 * np.ptp(z)
        if not (higher and close):
            kept.append(point)
    return kept


def _in_words(
    name: str,
    unit: str,
    low: float | None,
    high: float | None,
    level: float,
    far: tuple[float, float],
    bent: bool,
    best: float,
) -> str:
    unit = "" if unit == "1" else f" {unit}"
    if low is not None and high is not None:
        return f"{name}: {ends(low, high)}{unit} ({100 * level:.0f} %)."

    def lacks(side: str, where: float) -> str:
        if bent and 1e-3 < abs(where / best) < 1e3:
            return f"no {side} end: the data do not tell it from its bound {where:.3g}{unit}"
        within = "a factor of a million" if bent else "a million times the data's range"
        beyond = "below" if side == "lower" else "above"
        return f"no {side} end: the data do not bound it {beyond} within {within}"

    if low is None and high is None:
        if bent and any(1e-3 < abs(where / best) < 1e3 for where in far):
            return f"{name}: {lacks('lower', far[0])}; {lacks('upper', far[1])}."
        within = "a factor of a million" if bent else "a million times the data's range"
        return f"{name}: no end either way within {within}: the data do not tell it."
    if low is None:
        return f"{name}: up to {high:.4g}{unit} ({100 * level:.0f} %), {lacks('lower', far[0])}."
    return f"{name}: from {low:.4g}{unit} on ({100 * level:.0f} %), {lacks('upper', far[1])}."
