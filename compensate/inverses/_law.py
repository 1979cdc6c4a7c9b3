"""The inverse of every model that is a tree of laws: what they find behind each reading, one by one, alone
or with a law around them that says how far off that is.

    u_k = find(state, dt_k, y_k),     state <- what the laws remember then

The laws' own text runs, compiled where that pays (`hysteresis.running`): the same text as in an exported
compensator. Cost: 0.1 to 4 microseconds a reading.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, register
from hysteresis._law_model import OWN
from hysteresis._parameter import PyTree, array_module, as_array, as_float
from hysteresis.models._conditioned import Conditioned, condition_of
from hysteresis.models._viscoelastic import AbstractViscoelastic
from hysteresis.records._branch_rows import STILL
from hysteresis.running import (
    Known,
    Numbers,
    Told,
    estimates,
    held_at_first,
    looks,
    numbers_of,
    told,
)
from hysteresis.trees import Tree

from .._contract import AbstractCompensator, Estimate, Found, Status
from .._readings import with_reading


class UncertainEstimate(NamedTuple):
    """An `Estimate` with its error: the standard `deviation`, and where there are any, `draws`."""

    value: Float[Array, "*samples"]
    status: Int[Array, "*samples"]
    deviation: Float[Array, "*samples"]
    draws: Float[Array, "draws *samples"] | None = None

    def quantile(self, q: ArrayLike) -> Array:
        """The input's quantiles, (*q, *samples): of the draws, else value + deviation Phi^-1(q)."""
        q = jnp.asarray(q, float)
        if self.draws is not None:
            return jnp.quantile(self.draws, q, axis=0)
        away = jnp.multiply.outer(jax.scipy.special.ndtri(q), self.deviation)
        return away + jnp.expand_dims(self.value, range(q.ndim))


class LawState(NamedTuple):
    """What the laws remember, the time of the last reading (NaN before the first), the last estimate."""

    numbers: Float[Array, " state"]
    t: Float[Array, ""]
    value: Float[Array, ""]


def first_state(numbers: Numbers, held: Array) -> LawState:
    """Before any reading."""
    return LawState(as_array(numbers.state), jnp.asarray(jnp.nan, float), held)


def told_from(
    state: LawState, numbers: Numbers, t: ArrayLike | None, y: Any, width: int
) -> tuple[LawState, Told]:
    """The state after readings, and what a law around the model's says of them: so many numbers."""
    xp: Any = array_module(t, y)
    times = xp.zeros(y.shape[:1]) if t is None else xp.asarray(t, float)
    found = told(numbers, *state, times, y, width=width)
    held = found.value[-1] if len(times) else state.value
    return LawState(*map(as_array, (found.state, found.t, held))), found


