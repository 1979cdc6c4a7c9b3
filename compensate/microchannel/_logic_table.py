"""Logic table: the combination of pressed places from sums of levels, without training."""

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from enum import IntEnum
from functools import cached_property
from itertools import combinations, islice, permutations, product, starmap
from typing import Any, NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from hysteresis import InputError
from hysteresis._show import aligned

MOST_ORDERS = 5040
"""Of the sections of a layer that are tried: all orders of seven."""

MOST_TABLES = 20_000
"""Tables of changed levels that are tried for each number of changes: about a second's worth."""


class Remedy(NamedTuple):
    """A changed sensor in which no two combinations collide."""

    change: str
    """in words"""
    levels: Float[np.ndarray, "layers places"]
    separation: float
    """between the two closest combinations, as a part of the larger reading"""


def apart(
    sums: Float[np.ndarray, "combinations layers"], ratio: float
) -> Float[np.ndarray, "combinations combinations"]:
    """min |s - q t|/max(|s|, |q t|) over the two orders of a pair, and 1/ratio <= q <= ratio.

    q = s.t/|t|^2 within its bounds; ratio = 1: the force is known; infinite: the sine of their angle.
    """
    dot = sums @ sums.T
    square = np.diag(dot)
    q = np.clip(dot / square, 1 / ratio, ratio)
    away = square[:, None] - 2 * q * dot + q**2 * square
    parts = np.sqrt(np.maximum(away, 0) / np.maximum(square[:, None], q**2 * square))
    return np.minimum(parts, parts.T)


def _best(
    tables: Iterable[tuple[str, np.ndarray]], chosen: np.ndarray, ratio: float
) -> Remedy | None:
    def separated(change: str, levels: np.ndarray) -> Remedy:
        far = apart(chosen @ levels.T, ratio)
        np.fill_diagonal(far, np.inf)
        return Remedy(change, levels, float(far.min()))

    return max(starmap(separated, tables), key=lambda remedy: remedy.separation, default=None)


def _changed(
    levels: np.ndarray, names: tuple[Hashable, ...], count: int
) -> Iterable[tuple[str, np.ndarray]]:
    """`count` levels changed, in steps of half the least difference there is, within the levels' range."""
    known = np.unique(levels)
    step = np.diff(known).min() / 2 if len(known) > 1 else known[0] / 4
    values = np.arange(known[0], known[-1] + step / 2, step)
    cells = list(np.ndindex(levels.shape))
    tables = len(list(combinations(cells, count))) * len(values) ** count
    values = values[:: max(1, int(np.ceil((tables / MOST_TABLES) ** (1 / count))))]
    for at in combinations(cells, count):
        for new in product(values, repeat=count):
            table = levels.copy()
            table[tuple(zip(*at, strict=True))] = new
            words = [
                f"level of {names[k]} in layer {n + 1}: {table[n, k]:g} instead of {levels[n, k]:g}"
                for n, k in np.argwhere(levels != table)
            ]
            if len(words) == count:
                yield "; ".join(words), table


def _rewired(levels: np.ndarray, names: tuple[Hashable, ...]) -> Iterable[tuple[str, np.ndarray]]:
    """The sections of one layer in another order; the first layer is kept if there are several."""
    for layer in range(min(1, len(levels) - 1), len(levels)):
        for order in _orders(levels.shape[1]):
            table = levels.copy()
            table[layer] = levels[layer, order]
            if (table != levels).any():
                yield f"layer {layer + 1}: {_sections(table[layer], names)}", table


def _layered(
    levels: np.ndarray, names: tuple[Hashable, ...], chosen: np.ndarray, ratio: float, margin: float
) -> Remedy | None:
    """Layers added greedily, one at a time, up to one for each place."""
    remedy = None
    while len(levels) < levels.shape[1] and (remedy is None or remedy.separation < margin):
        before = "" if remedy is None else f"{remedy.change}; "
        rows = [levels[0, order] for order in _orders(levels.shape[1])]
        head = f"{before}one more layer: "
        tables = ((head + _sections(row, names), np.vstack([levels, row])) for row in rows)
        remedy = _best(tables, chosen, ratio)
        assert remedy is not None
        levels = remedy.levels
    return remedy


def _orders(places: int) -> Iterable[tuple[int, ...]]:
    return islice(permutations(range(places)), MOST_ORDERS)


def _sections(row: np.ndarray, names: tuple[Hashable, ...]) -> str:
    return ", ".join(f"{name} {level:g}" for name, level in zip(names, row, strict=True))


MOST_PLACES = 10
"""1,023 combinations; the table doubles with every further place."""

_EQUAL = 1e-9  # parts by which equal sums of levels may differ in rounding
_UNITS = 64  # press forces that are tried between the weakest and the strongest


