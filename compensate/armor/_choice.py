"""Choice of the touched face among those that a line of action crosses, and its reliability."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from hysteresis import Scalar

from ..runtime._contact_status import ContactStatus
from ._contact import Contact
from ._faces import dots
from ._line import Crossing, Line


class Limits(NamedTuple):
    """What a contact is judged by, see `ContactSolver`: N, m, m; `rounding`, m, is taken for nothing."""

    threshold: Scalar
    tolerance: Scalar
    spin: Scalar
    rounding: Scalar


class Candidates(NamedTuple):
    """What each face would make of a wrench.

    - `pushed`: which faces the force pushes with the threshold's force or more.
    - `point`, `displacement`, `outside`: P^e, d_n, and how far P^i lies beyond the face's edge, m.
    - `beyond`: where the material is pushed further than its fit knows, or than it is thick.
    """

    pushed: Bool[Array, " faces"]
    point: Float[Array, "faces 3"]
    displacement: Float[Array, " faces"]
    outside: Float[Array, " faces"]
    beyond: Bool[Array, " faces"]

    def cost(self, limits: Limits) -> Float[Array, " faces"]:
        """How far outside a pushed face's point lies, m; 0 within it, infinite where not pushed."""
        beyond = jnp.where(self.outside <= limits.rounding, 0, self.outside)
        return jnp.where(self.pushed, beyond, jnp.inf)


def candidates_of(
    crossing: Crossing,
    displacement: Float[Array, " faces"],
    beyond: Bool[Array, " faces"],
    limits: Limits,
) -> Candidates:
    """All faces, each pressed in by its own d_n."""
    pushed = crossing.safe & (crossing.along >= limits.threshold)
    displacement = jnp.where(pushed, displacement, 0)
    point = crossing.point + displacement[:, None] * crossing.ahead
    touched = crossing.point + displacement[:, None] * crossing.aside
    outside = crossing.faces.outside(touched)
    return Candidates(pushed, point, displacement, outside, pushed & beyond)


def likeliest(crossing: Crossing, found: Candidates, limits: Limits) -> Int[Array, ""]:
    """The face closest to its point; of several that hold theirs, the one pushed most squarely."""
    cost = found.cost(limits)
    return jnp.argmax(jnp.where(found.pushed & (cost <= cost.min()), crossing.along, -jnp.inf))


def contact_at(
    best: Int[Array, ""], crossing: Crossing, found: Candidates, line: Line, limits: Limits
) -> Contact:
    """The contact on one face, with its own status: OK, EXTRAPOLATED, MISSED or NO_CONTACT."""
    pushed = found.pushed[best]
    within = pushed & (found.outside[best] <= jnp.maximum(limits.tolerance, limits.rounding))
    status = jnp.where(pushed, ContactStatus.MISSED, ContactStatus.NO_CONTACT)
    return Contact(
        jnp.where(pushed, found.point[best], 0),
        jnp.where(within, crossing.faces.surface[best], 0),
        found.displacement[best],
        jnp.where(
            within,
            jnp.where(found.beyond[best], ContactStatus.EXTRAPOLATED, ContactStatus.OK),
            status,
        ),
        line.spin,
        jnp.where(pushed, crossing.faces.normal[best], 0),
        jnp.where(pushed, crossing.along[best], 0),
        jnp.where(pushed, found.outside[best], 0),
    )


def judged(
    best: Int[Array, ""],
    crossing: Crossing,
    found: Candidates,
    line: Line,
    limits: Limits,
    doubt: Int[Array, ""],
) -> Contact:
    """The contact on the likeliest face, with the status of the whole wrench."""
    contact, faces = contact_at(best, crossing, found, line, limits), crossing.faces
    is_found = contact.surface > 0
    apart = found.point - contact.point[None]
    dent = found.displacement + contact.displacement + limits.rounding
    within = found.pushed & (found.outside <= limits.rounding)
    several = within & (dots(apart, apart) > dent * dent)
    pulled = crossing.safe & (crossing.along <= -limits.threshold)
    through = pulled & (found.outside <= limits.tolerance)
    faced = faces.real & (crossing.along > 1e-9 * line.size)
    is_pulling = through.any() | (faces.real.any() & ~faced.any())
    is_strong = line.size >= limits.threshold
    too_much_spin = jnp.abs(line.spin) > limits.spin * contact.normal_force
    status = jnp.select(
        [
            ~line.finite | (doubt == ContactStatus.INVALID),
            ~line.some | (line.size < limits.threshold / 10),
            doubt != ContactStatus.OK,
            is_found & too_much_spin,
            is_found & several.any(),
            is_found & found.beyond[best],
            is_found,
            is_strong & is_pulling,
            is_strong & (found.pushed.any() | ~faces.real.any()),
        ],
        [
            jnp.asarray(code, doubt.dtype)
            for code in (
                ContactStatus.INVALID, ContactStatus.NO_CONTACT, doubt, ContactStatus.SECOND_SUPPORT,
                ContactStatus.AMBIGUOUS, ContactStatus.EXTRAPOLATED, ContactStatus.OK,
                ContactStatus.PULLING, ContactStatus.MISSED,
            )
        ],
        jnp.asarray(ContactStatus.BELOW_THRESHOLD, doubt.dtype),
    )  # fmt: skip
    return contact._replace(status=status)
