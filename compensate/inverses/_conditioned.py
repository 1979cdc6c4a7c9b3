"""Inverse of a model that depends on a condition: by bisection, given the output and the condition."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from hysteresis import (
    AbstractModel,
    Conditioned,
    InputError,
    is_concrete,
    register,
)
from hysteresis.models._conditioned import last_factor
from hysteresis.records._common_part import STILL
from hysteresis.trees import search_range, size_of

from .._contract import AbstractCompensator, Estimate, Status, scan_steps
from ._bisection import BracketedState, bracketed
from ._inverse_of import inverse_of
from ._law import LawCompensator, has_laws


@register
class ConditionedCompensator(AbstractCompensator[BracketedState, Estimate]):
    """u from the pair (y, c) by bisection of u -> model.step(state, t, (u, c)) on [low, high].

    As in `BracketedCompensator` the input nearest to the last estimate is taken where several have this
    output. Beyond the knots the condition is taken for the nearer one and the status is EXTRAPOLATED,
    unless it is less than two per cent of their range beyond. A pair with a NaN is INVALID.

    **Arguments:**

    - `model`: every one of its models rises with the input, or every one falls.
    - `low`, `high`: the inputs to look for. `falls`: whether the models fall.

    Readings are the columns of an array (samples, 2) in `simulate`, and `step` takes the pair (y, c).
    """

    model: Conditioned
    low: float = eqx.field(static=True, converter=float)
    high: float = eqx.field(static=True, converter=float)
    falls: bool = eqx.field(static=True, default=False)

    def init(self) -> BracketedState:
        return BracketedState(self.model.init(), jnp.asarray(self.low, float))

    def size(self, t: ArrayLike | None = 0.0) -> Array:
        """Of the outputs of the virgin models at the ends, the largest one."""
        return jnp.stack([size_of(one, t, self.low, self.high) for one in self.model.models]).max()

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: BracketedState | None = None
    ) -> Estimate:
        if np.ndim(y) != 2:
            raise InputError(
                "wrong-shape",
                f"readings of shape {np.shape(y)} for a model that depends on {self.model.condition!r}.",
                fix="give output and condition as the columns of an array (samples, 2).",
            )
        y = jnp.asarray(y, float)
        return scan_steps(self, t, y, self.init() if state is None else state)[1]

    def step(
        self, state: BracketedState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[BracketedState, Estimate]:
        reading, c = jnp.asarray(y, state.value.dtype)
        knots, sign = self.model.knots, -1.0 if self.falls else 1.0
        valid = jnp.isfinite(c)
        known = jnp.where(valid, c, knots[0])

        def run(own: Any, u: Array) -> tuple[Any, Array]:
            own, output = self.model.step(own, t, (u, known))
            return own, sign * output

        wanted = jnp.where(valid, sign * reading, jnp.nan)
        size = self.size(t).astype(wanted.dtype)
        after, found = bracketed(run, state, wanted, self.low, self.high, size)
        margin = STILL * (knots[-1] - knots[0])
        beyond = (known < knots[0] - margin) | (known > knots[-1] + margin)
        sound = (found.status == Status.OK) | (found.status == Status.FLAT)
        status = jnp.where(beyond & sound, Status.EXTRAPOLATED, found.status)
        return after, Estimate(found.value, status)


@inverse_of.register
def _(model: Conditioned) -> AbstractCompensator:
    for one in model.models:
        inverse_of(one)  # refuses a model that has no inverse
    falls = {_falls(one) for one in model.models}
    if len(falls) > 1:
        raise InputError(
            "not-invertible",
            f"the output rises with the input at some values of {model.condition}, and falls at others.",
            fix="fit the conditions apart (--each COL).",
        )
    if has_laws(model):
        return LawCompensator(model)
    return ConditionedCompensator(model, *search_range(model), falls.pop())


def _falls(model: AbstractModel) -> bool:
    factor = last_factor(model)
    return is_concrete(factor) and float(factor) < 0
