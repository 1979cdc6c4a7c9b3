"""Models written sample by sample: `init` and `step`, everything else is given."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._model import AbstractModel, Series, is_start
from ._type_variables import State


class SteppedInput(NamedTuple):
    """Times or None, inputs, where sequences start, and the state they start in."""

    t: Array | None
    u: Array
    start: Array
    state: Any


class AbstractSteppedModel(AbstractModel[State, SteppedInput]):
    """A model that is written as `init` and `step`; `prepare` and `evaluate` follow from them.

    The state that `init` returns is a pytree of floating arrays or numbers, and `step` returns one of the
    same shape. `evaluate` runs `step` in one compiled loop over the samples, and begins again in the
    prepared state wherever a sequence starts. Without times (`t=None`), `step` is called with None: a model
    that depends on the rate must raise `InputError` then.
    """

    def prepare(
        self,
        t: Series | None,
        u: Series,
        state: State | None = None,
        *,
        starts: tuple[int, ...] = (0,),
    ) -> SteppedInput:
        before: Any = jax.tree.map(jnp.asarray, self.init() if state is None else state)
        leaves = jax.tree.leaves(before)
        dtype = jnp.result_type(*leaves) if leaves else float
        u = jnp.asarray(u, dtype)
        if t is None:
            # Where the rate matters, a step without a time raises.
            jax.eval_shape(self.step, before, None, jnp.zeros(u.shape[1:]))
        else:
            t = jnp.asarray(t, dtype)
        return SteppedInput(t, u, is_start(len(u), starts) > 0, before)

    def evaluate(self, prepared: SteppedInput) -> Float[Array, " samples"]:
        def sample(state: State, at: tuple[Any, Array, Array]) -> tuple[State, Array]:
            t, u, start = at
            before = jax.tree.map(lambda a, b: jnp.where(start, a, b), prepared.state, state)
            return self.step(before, t, u)

        return jax.lax.scan(sample, prepared.state, (prepared.t, prepared.u, prepared.start))[1]
