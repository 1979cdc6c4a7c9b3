"""Contacts one sample at a time, in a Python loop."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from ._contact import Contact
from ._solver import ContactSolver


class ContactStream:
    """`ContactSolver.step` compiled for a loop in Python: state inside, NumPy in, NumPy out.

    XLA passes the small parts of a step from thread to thread, which takes most of the time. In a process
    on one core (`taskset -c 0 python ...`) a step takes only a third to two thirds of it.

    **Example:**

        >>> stream = compensate.armor.ContactStream(solver)
        >>> contact = stream.step(0.0, [0.0, 0.0, -10.0], [0.0, 0.0, 0.0])
        >>> contact.surface, round(float(contact.displacement), 4)
        (1, 0.0192)
    """

    def __init__(self, solver: ContactSolver):
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

    def step(
        self, t: ArrayLike | None, force: ArrayLike, moment: ArrayLike, doubt: ArrayLike = 0
    ) -> Contact:
        """The contact at the time `t`, as NumPy values; arguments as of `ContactSolver.step`."""
        sample = np.empty(8, self._dtype)
        sample[0], sample[1:4], sample[4:7], sample[7] = t, force, moment, doubt
        self._packed = self._step(self._packed, sample)
        v = np.asarray(self._packed)[-12:]
        whole: Any = (v[0:3], int(v[3]), v[4], int(v[5]), v[6], v[7:10], v[10], v[11])
        return Contact(*whole)
