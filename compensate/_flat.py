"""How wide the flat places are: all inputs that a reading of a flat model can have come from."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from hysteresis import AbstractModel

_ROUNDS = 60
"""Of bisection: beyond the last bit of a double."""


class FlatInterval(NamedTuple):
    """Inputs from `low` to `high` give the output that the estimate gives; `width` is their distance."""

    low: Float[Array, " samples"]
    high: Float[Array, " samples"]

    @property
    def width(self) -> Array:
        return self.high - self.low


def flat_intervals(
    model: AbstractModel,
    t: Any,
    estimate: Any,
    low: float,
    high: float,
    where: Any = None,
    tolerance: float = 1e-12,
) -> FlatInterval:
    """For each estimate u_k the inputs v within [`low`, `high`] with

        |h(v) - h(u_k)| <= tolerance (h(high) - h(low)),

    h being the model's next output after the estimates before it. The model rises with v, or falls with it
    everywhere, so that they are an interval: what a status FLAT leaves open, to be taken as
    the uncertainty of the nearest input, which is held.

    **Arguments:**

    - `t`, `estimate`: (samples,), as given to and found by `simulate`; `t` may be None without rates.
    - `where`: (samples,) bool, which estimates to look at, such as `status == Status.FLAT`; all by default.
      The interval of the others is the estimate itself.
    """
    u = jnp.asarray(estimate, float)
    clock = jnp.zeros_like(u) if t is None else jnp.asarray(t, u.dtype)
    looked = jnp.ones(u.shape, bool) if where is None else jnp.asarray(where)
    bounds = jnp.asarray([low, high], u.dtype)
    return _intervals(model, clock, u, looked, bounds, jnp.asarray(tolerance, u.dtype))


@eqx.filter_jit
def _intervals(
    model: AbstractModel,
    t: Float[Array, " samples"],
    u: Float[Array, " samples"],
    looked: Bool[Array, " samples"],
    bounds: Float[Array, " 2"],
    tolerance: Float[Array, ""],
) -> FlatInterval:
    def sample(state: Any, row: tuple[Array, Array, Array]) -> tuple[Any, FlatInterval]:
        t, u, look = row
        after, y = model.step(state, t, u)

        def output(v: Array) -> Array:
            return model.step(state, t, v)[1]

        span = jnp.abs(output(bounds[1]) - output(bounds[0]))

        def as_far_as(bound: Array) -> Array:
            def halve(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
                same, other = ends
                middle = 0.5 * (same + other)
                alike = jnp.abs(output(middle) - y) <= tolerance * span
                return jnp.where(alike, middle, same), jnp.where(alike, other, middle)

            whole = jnp.abs(output(bound) - y) <= tolerance * span
            return jnp.where(whole, bound, jax.lax.fori_loop(0, _ROUNDS, halve, (u, bound))[0])

        def search() -> FlatInterval:
            return FlatInterval(
                as_far_as(jnp.minimum(u, bounds[0])), as_far_as(jnp.maximum(u, bounds[1]))
            )

        return after, jax.lax.cond(look, search, lambda: FlatInterval(u, u))

    return jax.lax.scan(sample, model.init(), (t, u, looked))[1]
