"""Bounding-sphere hierarchy: the triangles near each of many lines, out of thousands."""

import numpy as np

GROUP = 8
"""Spheres in a sphere."""


class Hierarchy:
    """Triangles in spheres of eight, those in spheres of eight, and so on up to eight or fewer.

    A line misses all that is in a sphere that it misses. NumPy goes down level by level with the pairs of
    a line and a sphere that are left, some fifty per line and level on a closed body.

    **Arguments:** `corners` (triangles, 3, 3).
    """

    def __init__(self, corners: np.ndarray):
        middle = (corners.min(axis=1) + corners.max(axis=1)) / 2
        radius = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
        # What rounding may do to the distance of a line from a sphere, generously.
        radius = radius + 1e-6 * np.ptp(corners)
        self.order: np.ndarray = _halved(middle, np.arange(len(corners)))
        level = middle[self.order], radius[self.order]
        self.levels: list[tuple[np.ndarray, np.ndarray]] = [level]
        while len(self.levels[0][0]) > GROUP:
            self.levels.insert(0, _around(*self.levels[0]))

    def near(
        self, foot: np.ndarray, along: np.ndarray, reach: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """All pairs (line, triangle) that are within the line's reach, and some that are not.

        **Arguments:** `foot`, `along`: (lines, 3), a point of each line and its direction, of length 1;
        `reach`: (lines,). The pairs are in the order of the lines.
        """
        line, node = _product(np.arange(len(foot)), np.arange(len(self.levels[0][0])))
        for depth, (centre, radius) in enumerate(self.levels):
            if depth:
                line, node = np.repeat(line, GROUP), _children(node)
                inside = node < len(radius)
                line, node = line[inside], node[inside]
            away = centre[node] - foot[line]
            ahead = np.einsum("ij,ij->i", away, along[line])
            within = np.einsum("ij,ij->i", away, away) - ahead**2
            kept = within <= (radius[node] + reach[line]) ** 2
            line, node = line[kept], node[kept]
        return line, self.order[node]


def _product(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.repeat(a, len(b)), np.tile(b, len(a))


def _children(node: np.ndarray) -> np.ndarray:
    return (node[:, None] * GROUP + np.arange(GROUP)).ravel()


def _around(centre: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bounding spheres of each eight consecutive items."""
    first = np.arange(0, len(centre), GROUP)
    low = np.minimum.reduceat(centre, first)
    high = np.maximum.reduceat(centre, first)
    middle = (low + high) / 2
    far = np.linalg.norm(centre - np.repeat(middle, GROUP, axis=0)[: len(centre)], axis=1) + radius
    return middle, np.maximum.reduceat(far, first)


def _halved(middle: np.ndarray, items: np.ndarray) -> np.ndarray:
    """An order of the items in which each eight, and each eight of those, are neighbours in space."""
    if len(items) <= GROUP:
        return items
    whole = GROUP
    while whole * GROUP < len(items):
        whole *= GROUP
    # The cut falls between groups of the level below, for these are told by counting alone.
    cut = whole * -(-len(items) // (2 * whole))
    axis = np.argmax(np.ptp(middle[items], axis=0))
    order = items[np.argsort(middle[items, axis], kind="stable")]
    return np.concatenate([_halved(middle, order[:cut]), _halved(middle, order[cut:])])
