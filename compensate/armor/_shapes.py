"""Shapes as plane faces, the form in which the solver sees them: the box of the paper, convex bodies."""

import abc
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from hysteresis import InputError, Scalar, parameter
from hysteresis._parameter import is_concrete

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}

LARGEST, SMALLEST = 10.0, 0.005
"""Metres between which a robot's shell lies: outside, the unit is wrong."""


class Faces(NamedTuple):
    """Faces k of a body, seen from P_o:

        f_k(P) = offset_k + normal_k . P >= 0              within the body
        D_k    = {P : edge_ke . P <= limit_ke for all e}     the face itself, where f_k(P) = 0

    `normal` points inwards; `edge` outwards, in the face's plane, both of length 1. `surface` counts
    from 1; it is 0 for a face that is there only to fill a list.
    """

    normal: Float[Array, "faces 3"]
    offset: Float[Array, " faces"]
    edge: Float[Array, "faces edges 3"]
    limit: Float[Array, "faces edges"]
    surface: Int[Array, " faces"]


def dots(a: Array, b: Array) -> Array:
    """a . b along the last axis, written out: XLA fuses this, and calls a library for the other."""
    products = a * b
    return products[..., 0] + products[..., 1] + products[..., 2]


def polygon_faces(corners: np.ndarray) -> Faces:
    """Faces of plane convex polygons, (faces, corners, 3), counter-clockwise seen from outside.

    One with fewer corners than the others repeats its last.
    """
    sides = np.roll(corners, -1, axis=1) - corners
    outwards = _unit(np.cross(corners - corners[:, :1], sides).sum(axis=1))
    edge = _unit(np.cross(sides, outwards[:, None, :]))
    # A repeated corner makes a side without length, which must never be the one that decides.
    none = ~sides.any(axis=2)
    limit = np.where(none, np.ptp(corners), (edge * corners).sum(axis=2))
    offset = (outwards[:, None, :] * corners).sum(axis=2).mean(axis=1)
    surface = 1 + np.arange(len(corners))
    return Faces(*map(jnp.asarray, (-outwards, offset, edge, limit, surface)))


def _unit(v: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return v / np.where(length > 0, length, 1.0)


def check_size(longest: float, what: str) -> None:
    """Raises `InputError` where a body of this longest side is not given in metres."""
    if not SMALLEST <= longest <= LARGEST:
        raise InputError(
            "wrong-unit",
            f"this {what} is {longest:g} m long.",
            cause="lengths in millimetres." if longest > LARGEST else "lengths scaled twice.",
            fix='give metres: 0.3, not 300; Mesh.load(path, unit="mm"), or unit = "mm" in the TOML file.',
        )


class AbstractShape(eqx.Module):
    """The outer surface of a robot, seen from P_o, the point that moments are taken about."""

    @abc.abstractmethod
    def faces(self, near: Int[Array, " near"] | None = None) -> Faces:
        """All its plane faces; or those of `nearby`."""

    @abc.abstractmethod
    def nearby(
        self, force: Array, moment: Array, most: Callable[[Array], Array], threshold: ArrayLike,
        tolerance: ArrayLike,
    ) -> Int[Array, "*contacts near"] | None:  # fmt: skip
        """Which faces each line of action can have met, counted from 0 and filled up with -1.

        None: every one is to be looked at, as of shapes of few.

        **Arguments:** `force`, `moment`: (..., 3); `most`: from cosines (n,) to (..., n), m, how far
        n.F = |F| cosine can press a face in at most; `threshold`, N: below which a face is not pushed;
        `tolerance`, m: how far beyond a face's edge a contact may lie.
        """

    @abc.abstractmethod
    def longest(self) -> Float[Array, ""]:
        """The longest side of the box around it, m."""


class AbstractFewFaces(AbstractShape):
    """Every face is looked at for every line of action."""

    def nearby(
        self, force: Array, moment: Array, most: Callable[[Array], Array], threshold: ArrayLike,
        tolerance: ArrayLike,
    ) -> None:  # fmt: skip
        return None


_LENGTH = {"unit": "m", "bounds": (0.0, float("inf"))}

_INWARDS = [[0, 0, -1], [0, -1, 0], [0, 1, 0], [-1, 0, 0], [1, 0, 0]]
_UP_DOWN = [[0, 0, 1], [0, 0, -1]]
_EDGES = [
    [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]],
    *[[[1, 0, 0], [-1, 0, 0], *_UP_DOWN]] * 2,
    *[[[0, 1, 0], [0, -1, 0], *_UP_DOWN]] * 2,
]