@register
class LawCompensator(AbstractCompensator[LawState, Found]):
    """The inverse of a model that is a tree of laws, reading by reading, with the model's own memory.

    ```math
    \\hat u_k = \\mathrm{find}(\\text{state}, t_k - t_{k-1}, y_k)
    ```

    Where an output belongs to several inputs the one nearest to the last estimate is taken, and the status
    is FLAT. A reading that is not finite is INVALID: the last estimate is held.

    Derivatives by parameters are exact; by readings they are forward only.

    **Arguments:**

    - `model`: any model whose laws have an inverse.
    - `around`: a law and its numbers around the model's own two trees, from input to output and back, which
      tells a deviation beside each estimate: those are then an `UncertainEstimate`, without derivatives.
    - `by_time`: whether that law needs times.

    **Raises:** `InputError` `not-exportable` where no law is known for a part of the model.
    """

    model: AbstractModel
    numbers: Float[Array, " numbers"]
    known: Known = eqx.field(static=True)
    held: Float[Array, ""]
    deviates: bool = eqx.field(static=True)
    by_time: bool = eqx.field(static=True)

    def __init__(
        self,
        model: AbstractModel,
        around: Callable[[Tree], Tree] | None = None,
        by_time: bool = False,
    ):
        tree = model.tree(depth=OWN)
        numbers = numbers_of(tree if around is None else around(tree))
        self.model, self.known = model, numbers.known
        self.numbers = as_float(numbers.m)
        self.held = jnp.asarray(held_at_first(tree), float)
        self.deviates, self.by_time = around is not None, by_time

    @property
    def searches(self) -> bool:
        """Whether inputs are looked for, because some law has no inverse of its own."""
        return "sum" in self.known.structure.kinds()

    def init(self) -> LawState:
        return first_state(Numbers(self.known, self.numbers), self.held)

    def stream(self, t: ArrayLike | None, y: ArrayLike, state: LawState) -> tuple[LawState, Found]:
        require_columns(self.model, y)
        if t is None and self.by_time:
            raise InputError("no-time", "steps by time need the times.", fix="give t.")
        if t is None and np.shape(y)[0]:
            # A model that depends on the rate refuses.
            self.model.prepare(None, jnp.zeros(np.shape(y)))
        read: Any = self._told if self.deviates else self._found
        return read(t, y, state)

    def _told(
        self, t: ArrayLike | None, y: ArrayLike, state: LawState
    ) -> tuple[LawState, UncertainEstimate]:
        xp = array_module(t, y)
        given: Any = xp.asarray(y, float)
        whole = xp.isfinite(given) if given.ndim == 1 else xp.isfinite(given).all(1, keepdims=True)
        readings = xp.where(whole, given, np.nan)
        after, found = told_from(state, Numbers(self.known, self.numbers), t, readings, width=1)
        status = told_of_condition(self.model, given, found.status)
        return after, UncertainEstimate(*map(as_array, (found.value, status, found.said[:, 0])))

    def _found(
        self, t: ArrayLike | None, y: ArrayLike, state: LawState
    ) -> tuple[LawState, Estimate]:
        xp = array_module(t, y, *state, self.numbers)
        given: Any = xp.asarray(y, float)
        own, before, held = (xp.asarray(x) for x in state)
        times: Any = xp.zeros(given.shape[:1]) if t is None else xp.asarray(t, given.dtype)
        if xp is np:
            self._check_steps(times)
        numbers = Numbers(self.known, self.numbers).with_state(own)
        found = estimates(numbers, given, xp.diff(times, prepend=before), held)
        valid = xp.isfinite(given) if given.ndim == 1 else xp.isfinite(given).all(axis=1)
        latest = xp.where(valid, xp.arange(len(times)), -1).max(initial=-1)
        last = xp.where(latest < 0, before, times[latest] if len(times) else before)
        held = found.value[-1] if len(times) else held
        own = numbers._replace(m=found.m).state
        after = LawState(*map(as_array, (own, last, held)))
        status = told_of_condition(self.model, given, found.status)
        return after, Estimate(as_array(found.value), as_array(status))

    def _check_steps(self, t: np.ndarray) -> None:
        limit, largest = stable_step(self.model), float(np.diff(t).max(initial=0.0))
        if largest > limit:
            raise InputError(
                "unstable-step",
                f"the inverse grows without bound at time steps of {largest:g}.",
                cause='with hold="constant" a step must stay short beside the element\'s own times.',
                fix=f'sample at steps below {limit:.4g}, or use hold="linear".',
            )


def require_columns(model: AbstractModel, y: ArrayLike) -> None:
    """Raise `InputError` `wrong-shape` where readings are not beside the condition that a model needs."""
    needs = 1 if condition_of(model) is None else 2
    if np.ndim(y) != needs:
        raise InputError(
            "wrong-shape",
            f"readings of shape {np.shape(y)}.",
            fix="give (samples,); of a model that depends on a condition (samples, 2), beside it.",
        )


def told_of_condition(model: AbstractModel, y: Any, status: Any) -> Any:
    """Statuses that say where the condition, the second column of y, is beyond the model's."""
    if (conditioned := condition_of(model)) is None:
        return status
    sound = (status == Status.OK) | (status == Status.FLAT)
    beyond = beyond_knots(conditioned, y) & sound
    return array_module(beyond).where(beyond, Status.EXTRAPOLATED, status)


def beyond_knots(conditioned: Conditioned, y: Array | np.ndarray) -> Any:
    """Where the condition, the second column of y, is beyond the trained ones."""
    knots, c = array_module(y, conditioned.knots).asarray(conditioned.knots), y[:, 1]
    margin = STILL * (knots[-1] - knots[0])
    return (c < knots[0] - margin) | (c > knots[-1] + margin)


def goes_back_only(tree: Tree) -> bool:
    """Whether a tree runs from outputs to inputs alone."""
    return tree["kind"] in ("feedback", "oscillator") or any(
        map(goes_back_only, tree.get("parts", ()))
    )


def has_laws(model: AbstractModel) -> bool:
    """Whether the model and all of its parts are laws."""
    try:
        model.tree()
    except InputError as error:
        if error.code != "not-exportable":
            raise
        return False
    return True


def stable_step(model: AbstractModel) -> float:
    """The largest step at which estimates do not grow without bound; infinite of other models."""
    if isinstance(model, AbstractViscoelastic) and not model.against_chain:
        return replace(model, leading=not model.leading).largest_stable_step()
    return float("inf")


# Outputs that a model would have at other inputs, along a record.


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
