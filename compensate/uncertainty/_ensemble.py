"""Many models run backwards side by side: a mean and a spread."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, register
from hysteresis._parameter import is_concrete

from .._contract import AbstractCompensator, Status
from .._readings import reading_of, with_reading
from ..inverses import inverse_of
from ..inverses._law import UncertainEstimate


class EnsembleState(NamedTuple):
    """The draws' own states, and how many samples with a reading there were."""

    members: Any
    count: Array


@register
class EnsembleCompensator(AbstractCompensator[EnsembleState, UncertainEstimate]):
    """The inverses of all draws of a model, side by side: value and deviation are their mean and spread.

    Draw d sees the reading y_k + sigma_d n_dk, n standard normal by (`seed`, d, k) alone, so that a
    stream equals the batch: the spread is the model's and the reading's together. Raw inverses take
    noise for reversals, and the reading has its own already: see `filtered`.

    Where any draw's status is not OK, the commonest of those is told: one draw that is held already
    cuts the band short.

    **Arguments:**

    - `models`: one model with a leading draw axis on every array, such as `Posterior.model`.
    - `output_sigma`: standard deviation of the reading's noise, () or (draws,); None for none.
    - `seed`: of that noise.
    - `inverse`: makes the compensator of one model, e.g. `lambda m: BracketedCompensator(m, 0, 1)`.

    Raises `InputError` where the first draw has no inverse, or a deviation is negative or not finite.

    **Example:**

        >>> draws = jax.tree.map(lambda x: jnp.stack([x, 1.1 * x]), model)
        >>> compensate.internal.EnsembleCompensator(draws).simulate(t, model.simulate(t, u)).draws.shape
        (2, 13)
    """

    members: AbstractCompensator
    output_sigma: Float[Array, " draws"]
    seed: int = eqx.field(static=True)

    def __init__(
        self,
        models: AbstractModel,
        output_sigma: ArrayLike | None = None,
        seed: int = 0,
        inverse: Callable[[AbstractModel], AbstractCompensator] = inverse_of,
    ):
        models = jax.tree.map(jnp.asarray, models)
        inverse(jax.tree.map(lambda leaf: leaf[0], models))  # looks at numbers, which vmap hides
        draws = jax.tree.leaves(models)[0].shape[0]
        # What all draws share, such as nodes, stays known before JAX runs: ranges are read from it.
        same = jax.tree.map(_is_shared, models)
        shared, drawn = eqx.partition(models, same)
        shared = jax.tree.map(lambda leaf: leaf[0], shared)
        make = eqx.filter_vmap(lambda own: inverse(eqx.combine(own, shared)), axis_size=draws)
        self.members, self.seed = make(drawn), seed
        sigma = np.asarray(0.0 if output_sigma is None else output_sigma, float)
        if sigma.shape not in ((), (draws,)) or not (np.isfinite(sigma) & (sigma >= 0)).all():
            raise InputError(
                "bad-deviation",
                f"output_sigma is no standard deviation for each of {draws} draws.",
                fix="give one number, or one for each draw, none negative.",
            )
        self.output_sigma = jnp.asarray(np.broadcast_to(sigma, (draws,)))

    def init(self) -> EnsembleState:
        members = eqx.filter_vmap(lambda member: member.init())(self.members)
        return EnsembleState(members, jnp.asarray(0))

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: EnsembleState
    ) -> tuple[EnsembleState, UncertainEstimate]:
        y = jnp.asarray(y, float)
        run = eqx.filter_vmap(lambda member, own, reading: member.stream(t, reading, own))
        members, found = run(self.members, state.members, self._all_readings(y, state.count))
        count = state.count + jnp.isfinite(reading_of(y, 1)).sum().astype(state.count.dtype)
        return EnsembleState(members, count), _together(found)

    @eqx.filter_jit
    def _all_readings(
        self, y: Array, count: Int[Array, ""]
    ) -> Float[Array, "draws samples *condition"]:
        valid = jnp.isfinite(reading_of(y, 1)).astype(count.dtype)
        counts = count + jnp.cumsum(valid) - valid
        return jnp.swapaxes(jax.vmap(self._readings)(y, counts), 0, 1)

    def _readings(self, y: Array, count: Int[Array, ""]) -> Float[Array, "draws *condition"]:
        """A sample without reading uses up no noise; a condition beside it has none."""
        key = jax.random.fold_in(jax.random.key(self.seed), count)
        noise = self.output_sigma * jax.random.normal(key, self.output_sigma.shape, y.dtype)
        reading = reading_of(y, 0) + noise
        return with_reading(jnp.broadcast_to(y, (*noise.shape, *y.shape)), 1, reading)


def _is_shared(leaf: Array) -> bool:
    return is_concrete(leaf) and bool((np.asarray(leaf) == np.asarray(leaf)[:1]).all())


@jax.jit
def _together(found: Any) -> UncertainEstimate:
    votes = jnp.stack([(found.status == s).sum(0) for s in Status if s != Status.OK])
    codes = jnp.asarray([s for s in Status if s != Status.OK], found.status.dtype)
    status = jnp.where(votes.max(0) > 0, codes[votes.argmax(0)], Status.OK)
    value = found.value
    return UncertainEstimate(value.mean(0), status, value.std(0), value)
