"""The open loops of a running Preisach model: a stack of reversals of fixed capacity.

The forward model and its inverse keep the same stack; one sees where the input goes, the other
where the output does.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ._everett import read


class OpenLoops(NamedTuple):
    """Reversals whose loops are not closed yet, oldest first.

    - `extremum`, `level` (capacity,): input and output at each; entry 0 is the negative saturation.
    - `depth`: the number of entries in use.
    - `dropped`: the number of loops that were forgotten because the stack was full.
    """

    extremum: Array
    level: Array
    depth: Array
    dropped: Array

    @classmethod
    def none(cls, capacity: int, u: Array, y: Array) -> "OpenLoops":
        """A stack that holds only the saturation, at input `u` and output `y`."""
        empty, one = jnp.zeros(capacity), jnp.asarray(1, jnp.int32)
        return cls(empty.at[0].set(u), empty.at[0].set(y), one, one - 1)

    @property
    def anchor(self) -> tuple[Array, Array]:
        """Input and output where the present branch started."""
        return read(self.extremum, self.depth - 1), read(self.level, self.depth - 1)

    def push(self, when: Array, u: Array, y: Array) -> "OpenLoops":
        """Open a loop at (u, y) `when` the direction turned; a full stack forgets its smallest."""
        full = when & (self.depth >= self.extremum.shape[0])
        depth = jnp.where(full, self.depth - 2, self.depth)
        top = jnp.where(when, depth, depth - 1)
        return OpenLoops(
            self.extremum.at[top].set(jnp.where(when, u, read(self.extremum, top))),
            self.level.at[top].set(jnp.where(when, y, read(self.level, top))),
            jnp.where(when, depth + 1, depth),
            jnp.where(full, self.dropped + 1, self.dropped),
        )

    def wipe_out(self, passed: Callable[[Array, Array], Array]) -> "OpenLoops":
        """Close the innermost loop as long as its older reversal (u, y) is `passed`."""

        def closes(depth: Array) -> Array:
            older = jnp.maximum(depth - 2, 0)
            return (depth >= 3) & passed(read(self.extremum, older), read(self.level, older))

        # Two reversals leave at a time. The loop carries only the integer, because XLA would copy arrays.
        depth = jax.lax.while_loop(closes, lambda depth: depth - 2, self.depth)
        return self._replace(depth=depth)
