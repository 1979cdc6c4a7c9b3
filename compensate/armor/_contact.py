"""The contact estimated from one wrench."""

from typing import NamedTuple

from jaxtyping import Array, Float, Int


class Contact(NamedTuple):
    """Where the load's line of action meets the cover. All arrays have the wrench's leading shape.

    - `point` (..., 3), m: P^e, where the load acts, on the line of action.
    - `surface`: number of the touched surface, from 1; 0 where none was found.
    - `displacement`, m: d_n, how far the cover is pressed in along its normal.
    - `status`: a `ContactStatus`.
    - `spin`, N m: M.F/|F|, the torque about the line of action, which a point contact cannot exert.
    - `normal` (..., 3): of the touched surface, inwards.
    - `normal_force`, N: n.F.
    - `outside`, m: how far the touched point lies beyond the surface's edge; not above 0 within.

    Where no surface is found but some are pushed, point and displacement are those of the surface that
    the line of action passes closest. Where none is pushed they are 0, never NaN.
    """

    point: Float[Array, "*contacts 3"]
    surface: Int[Array, "*contacts"]
    displacement: Float[Array, "*contacts"]
    status: Int[Array, "*contacts"]
    spin: Float[Array, "*contacts"]
    normal: Float[Array, "*contacts 3"]
    normal_force: Float[Array, "*contacts"]
    outside: Float[Array, "*contacts"]

    @property
    def touched(self) -> Float[Array, "*contacts 3"]:
        """P^i = P^e - d_n n, m: the touched point of the surface before it was pressed."""
        return self.point - self.displacement[..., None] * self.normal
