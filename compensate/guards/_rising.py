"""Whether a model's output rises with its input in the states that the training leaves it in.

A search for the input behind a reading needs an output that never falls while the input rises, or never
rises. Most parts do so by construction. One whose strength at a level grows faster than the rest of the
output does not: then a reading has several inputs, and a search finds any of them.

    spread = max { u2 - u1 : u1 < u2, y(s, u1) > y(s, u2) }    over states s of the training, u in its range

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
from ._run_in import Past, driven, first_draw, thinned

STATES, LEVELS = 256, 257
"""States at most, and inputs: a hundredth of the range is two of their steps."""

UNTOLD = 0.01
"""Part of the range by which inputs with one output may be apart."""

ROUNDING = 1e-9
"""Part of the outputs' range by which they may fall: sums are not exact."""


def require_rising(
    compensator: AbstractCompensator, model: AbstractModel, low: float, high: float, past: Past
) -> None:
    """Raise `InputError` `not-invertible` where a search is to find inputs, and in a state of the past one
    output belongs to inputs more than a hundredth of the range apart."""
    inverses = jax.tree.leaves(compensator, is_leaf=lambda x: hasattr(x, "searches"))
    if not any(getattr(inverse, "searches", False) for inverse in inverses):
        return
    spread = spread_of(model, low, high, past)
    if spread > UNTOLD * (high - low):
        raise InputError(
            "not-invertible",
            "the model's output falls while its input rises: one output belongs to inputs up to"
            f" {spread:.3g} apart.",
            fix='fit to compensate (purpose="compensate", --purpose compensate), or another model.',
        )


def spread_of(model: AbstractModel, low: float, high: float, past: Past) -> float:
    """The greatest distance of two inputs of which the higher one has the lower output, in the input's
    unit."""
    one = first_draw(model)
    t, u = thinned(past, low)
    levels = np.linspace(low, high, LEVELS)
    looks = np.arange(len(u)) % -(-len(u) // STATES) == 0
    rows, across = (jnp.asarray(driven(one, x), float) for x in (u, levels))
    y = np.asarray(_outputs(one, t, rows, jnp.asarray(looks), across))[looks]
    y = y * np.sign((y[:, -1] - y[:, 0]).sum())
    # The first input whose output, or that of a lower one, lies above.
    above, margin = np.maximum.accumulate(y, axis=1), ROUNDING * np.ptp(y)
    first = [
        np.searchsorted(most, now + margin, "right") for most, now in zip(above, y, strict=True)
    ]
    return float((np.arange(LEVELS) - np.array(first)).max(initial=0) * (levels[1] - levels[0]))


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
