"""Convex bodies of plane polygons."""

from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import InputError

from ._faces import Faces, check_size, polygon_faces
from ._shape import AbstractShape


class Convex(AbstractShape):
    """Plane convex polygons around a convex body, in metres from P_o; polygon k is surface k + 1.

    Not every side needs one: a force through a side without polygon has no contact there.

    **Arguments:**

    - `vertices` (vertices, 3), m.
    - `polygons`: for each its vertices' numbers, counter-clockwise seen from outside. So a convex mesh of
      trimesh's is `Convex(mesh.vertices, mesh.faces)`.

    Raises `InputError` for a polygon that is not plane, one that is turned inside out, and a body that is
    not convex, or too large or small to be meant in metres.

    **Example:**

        >>> corners = 0.1 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
        >>> faces = [(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)]
        >>> round(float(compensate.armor.Convex(corners, faces).longest()), 2)
        0.2
    """

    sides: Faces
    extent: Float[Array, ""]

    def __init__(
        self, vertices: ArrayLike, polygons: Sequence[Sequence[int] | np.ndarray] | np.ndarray
    ):
        points = np.asarray(vertices, float)
        most = max(map(len, polygons))
        corners = points[[[*p, *[p[-1]] * (most - len(p))] for p in polygons]]
        self.sides, extent = polygon_faces(corners), float(np.ptp(corners, axis=(0, 1)).max())
        self.extent = jnp.asarray(extent, float)
        check_size(extent, "body")
        heights = np.einsum(
            "fi,vi->fv", np.asarray(self.sides.normal), points[np.unique(np.concatenate(polygons))]
        )
        heights += np.asarray(self.sides.offset)[:, None]
        own = np.einsum("fi,fci->fc", np.asarray(self.sides.normal), corners)
        own += np.asarray(self.sides.offset)[:, None]
        _refuse(
            np.abs(own).max(axis=1) > 1e-6 * extent,
            "not-convex",
            "not plane",
            "split it into triangles.",
        )
        below = heights.min(axis=1) < -1e-6 * extent
        above = heights.max(axis=1) > 1e-6 * extent
        _refuse(
            below & ~above, "not-a-mesh", "inside out: the body lies outside of it",
            "give its vertices counter-clockwise seen from outside.",
        )  # fmt: skip
        _refuse(below, "not-convex", "cut by the body, which is not convex", "use Mesh.")

    def faces(self, near: Array | None = None) -> Faces:
        return self.sides

    def nearby(
        self,
        force: Array,
        moment: Array,
        most: Callable[[Array], Array],
        threshold: ArrayLike,
        tolerance: ArrayLike,
    ) -> None:
        return None

    def longest(self) -> Float[Array, ""]:
        return self.extent


def _refuse(is_bad: np.ndarray, code: str, what: str, fix: str) -> None:
    if is_bad.any():
        raise InputError(code, f"polygon {int(is_bad.argmax())} is {what}.", fix=fix)
