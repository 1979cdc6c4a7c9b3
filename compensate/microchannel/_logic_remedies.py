"""Search for changes to a sensor in which combinations of places give the same reading."""

from collections.abc import Hashable, Iterable
from itertools import combinations, permutations, product
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

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


def remedies(
    levels: Float[np.ndarray, "layers places"],
    names: tuple[Hashable, ...],
    chosen: Bool[np.ndarray, "combinations places"],
    ratio: float,
    most_changes: int,
    margin: float,
) -> tuple[Remedy, ...]:
    """See `LogicTable.remedies`; ratio = f_high/f_low."""
    found = [_fewest_changes(levels, names, chosen, ratio, most_changes, margin)]
    found += [_best(_rewired(levels, names), chosen, ratio)]
    found += [_layered(levels, names, chosen, ratio, margin)]
    return tuple(remedy for remedy in found if remedy and remedy.separation >= margin)


def _best(
    tables: Iterable[tuple[str, np.ndarray]], chosen: np.ndarray, ratio: float
) -> Remedy | None:
    best = None
    for change, levels in tables:
        far = apart(chosen @ levels.T, ratio)
        np.fill_diagonal(far, np.inf)
        separation = float(far.min())
        if best is None or separation > best.separation:
            best = Remedy(change, levels, separation)
    return best


def _fewest_changes(
    levels: np.ndarray,
    names: tuple[Hashable, ...],
    chosen: np.ndarray,
    ratio: float,
    most: int,
    margin: float,
) -> Remedy | None:
    best = None
    for count in range(1, most + 1):
        best = _best(_changed(levels, names, count), chosen, ratio)
        if best is not None and best.separation >= margin:
            break
    return best


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
            if all(levels[cell] != value for cell, value in zip(at, new, strict=True)):
                table = levels.copy()
                for cell, value in zip(at, new, strict=True):
                    table[cell] = value
                yield _words(levels, table, names), table


def _words(levels: np.ndarray, table: np.ndarray, names: tuple[Hashable, ...]) -> str:
    return "; ".join(
        f"level of {names[k]} in layer {layer + 1}: {table[layer, k]:g} instead of {levels[layer, k]:g}"
        for layer, k in zip(*np.nonzero(levels != table), strict=True)
    )


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


def _orders(places: int) -> Iterable[list[int]]:
    for n, order in enumerate(permutations(range(places))):
        if n == MOST_ORDERS:
            return
        yield list(order)


def _sections(row: np.ndarray, names: tuple[Hashable, ...]) -> str:
    return ", ".join(f"{name} {level:g}" for name, level in zip(names, row, strict=True))
