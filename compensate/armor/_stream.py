"""One contact after the other, with the cover's history."""

from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..runtime._contact_status import ContactStatus
from ._choice import candidates_of, judged, likeliest
from ._contact import Contact
from ._faces import dots
from ._line import line_of

if TYPE_CHECKING:
    from ._solver import ContactSolver


class Touch(NamedTuple):
    """What is known of the present contact, or of the last one.

    - `touching`: whether there is one.
    - `surface`, `place` (m): where, P^i; surface 0 before the first.
    - `time`: of the last sample with contact.
    - `cover`: the state of the material there.
    - `contact`: the last one told.
    """

    touching: Bool[Array, ""]
    surface: Int[Array, ""]
    place: Float[Array, "3"]
    time: Float[Array, ""]
    cover: Any
    contact: Contact


def untouched(solver: "ContactSolver") -> Touch:
    """The state before anything was touched."""
    zero = jnp.zeros_like(solver.threshold)
    none, place = jnp.zeros((), int), jnp.zeros((3,), zero.dtype)
    status = jnp.asarray(int(ContactStatus.NO_CONTACT), int)
    contact = Contact(place, none, zero, status, zero, place, zero, zero)
    return Touch(jnp.zeros((), bool), none, place, zero - jnp.inf, solver.cover.init(), contact)


def touched(
    solver: "ContactSolver", state: Touch, t: Array, force: Array, moment: Array, doubt: Any,
    near: Array | None,
) -> tuple[Touch, Contact]:  # fmt: skip
    """`ContactSolver.step` on the faces `near`.

    Every face makes a trial of its own normal force; the state of the touched one is kept.
    """
    limits = solver.limits()
    least = jnp.where(state.touching, solver.release, limits.threshold)
    limits = limits._replace(threshold=least)
    line = line_of(force, moment)
    crossing = solver.cross(line, near)
    moved = crossing.point - state.place[None]
    far = dots(moved, moved) > solver.same_place**2
    late = t - state.time > solver.recovery
    elsewhere = crossing.faces.surface != state.surface
    fresh = elsewhere | (~state.touching & (far | late))
    virgin = solver.cover.init()

    def trial(is_fresh: Array, along: Array) -> tuple[Any, Array]:
        before = jax.tree.map(lambda v, kept: jnp.where(is_fresh, v, kept), virgin, state.cover)
        return solver.cover.press(before, t, along)

    covers, pressed = jax.vmap(trial)(fresh, jnp.maximum(crossing.along, 0))
    found = candidates_of(crossing, solver.settle(crossing, pressed), limits)
    best = likeliest(crossing, found, limits)
    contact = judged(best, crossing, found, line, limits, doubt)
    touching = contact.surface > 0
    # Without contact nothing bears on the place that was touched last: it recovers as its model does.
    rested = solver.cover.press(state.cover, t, jnp.zeros_like(t))[0]
    after = Touch(
        touching,
        jnp.where(touching, contact.surface, state.surface),
        jnp.where(touching, contact.touched, state.place),
        jnp.where(touching, t, state.time),
        jax.tree.map(lambda trials, rest: jnp.where(touching, trials[best], rest), covers, rested),
        contact,
    )
    # A sample that cannot be used leaves everything as it was.
    usable = line.finite & jnp.isfinite(t) & (doubt != int(ContactStatus.INVALID))
    invalid = jnp.full_like(contact.status, int(ContactStatus.INVALID))
    held = state.contact._replace(status=invalid)
    after = jax.tree.map(lambda new, old: jnp.where(usable, new, old), after, state)
    return after, jax.tree.map(lambda new, old: jnp.where(usable, new, old), contact, held)


class ContactStream:
    """`ContactSolver.step` compiled for a loop in Python: state inside, NumPy in, NumPy out.

    stream = ContactStream(solver)
    contact = stream.step(t, force, moment)

    XLA hands the small parts of a step from thread to thread, which is most of its time: in a process that
    is kept on one core (`taskset -c 0 python ...`) a step takes a third to two thirds of it.
    """

    def __init__(self, solver: "ContactSolver"):
        state = solver.init()
        leaves, tree = jax.tree.flatten((state, state.contact))
        dtype, ends = state.place.dtype, np.cumsum([leaf.size for leaf in leaves]).tolist()

        def packed(whole: Any) -> Array:
            return jnp.concatenate(
                [jnp.ravel(leaf).astype(dtype) for leaf in jax.tree.leaves(whole)]
            )

        def unpacked(values: Array) -> Any:
            parts = [
                values[end - leaf.size : end].reshape(leaf.shape).astype(leaf.dtype)
                for leaf, end in zip(leaves, ends, strict=True)
            ]
            return jax.tree.unflatten(tree, parts)

        def step(before: Array, sample: Array) -> Array:
            t, force, moment, doubt = sample[0], sample[1:4], sample[4:7], sample[7].astype(int)
            return packed(solver.step(unpacked(before)[0], t, force, moment, doubt))

        # What enters and leaves the compiled step costs more than the step: one array each, 14 us instead
        # of 53 for the state's own.
        self._step, self._first = jax.jit(step), packed((state, state.contact))
        self._dtype = dtype
        self.reset()
        jax.block_until_ready(self._step(self._packed, np.zeros(8, dtype)))

    def reset(self) -> None:
        """As before the first sample."""
        self._packed = self._first

    def step(self, t: Any, force: Any, moment: Any, doubt: Any = 0) -> Contact:
        """The contact at the time `t`, as NumPy values; arguments as of `ContactSolver.step`."""
        sample = np.empty(8, self._dtype)
        sample[0], sample[1:4], sample[4:7], sample[7] = t, force, moment, doubt
        self._packed = self._step(self._packed, sample)
        v = np.asarray(self._packed)[-12:]
        whole: Any = (v[0:3], int(v[3]), v[4], int(v[5]), v[6], v[7:10], v[10], v[11])
        return Contact(*whole)
