"""The open box of the paper, as a shape of plane faces."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import InputError, Scalar, is_concrete, parameter

from ._faces import Faces, check_size
from ._shape import AbstractShape

_LENGTH = {"unit": "m", "bounds": (0.0, float("inf"))}

_INWARDS = [[0, 0, -1], [0, -1, 0], [0, 1, 0], [-1, 0, 0], [1, 0, 0]]
_UP_DOWN = [[0, 0, 1], [0, 0, -1]]
_EDGES = [
    [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]],
    *[[[1, 0, 0], [-1, 0, 0], *_UP_DOWN]] * 2,
    *[[[0, 1, 0], [0, -1, 0], *_UP_DOWN]] * 2,
]


class Box(AbstractShape):
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
        return Faces(
            jnp.asarray(_INWARDS, offset.dtype),
            offset,
            jnp.asarray(_EDGES, offset.dtype),
            jnp.stack([jnp.stack(row) for row in limit]),
            jnp.arange(1, 6),
        )

    def nearby(
        self,
        force: Array,
        moment: Array,
        most: Callable[[Array], Array],
        threshold: ArrayLike,
        tolerance: ArrayLike,
    ) -> None:
        return None

    def centres(self) -> Float[Array, "5 3"]:
        """The middle of each surface, m."""
        middle = jnp.stack(
            [jnp.zeros_like(self.dx), jnp.zeros_like(self.dx), (self.dz1 + self.dz2) / 2]
        )
        faces = self.faces()
        return middle[None] - (faces.offset + faces.normal @ middle)[:, None] * faces.normal

    def axes(self) -> Float[Array, "5 2 3"]:
        """From the middle of each surface to the middles of two of its sides, m."""
        x, y, z = jnp.diag(jnp.stack([self.dx, self.dy, (self.dz1 - self.dz2) / 2]))
        return jnp.stack([jnp.stack(pair) for pair in ((x, y), (x, z), (x, z), (y, z), (y, z))])

    def longest(self) -> Float[Array, ""]:
        return 2 * jnp.maximum(jnp.maximum(self.dx, self.dy), (self.dz1 - self.dz2) / 2)
