"""Inverse of the Prandtl-Ishlinskii model: another one, in closed form."""

import jax
import jax.numpy as jnp
from numpy.typing import ArrayLike

from hysteresis import PlayState, PrandtlIshlinskii, register

from .._contract import AbstractCompensator, Estimate, Status, last_valid
from ._inverse_of import inverse_of
from ._rate_dependent_play import MovingThresholdsCompensator


@register
class PrandtlIshlinskiiCompensator(AbstractCompensator[PlayState, Estimate]):
    """Exact inverse of a Prandtl-Ishlinskii model: another one, of the other orientation.

    It has as many plays, which act on x = S^-1(y - offset). Let

        W_i = slope + sum_{j <= i} w_j  (lagging)   or   slope + sum_{j > i} w_j  (leading)

    be the slopes of the initial curve, W_0 that of its first piece. It is concave or convex, and its
    mirror image in the diagonal, with the corners r'_i = sum_{j <= i} W_(j-1) (r_j - r_(j-1)), is the
    initial curve of the inverse: a model of the other orientation with the weights
    w_i / (W_i W_(i-1)) and the slope 1 / max W.

    `element` is that model; it has no bends and no offset.

    Source: Krejci and Kuhnen 2001; Kuhnen 2003 for S^-1.
    """

    model: PrandtlIshlinskii
    element: PrandtlIshlinskii

    def __init__(self, model: PrandtlIshlinskii):
        r, w = model.thresholds, model.weights
        change = -w if model.leading else w
        first = model.slope + (w.sum() if model.leading else 0.0)
        after = first + jnp.cumsum(change)
        before = after - change
        corners = jnp.cumsum(before * jnp.diff(r, prepend=0.0))
        steepest = first if model.leading else after[-1]
        self.model = model
        self.element = PrandtlIshlinskii(
            corners, w / (after * before), 1 / steepest, leading=not model.leading
        )

    def init(self) -> PlayState:
        return self.element.init()

    def step(
        self, state: PlayState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[PlayState, Estimate]:
        y = jnp.asarray(y, state.u.dtype)
        valid = jnp.isfinite(y)
        # A sample that is not finite repeats the one before it, which moves no play.
        x = jnp.where(valid, self.model.unbend(y - self.model.offset), state.u)
        state, value = self.element.step(state, t, x)
        return state, Estimate(value, jnp.where(valid, Status.OK, Status.INVALID))

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: PlayState | None = None
    ) -> Estimate:
        state = self.init() if state is None else state
        y = jnp.asarray(y, state.u.dtype)
        valid, latest = last_valid(y)
        x = jax.vmap(self.model.unbend)(y - self.model.offset)
        x = jnp.where(latest < 0, state.u, x[latest])
        value = self.element.simulate(None, x, state)
        return Estimate(value, jnp.where(valid, Status.OK, Status.INVALID))


@inverse_of.register
def _(
    model: PrandtlIshlinskii,
) -> PrandtlIshlinskiiCompensator | MovingThresholdsCompensator:
    if model.rates is None:
        return PrandtlIshlinskiiCompensator(model)
    return MovingThresholdsCompensator(model)
