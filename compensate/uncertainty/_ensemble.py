"""Many models run backwards side by side: a mean and a spread."""

from collections.abc import Callable
from math import inf
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, register
from hysteresis._parameter import PyTree, is_concrete
from hysteresis.running import held_at_first, numbers_of
from hysteresis.trees import Tree, node

from .._contract import AbstractCompensator, Status, in_few_lengths
from ..inverses import inverse_of
from ..inverses._law import LawCompensator, UncertainEstimate


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


# An inverse that knows of noise: the model inside a filter of its input.


def filtered(
    model: AbstractModel, input_step: ArrayLike, output_sigma: ArrayLike, *, by_time: bool = False
) -> LawCompensator:
    """An extended Kalman filter of the input, for noisy readings: an inverse that knows of noise.

    It finds the input that is likeliest if it walks at random and the reading is noisy:

        u_k = u_(k-1) + N(0, Q),     y_k = h(u_k) + N(0, R),     R = output_sigma^2,

    with h the model's next output from where it is, and Q = input_step^2 a sample, or input_step^2 dt
    where `by_time`. A sample is one update of an extended Kalman filter, variance P:

    - P += Q, and H is the slope of the chord of h across u +- sqrt(P): a branch either way. A loop as
      wide as u was uncertain, up and back, opens by 2 d: what h owes to turns not seen, R += d^2.
    - u += k (h^-1(y) - u), k = H^2 P / (H^2 P + R), towards the raw inverse, and so onto it where R
      is small. P = 1 / (1/P + H^2 / R), H again about the new u, the lesser; there the corner between the
      branches is noise too.
    - The model and its inverse go on to the filtered u: noise makes no reversals in their memory.

    The deviation sqrt(P) says what noise does to an input that moves like that; one that moves faster
    lags behind, and what is wrong with the model is not in it. On lagging Preisach and Burgers models and
    walks of these statistics 90 % bands held 89 to 94 %, on a leading Preisach model 84 %: h after
    turns that were not seen is known to first order only. The status is the raw inverse's.

    The law is `hysteresis/laws/filtered.py`: a reading costs microseconds.

    **Arguments:**

    - `model`: as for `invert`, with a law.
    - `input_step`: standard deviation of the input's step per sample (or per square root of time).
    - `output_sigma`: of the reading's noise.

    **Other arguments:**

    - `by_time`: steps grow with the square root of the time between samples, which is then needed.

    Raises `InputError` for deviations that are not positive and finite, `not-invertible` for a model
    without inverse or without a law.

    **Example:**

        >>> smooth = compensate.filtered(model, input_step=1.0, output_sigma=0.01)
        >>> smooth.simulate(t, model.simulate(t, u)).deviation.shape
        (13,)
    """
    for name, value in {"input_step": input_step, "output_sigma": output_sigma}.items():
        if is_concrete(value) and not 0 < float(np.asarray(value)) < float("inf"):
            raise InputError(
                "parameter-out-of-bounds",
                f"{name} is {np.asarray(value):g}, and has to be positive and finite.",
                fix="invert(model) is the inverse that takes every reading at its word.",
            )
    if not isinstance(inverse_of(model), LawCompensator):
        raise InputError(
            "not-invertible",
            f"a {type(model).__name__} has no law, which the filter is put around.",
            fix="write its law, or low-pass the readings.",
        )

    def around(tree: Tree) -> Tree:
        step, noise = (jnp.asarray(x, float) ** 2 for x in (input_step, output_sigma))
        variances = {"step": step, "noise": noise, "by_time": int(by_time)}
        kept = np.zeros(2 * numbers_of(tree).known.states)
        state = {"value": held_at_first(tree), "variance": inf, "begun": 0, "kept": kept}
        return node("filtered", variances, state, [tree, tree])

    return LawCompensator(model, around, by_time)
