"""Inverse of the rate-dependent Prandtl-Ishlinskii model: step by step, with the model's own plays."""

import jax
import jax.numpy as jnp
from jaxtyping import Array
from numpy.typing import ArrayLike

from hysteresis import PlayState, PrandtlIshlinskii, register

from .._contract import AbstractCompensator, Estimate, Status, scan_steps


@register
class MovingThresholdsCompensator(AbstractCompensator[PlayState, Estimate]):
    """u from y, exactly, for thresholds r that are known before the input, as the model's are.

    A step solves x = slope u + sum_i w_i clip(z_i, u - r_i, u + r_i), x = S^-1(y - offset), whose right
    side rises with u. Play i is dragged along iff u > z_i + r_i or u < z_i - r_i, that is iff x lies
    beyond the right side there; once it is known for every play the equation is linear.

    The plays of the rate-independent inverse are not used here: the inverse of a composition needs
    thresholds whose distances never shrink, and these shrink whenever the input slows down (off by 2 %
    of the range on random inputs).
    """

    model: PrandtlIshlinskii

    def init(self) -> PlayState:
        return self.model.init()

    def step(
        self, state: PlayState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[PlayState, Estimate]:
        y = jnp.asarray(y, state.u.dtype)
        valid = jnp.isfinite(y)
        u = self._solve(state, self.model.unbend(y - self.model.offset))
        after, _ = self.model.step(state, t, u)
        # A sample that is not finite leaves no trace, not even the time it was taken at.
        after = jax.tree.map(lambda new, old: jnp.where(valid, new, old), after, state)
        return after, Estimate(after.u, jnp.where(valid, Status.OK, Status.INVALID))

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: PlayState | None = None
    ) -> Estimate:
        t, y = self.model.check_times(t), jnp.asarray(y, float)
        return scan_steps(self, t, y, self.init() if state is None else state)[1]

    def _solve(self, state: PlayState, x: Array) -> Array:
        z, r = state.z, self.model.thresholds_at(state.speed)
        w, slope = self.model.weights, self.model.slope
        if self.model.leading:  # sum_i w_i (u - z_i) in terms of plays
            w, slope = -w, slope + w.sum()

        def right_side(u: Array) -> Array:
            return slope * u + jnp.dot(w, jnp.clip(z, u - r, u + r))

        up = jax.vmap(right_side)(z + r) < x
        down = jax.vmap(right_side)(z - r) > x
        # A play at rest stays at z_i; a dragged one is at u - r_i or u + r_i.
        known = jnp.where(up, -r, jnp.where(down, r, z))
        moving = jnp.where(up | down, w, 0).sum()
        return (x - jnp.dot(w, known)) / (slope + moving)
