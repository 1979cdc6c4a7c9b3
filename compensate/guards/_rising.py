"""Whether a model's output rises with its input in the states that the training leaves it in.

A search for the input behind a reading needs an output that never falls while the input rises, or never
rises. Most parts do so by construction. One whose strength at a level grows faster than the rest of the
output does not: then a reading has several inputs, and a search finds any of them.

    fall = max { y(s, u1) - y(s, u2) : u1 < u2 }    over states s of the training, u in its range

Cost: a step of the model for each sample, and STATES x LEVELS looks.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError

from .._contract import AbstractCompensator
from ..inverses._bisection import BracketedCompensator
from ._run_in import PAST, Past, driven, first_draw, thinned

STATES, LEVELS = 256, 129
"""States at most, and inputs: a hundredth of the range is more than their step."""


def require_rising(
    compensator: AbstractCompensator,
    model: AbstractModel,
    low: float,
    high: float,
    past: Past,
    within: float,
) -> None:
    """Raise `InputError` `not-invertible` where a search is to find inputs, and the output falls by more
    than `within` of the input changes it on average."""
    leaves = jax.tree.leaves(compensator, is_leaf=lambda x: isinstance(x, BracketedCompensator))
    if not any(isinstance(leaf, BracketedCompensator) for leaf in leaves):
        return
    part = fall_of(model, low, high, past)
    if part * (high - low) > within:
        raise InputError(
            "not-invertible",
            f"the model's output falls by up to {100 * part:.2g} % of its range while the input rises, so a"
            " reading has several inputs.",
            fix='fit to compensate (purpose="compensate", --purpose compensate), or another model.',
        )


def fall_of(model: AbstractModel, low: float, high: float, past: Past) -> float:
    """By how much the output falls at most while the input rises, in parts of the outputs' range."""
    one = first_draw(model)
    t, u = thinned(past, low, PAST)
    levels = np.linspace(low, high, LEVELS)
    looks = np.arange(len(u)) % -(-len(u) // STATES) == 0
    rows, across = (jnp.asarray(driven(one, x), float) for x in (u, levels))
    y = np.asarray(_outputs(one, t, rows, jnp.asarray(looks), across))[looks]
    y = y * np.sign((y[:, -1] - y[:, 0]).sum())
    return float((np.maximum.accumulate(y, axis=1) - y).max() / np.ptp(y))


@eqx.filter_jit
def _outputs(
    model: AbstractModel,
    t: ArrayLike | None,
    u: Float[Array, "samples *condition"],
    looks: Bool[Array, " samples"],
    levels: Float[Array, "levels *condition"],
) -> Float[Array, "samples levels"]:
    """At every level, in the state before every sample that is looked at; 0 elsewhere."""
    none = jnp.zeros(len(levels))

    def sample(state: Any, row: tuple[Array | None, Array, Array]) -> tuple[Any, Array]:
        t, u, look = row

        def outputs() -> Array:
            return jax.vmap(lambda level: model.step(state, t, level)[1])(levels)

        return model.step(state, t, u)[0], jax.lax.cond(look, outputs, lambda: none)

    times = None if t is None else jnp.asarray(t, float)
    return jax.lax.scan(sample, model.init(), (times, u, looks))[1]