class LogicStatus(IntEnum):
    """What a decision is worth. Only the first is to be used without a thought."""

    OK = 0
    COLLISION = 1
    """Another combination makes the same levels at a possible force: no reading can tell them apart."""
    CLOSE = 2
    """Another combination would read differently, but not by more than presses scatter."""
    UNKNOWN = 3
    """No combination reads like this."""
    NO_PRESS = 4
    """All channels are within the noise."""
    INVALID = 5
    """A channel was NaN or infinite."""


class Decision(NamedTuple):
    """The places that are pressed, and what else it could be."""

    places: frozenset[Hashable]
    """empty with UNKNOWN, NO_PRESS and INVALID"""
    alternatives: tuple[frozenset[Hashable], ...]
    """likeliest first"""
    probability: float
    """of `places` among all combinations, each as frequent as the others before the reading"""
    status: LogicStatus


@dataclass(frozen=True)
class LogicTable:
    """Levels of serial sections add up: a press on the places s at once reads

        V = f sum_{k in s} L_k p_k + e,    f_low <= f <= f_high,    Cov[V] = f^2 C_s + e^2
        C_s = sum_{k in s} diag(L_k) (c^2 1 1' + d^2 n/(n-1) (1 - 1 1'/n)) diag(L_k)

    with the levels L_k of n layers, the reading f of one level at the press's force, equal on all places,
    and each press's placement p, common to the layers by c and different between them by d. `decide`
    takes the combination s that makes a reading likeliest, ln f anywhere within its bounds.

    Two combinations collide where their sums are equal, or parallel and f may make up for it.

    **Arguments:**

    - `levels`: L, (layers, places), above 0. `names`: of the places; A, B, ... unless given.
    - `unit`: f in the unit of the readings; a pair (f_low, f_high) where the force is not known.
    - `noise`: standard deviation of a reading. `common`, `differential`: c and d, standard deviations.
    - `reject`: the part of true combinations that may be taken for unknown.
    - `doubt`: another combination is told where it is at least so likely.

    **Raises:** `InputError` for numbers out of range, more than 10 places.

    Source: Kim and Park (2018), section III.C and table I, whose levels are relative amplitudes.

    **Example:**

        >>> table = compensate.microchannel.LogicTable([[1.0, 2.0], [2.0, 1.0]], "AB", noise=0.01)
        >>> sorted(table.decide([3.0, 3.0]).places)
        ['A', 'B']
    """

    levels: Any
    names: Any = None
    _: KW_ONLY
    unit: Any = 1.0
    noise: float = 0.0
    common: float = 0.10
    differential: float = 0.066
    reject: float = 1e-4
    doubt: float = 0.05

    def __post_init__(self) -> None:
        levels, names, unit = np.array(self.levels, float), self.names, self.unit
        low, high = unit if isinstance(unit, Sequence) else (unit, unit)
        if levels.ndim != 2 or not 1 <= levels.shape[1] <= MOST_PLACES:
            raise _fault(
                f"levels of shape {levels.shape}.",
                f"(layers, places), at most {MOST_PLACES} places.",
            )
        if not (np.all(np.isfinite(levels)) and np.all(levels > 0)):
            raise _fault("a level is not a number above 0.", "measure it: press each place alone.")
        names = [chr(ord("A") + k) for k in range(levels.shape[1])] if names is None else names
        if len(set(names)) != levels.shape[1]:
            raise _fault(
                f"{len(names)} names for {levels.shape[1]} places.", "name each, differently."
            )
        if not 0 < low <= high < np.inf:
            raise _fault(f"unit = {unit}.", "the reading of one level, or its bounds; above 0.")
        above = self.common > 0 and self.differential > 0 and self.doubt > 0
        if not (self.noise >= 0 and above and 0 <= self.reject < 1):
            raise _fault("a deviation or a part is out of range.", "all above 0, noise 0 or more.")
        values = {"levels": levels, "names": tuple(names), "unit": (float(low), float(high))}
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @cached_property
    def combinations(self) -> tuple[frozenset[Hashable], ...]:
        """All, single places first."""
        return tuple(frozenset(self.names[k] for k in rows) for rows in self._members)

    @cached_property
    def sums(self) -> Float[np.ndarray, "combinations layers"]:
        """The levels of each combination added up."""
        return self._chosen.astype(float) @ self.levels.T

    def collisions(self) -> tuple[tuple[frozenset[Hashable], ...], ...]:
        """Groups of combinations that no reading tells apart, linked directly or through others."""
        groups, left = [], set(range(len(self.combinations)))
        while left:
            group = reach = {min(left)}
            while reach := set(np.flatnonzero(self._collides[sorted(reach)].any(axis=0))) - group:
                group = group | reach
            left -= group
            groups.append(tuple(self.combinations[n] for n in sorted(group)))
        return tuple(group for group in groups if len(group) > 1)

    def remedies(self, *, most_changes: int = 3, margin: float = 0.02) -> tuple[Remedy, ...]:
        """Changes of the sensor after which no two combinations collide, found by trying; may be none.

        Of each kind the one that leaves the two closest combinations farthest apart: the fewest levels
        changed, within the range of those there are; one layer's sections wired in another order; one
        more layer, or as many as it takes, with the first one's sections in another order.

        **Arguments:**

        - `most_changes`: levels that may be changed at once.
        - `margin`: the least distance, as a part of the reading, that counts as a remedy.
        """
        levels, names, chosen = self.levels, self.names, self._chosen
        fewest, ratio = None, self.unit[1] / self.unit[0]
        for count in range(1, most_changes + 1):
            fewest = _best(_changed(levels, names, count), chosen, ratio)
            if fewest is not None and fewest.separation >= margin:
                break
        rewired = _best(_rewired(levels, names), chosen, ratio)
        found = (fewest, rewired, _layered(levels, names, chosen, ratio, margin))
        return tuple(remedy for remedy in found if remedy and remedy.separation >= margin)

    def decide(self, reading: ArrayLike) -> Decision:
        """The places behind one reading (layers,). Never raises for what it says."""
        reading = np.asarray(reading, float)
        if reading.shape != self.levels.shape[:1]:
            raise _fault(f"a reading of shape {reading.shape}.", f"({len(self.levels)},).")
        if not np.isfinite(reading).all():
            return _undecided(LogicStatus.INVALID)
        if np.all(reading <= 5 * self.noise):
            return _undecided(LogicStatus.NO_PRESS)
        squared, density = self._distances(reading)
        if squared.min() > scipy.stats.chi2.isf(self.reject, len(reading)):
            return _undecided(LogicStatus.UNKNOWN)
        probability = scipy.special.softmax(density)
        order = np.argsort(-probability, kind="stable")
        best = order[0]
        others = [n for n in order[1:] if probability[n] >= self.doubt]
        status = LogicStatus.CLOSE if others else LogicStatus.OK
        if any(self._collides[best, n] for n in others):
            status = LogicStatus.COLLISION
        alternatives = tuple(self.combinations[n] for n in others)
        return Decision(self.combinations[best], alternatives, float(probability[best]), status)

    def __str__(self) -> str:
        """As the paper's table I: the levels of each combination as a sum."""
        rows = [
            [", ".join(str(self.names[k]) for k in members)]
            + ["+".join(f"{level:g}" for level in layer[list(members)]) for layer in self.levels]
            for members in self._members
        ]
        rows = [["Contact Locations", *(f"V{n + 1}" for n in range(len(self.levels)))], *rows]
        return "\n".join(aligned(rows))

    @cached_property
    def _members(self) -> tuple[tuple[int, ...], ...]:
        places = range(len(self.names))
        return tuple(rows for n in places for rows in combinations(places, n + 1))

    @cached_property
    def _chosen(self) -> Bool[np.ndarray, "combinations places"]:
        return np.array([[k in rows for k in range(len(self.names))] for rows in self._members])

    @cached_property
    def _collides(self) -> Bool[np.ndarray, "combinations combinations"]:
        return apart(self.sums, self.unit[1] / self.unit[0]) <= _EQUAL

    @cached_property
    def _scatter(self) -> Float[np.ndarray, "combinations layers layers"]:
        """C_s."""
        n = len(self.levels)
        whole = np.ones((n, n))
        # A single layer cannot tell one kind of placement from the other.
        between = n / (n - 1) * (np.eye(n) - whole / n) if n > 1 else whole
        placed = self.common**2 * whole + self.differential**2 * between
        each = self.levels.T[:, :, None] * placed * self.levels.T[:, None, :]
        return np.tensordot(self._chosen.astype(float), each, axes=1)

    def _distances(
        self, reading: Float[np.ndarray, " layers"]
    ) -> tuple[Float[np.ndarray, " combinations"], Float[np.ndarray, " combinations"]]:
        """For every combination, the least squared Mahalanobis distance and the log of the mean density."""
        low, high = self.unit
        f = np.geomspace(low, high, _UNITS if high > low else 1)[:, None, None, None]
        spread = f**2 * self._scatter + self.noise**2 * np.eye(len(reading))
        away = reading - f[..., 0] * self.sums
        squared = np.sum(away * np.linalg.solve(spread, away[..., None])[..., 0], axis=-1)
        density = -(squared + np.linalg.slogdet(spread)[1]) / 2
        most = density.max(axis=0)
        return squared.min(axis=0), most + np.log(np.mean(np.exp(density - most), axis=0))


def _undecided(status: LogicStatus) -> Decision:
    return Decision(frozenset(), (), 0.0, status)


def _fault(problem: str, fix: str) -> InputError:
    return InputError("bad-option", problem, place="LogicTable", fix=fix)
