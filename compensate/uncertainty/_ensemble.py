"""Many models run backwards side by side: a mean and a spread."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, register
from hysteresis._parameter import is_concrete
from hysteresis._type_variables import PyTree

from .._contract import AbstractCompensator, Status, in_few_lengths
from ..inverses import inverse_of
from ..inverses._law import UncertainEstimate


@register
class EnsembleCompensator(AbstractCompensator[PyTree, UncertainEstimate]):
    """The inverses of all draws of a model, side by side: value and deviation are their mean and spread.

    All draws see the same reading. Of its noise see `filtered`.

    Where any draw's status is not OK, the commonest of those is told: one draw that is held already
    cuts the band short.

    **Arguments:**

    - `models`: one model with a leading draw axis on every array, such as `Posterior.model`.
    - `inverse`: makes the compensator of one model, e.g. `lambda m: BracketedCompensator(m, 0, 1)`.

    Raises `InputError` where the first draw has no inverse.

    **Example:**

        >>> draws = jax.tree.map(lambda x: jnp.stack([x, 1.1 * x]), model)
        >>> compensate.internal.EnsembleCompensator(draws).simulate(t, model.simulate(t, u)).draws.shape
        (2, 13)
    """

    members: AbstractCompensator

    def __init__(
        self,
        models: AbstractModel,
        inverse: Callable[[AbstractModel], AbstractCompensator] = inverse_of,
    ):
        models = jax.tree.map(jnp.asarray, models)
        inverse(jax.tree.map(lambda leaf: leaf[0], models))  # looks at numbers, which vmap hides
        draws = jax.tree.leaves(models)[0].shape[0]

        # What all draws share, such as nodes, stays known before JAX runs: ranges are read from it.
        def is_shared(leaf: Array) -> bool:
            return is_concrete(leaf) and bool((np.asarray(leaf) == np.asarray(leaf)[:1]).all())

        shared, drawn = eqx.partition(models, jax.tree.map(is_shared, models))
        shared = jax.tree.map(lambda leaf: leaf[0], shared)
        make = eqx.filter_vmap(lambda own: inverse(eqx.combine(own, shared)), axis_size=draws)
        self.members = make(drawn)

    def init(self) -> PyTree:
        """The draws' own states."""
        return eqx.filter_vmap(lambda member: member.init())(self.members)

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: PyTree
    ) -> tuple[PyTree, UncertainEstimate]:
        t = None if t is None else jnp.asarray(t, float)
        return in_few_lengths(_run, self.members, state, t, jnp.asarray(y, float), along=-1)


def _run(members: AbstractCompensator, state: PyTree, t: Array | None, y: Array) -> Any:
    state, found = eqx.filter_vmap(lambda one, own: one.stream(t, y, own))(members, state)
    return state, _together(found)


@jax.jit
def _together(found: Any) -> UncertainEstimate:
    votes = jnp.stack([(found.status == s).sum(0) for s in Status if s != Status.OK])
    codes = jnp.asarray([s for s in Status if s != Status.OK], found.status.dtype)
    status = jnp.where(votes.max(0) > 0, codes[votes.argmax(0)], Status.OK)
    value = found.value
    return UncertainEstimate(value.mean(0), status, value.std(0), value)
