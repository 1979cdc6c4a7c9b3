"""How wide the flat places are: all inputs that a reading of a flat model can have come from."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel

from .._readings import reading_of, with_reading
from ..inverses._bisection import inputs_between


class FlatInterval(NamedTuple):
    """Inputs from `low` to `high` give the output that the estimate gives; `width` is their distance."""

    low: Float[Array, " samples"]
    high: Float[Array, " samples"]

    @property
    def width(self) -> Array:
        return self.high - self.low


def flat_intervals(
    model: AbstractModel,
    t: ArrayLike | None,
    estimate: ArrayLike,
    low: float,
    high: float,
    where: ArrayLike | None = None,
    tolerance: float = 1e-12,
) -> FlatInterval:
    """For each estimate u_k the inputs v within [`low`, `high`] with

        |h(v) - h(u_k)| <= tolerance (h(high) - h(low)),

    h being the model's next output after the estimates before it. The model rises with v, or falls with it
    everywhere, so that they are an interval: what a status FLAT leaves open, to be taken as
    the uncertainty of the nearest input, which is held.

    **Arguments:**

    - `t`, `estimate`: (samples,), as given to and found by `simulate`; `t` may be None without rates. Of a
      model that depends on a condition, estimate and condition, (samples, 2).
    - `where`: (samples,) bool, which estimates to look at, such as `status == Status.FLAT`; all by default.
      The interval of the others is the estimate itself.

    **Example:**

        >>> wide = compensate.flat_intervals(model, t, u, low=-10.0, high=10.0).width
        >>> bool((wide < 1e-6).all())
        True
    """
    u = jnp.asarray(estimate, float)
    clock = jnp.zeros(len(u), u.dtype) if t is None else jnp.asarray(t, u.dtype)
    looked = jnp.ones(len(u), bool) if where is None else jnp.asarray(where)
    bounds = jnp.asarray([low, high], u.dtype)
    return _intervals(model, clock, u, looked, bounds, jnp.asarray(tolerance, u.dtype))


@eqx.filter_jit
def _intervals(
    model: AbstractModel,
    t: Float[Array, " samples"],
    u: Float[Array, "samples *condition"],
    looked: Bool[Array, " samples"],
    bounds: Float[Array, " 2"],
    tolerance: Float[Array, ""],
) -> FlatInterval:
    def sample(state: Any, row: tuple[Array, Array, Array]) -> tuple[Any, FlatInterval]:
        t, driven, look = row
        u = reading_of(driven, 0)
        after, y = model.step(state, t, driven)

        def search() -> FlatInterval:
            outputs = jax.vmap(lambda v: model.step(state, t, with_reading(driven, 0, v))[1])
            least, greatest = outputs(bounds)
            # Of a model that falls, what is mirrored rises.
            way = jnp.where(greatest < least, -1.0, 1.0).astype(u.dtype)
            margin = tolerance * jnp.abs(greatest - least)
            wanted = jnp.stack([way * y - margin, way * y + margin])
            first, last = inputs_between(lambda v: way * outputs(v), bounds, wanted)
            return FlatInterval(jnp.minimum(first, u), jnp.maximum(last, u))

        return after, jax.lax.cond(look, search, lambda: FlatInterval(u, u))

    return jax.lax.scan(sample, model.init(), (t, u, looked))[1]