class Box(AbstractFewFaces):
    """A box with five soft sides, open below: |x| <= dx, |y| <= dy, dz2 <= z <= dz1, in metres from P_o.

    Its surfaces are 1: z = dz1 (the top), 2: y = dy, 3: y = -dy, 4: x = dx, 5: x = -dx.

    Raises `InputError` where it has no inside, or is too large or small to be meant in metres.

    Source: Tsuji 2014, equations (15) and (17).

    **Example:**

        >>> box = compensate.armor.Box(dx=0.3, dy=0.3, dz1=0.55, dz2=0.0)
        >>> float(box.longest())
        0.6
    """

    dx: Scalar = parameter(**_LENGTH, meaning="half the width")
    dy: Scalar = parameter(**_LENGTH, meaning="half the depth")
    dz1: Scalar = parameter(unit="m", meaning="height of the top")
    dz2: Scalar = parameter(0.0, unit="m", meaning="height of the lower rim")

    def __check_init__(self) -> None:
        if not all(map(is_concrete, (self.dx, self.dy, self.dz1, self.dz2))):
            return
        dx, dy, dz1, dz2 = (float(v) for v in (self.dx, self.dy, self.dz1, self.dz2))
        sides = np.array([2 * dx, 2 * dy, dz1 - dz2])
        if not (np.isfinite(sides).all() and (sides > 0).all()):
            raise InputError(
                "bad-option",
                f"a box of {sides[0]:g} x {sides[1]:g} x {sides[2]:g} m has no inside.",
                fix="give positive half sides dx and dy, and dz1 above dz2.",
            )
        check_size(float(sides.max()), "box")

    def faces(self, near: Array | None = None) -> Faces:
        dx, dy, dz1, dz2 = self.dx, self.dy, self.dz1, self.dz2
        limit = [[dx, dx, dy, dy], *[[dx, dx, dz1, -dz2]] * 2, *[[dy, dy, dz1, -dz2]] * 2]
        offset = jnp.stack([dz1, dy, dy, dx, dx])
        normal, edge = (jnp.asarray(v, offset.dtype) for v in (_INWARDS, _EDGES))
        limit = jnp.stack([jnp.stack(row) for row in limit])
        return Faces(normal, offset, edge, limit, jnp.arange(1, 6))

    def centres(self) -> Float[Array, "5 3"]:
        """The middle of each surface, m."""
        zero = jnp.zeros_like(self.dx)
        middle = jnp.stack([zero, zero, (self.dz1 + self.dz2) / 2])
        faces = self.faces()
        return middle[None] - (faces.offset + faces.normal @ middle)[:, None] * faces.normal

    def axes(self) -> Float[Array, "5 2 3"]:
        """From the middle of each surface to the middles of two of its sides, m."""
        x, y, z = jnp.diag(jnp.stack([self.dx, self.dy, (self.dz1 - self.dz2) / 2]))
        return jnp.stack([jnp.stack(pair) for pair in ((x, y), (x, z), (x, z), (y, z), (y, z))])

    def longest(self) -> Float[Array, ""]:
        return 2 * jnp.maximum(jnp.maximum(self.dx, self.dy), (self.dz1 - self.dz2) / 2)


class Convex(AbstractFewFaces):
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

    def __init__(self, vertices: ArrayLike, polygons: Sequence[Any] | np.ndarray):
        points = np.asarray(vertices, float)
        most = max(map(len, polygons))
        corners = points[[[*p, *[p[-1]] * (most - len(p))] for p in polygons]]
        self.sides, extent = polygon_faces(corners), float(np.ptp(corners, axis=(0, 1)).max())
        self.extent = jnp.asarray(extent, float)
        check_size(extent, "body")
        normal, offset = np.asarray(self.sides.normal), np.asarray(self.sides.offset)[:, None]
        heights = normal @ points[np.unique(np.concatenate(polygons))].T + offset
        own = np.einsum("fi,fci->fc", normal, corners) + offset
        bent, least = np.abs(own).max(axis=1), 1e-6 * extent
        _refuse(bent > least, "not-convex", "not plane", "split it into triangles.")
        below, above = heights.min(axis=1) < -least, heights.max(axis=1) > least
        _refuse(
            below & ~above, "not-a-mesh", "inside out: the body lies outside of it",
            "give its vertices counter-clockwise seen from outside.",
        )  # fmt: skip
        _refuse(below, "not-convex", "cut by the body, which is not convex", "use Mesh.")

    def faces(self, near: Array | None = None) -> Faces:
        return self.sides

    def longest(self) -> Float[Array, ""]:
        return self.extent


def _refuse(is_bad: np.ndarray, code: str, what: str, fix: str) -> None:
    if is_bad.any():
        raise InputError(code, f"polygon {int(is_bad.argmax())} is {what}.", fix=fix)
