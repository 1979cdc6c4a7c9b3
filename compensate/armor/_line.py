"""The line of action of a wrench, and where it meets plane faces."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ._faces import Faces, dots


class Line(NamedTuple):
    """P(l) = foot + l force, and what is known of the wrench. Zero force where it is not finite.

    - `foot`, m: F x M / |F|^2, the point of the line closest to P_o.
    - `size`, N: |F|, and 1 where there is no force.
    - `spin`, N m: M.F / |F|.
    """

    force: Float[Array, "3"]
    foot: Float[Array, "3"]
    size: Float[Array, ""]
    spin: Float[Array, ""]
    finite: Bool[Array, ""]
    some: Bool[Array, ""]


class Crossing(NamedTuple):
    """Where a line meets the planes of faces that it is not parallel to, before any is pressed in.

    - `along`, N: F_n = n.F, positive where the force pushes the face.
    - `safe`: which faces the line crosses; elsewhere all below is of no meaning, and finite.
    - `point`, m: where.
    - `ahead`, `aside`: once the face is pressed in by d, P^e = point + d ahead and P^i = point + d aside.
    """

    faces: Faces
    along: Float[Array, " faces"]
    safe: Bool[Array, " faces"]
    point: Float[Array, "faces 3"]
    ahead: Float[Array, "faces 3"]
    aside: Float[Array, "faces 3"]


def line_of(force: Float[Array, "3"], moment: Float[Array, "3"]) -> Line:
    """The line of action. Gradients are finite for every wrench, and 0 where there is no line."""
    finite = jnp.isfinite(force).all() & jnp.isfinite(moment).all()
    force, moment = jnp.where(finite, force, 0), jnp.where(finite, moment, 0)
    square = dots(force, force)
    some = square > 0
    square = jnp.where(some, square, 1)
    size = jnp.sqrt(square)
    return Line(
        force, jnp.cross(force, moment) / square, size, dots(force, moment) / size, finite, some
    )


def crossing_of(faces: Faces, line: Line) -> Crossing:
    """Where the line meets each plane: f_k(foot + l F) = 0."""
    along = dots(faces.normal, line.force[None])
    # A line along a face meets it nowhere: rounding must not send the point to infinity.
    safe = faces.real & line.some & (jnp.abs(along) > 1e-9 * line.size)
    divisor = jnp.where(safe, along, 1)
    depth = -(faces.offset + dots(faces.normal, line.foot[None])) / divisor
    point = line.foot[None] + depth[:, None] * line.force[None]
    ahead = line.force[None] / divisor[:, None]
    return Crossing(faces, along, safe, point, ahead, ahead - faces.normal)
