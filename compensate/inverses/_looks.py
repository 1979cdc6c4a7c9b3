"""Outputs that a model would have at other inputs, along a record."""

from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel
from hysteresis._type_variables import PyTree
from hysteresis.running import looks, numbers_of

from .._readings import with_reading
from ._law import OWN, goes_back_only, has_laws


def looks_of(
    model: AbstractModel, t: ArrayLike | None, u: Float[np.ndarray, "samples *condition"]
) -> Callable[[np.ndarray], np.ndarray]:
    """The outputs at levels of each row, (samples, levels), in the state before it; NaN at NaN."""
    times = np.zeros(len(u)) if t is None else np.asarray(t, float)
    if has_laws(model) and not goes_back_only(tree := model.tree(depth=OWN)):
        return partial(looks, numbers_of(tree), u, np.diff(times, prepend=np.nan))
    rows = jnp.asarray(times), jnp.asarray(u)
    return lambda levels: np.asarray(_scan(model, *rows, jnp.asarray(levels)))


@eqx.filter_jit
def _scan(model: AbstractModel, t: Array, u: Array, levels: Array) -> Array:
    def sample(state: PyTree, row: tuple[Array, Array, Array]) -> tuple[PyTree, Array]:
        t, u, levels = row

        def outputs() -> Array:
            each = jax.vmap(lambda v: model.step(state, t, with_reading(u, 0, v))[1])
            return jnp.where(jnp.isnan(levels), jnp.nan, each(levels))

        y = jax.lax.cond(jnp.isnan(levels).all(), lambda: levels, outputs)
        return model.step(state, t, u)[0], y

    return jax.lax.scan(sample, model.init(), (t, u, levels))[1]
