"""Inverses of composed models of which a part is no law: of a chain the chain of inverses."""

import jax.numpy as jnp
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import (
    InputError,
    Scaled,
    Series,
    Sum,
    is_concrete,
    register,
)
from hysteresis._type_variables import PyTree
from hysteresis.trees import input_range, search_range

from .._contract import AbstractCompensator, Estimate, State, Status
from .._readings import reading_of, with_reading
from ._bisection import BracketedCompensator
from ._inverse_of import inverse_of
from ._law import LawCompensator, has_laws


@register
class SeriesCompensator(AbstractCompensator[tuple[PyTree, ...], Estimate]):
    """The last stage's inverse first, the first stage's last. Of several statuses the first that is not OK.

    A condition beside the reading goes to the first stage, which is the one that may depend on it.

    - `inverses`: of the stages, last to first.
    """

    inverses: tuple[AbstractCompensator, ...]

    def init(self) -> tuple[PyTree, ...]:
        return tuple(inverse.init() for inverse in self.inverses)

    def step(
        self, state: tuple[PyTree, ...], t: ArrayLike | None, y: ArrayLike
    ) -> tuple[tuple[PyTree, ...], Estimate]:
        y = jnp.asarray(y, float)
        after, estimate = [], Estimate(reading_of(y, 0), jnp.asarray(Status.OK, int))
        for k, (inverse, own) in enumerate(zip(self.inverses, state, strict=True), 1):
            seen = _passed_on(estimate)
            last = k == len(self.inverses)
            own, found = inverse.step(own, t, with_reading(y, 0, seen) if last else seen)
            after.append(own)
            estimate = _first_said(estimate, found)
        return tuple(after), estimate

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: tuple[PyTree, ...] | None = None
    ) -> Estimate:
        y = jnp.asarray(y, float)
        estimate = Estimate(reading_of(y, 1), jnp.zeros(y.shape[:1], int))
        states = (None,) * len(self.inverses) if state is None else state
        for k, (inverse, own) in enumerate(zip(self.inverses, states, strict=True), 1):
            seen = _passed_on(estimate)
            last = k == len(self.inverses)
            found = inverse.simulate(t, with_reading(y, 1, seen) if last else seen, own)
            estimate = _first_said(estimate, found)
        return estimate


@register
class ScaledCompensator(AbstractCompensator[State, Estimate]):
    """The inner model's inverse of (y - offset) / factor."""

    inner: AbstractCompensator[State, Estimate]
    factor: Float[Array, ""]
    offset: Float[Array, ""]

    def init(self) -> State:
        return self.inner.init()

    def step(self, state: State, t: ArrayLike | None, y: ArrayLike) -> tuple[State, Estimate]:
        return self.inner.step(state, t, self._inner_reading(jnp.asarray(y, float), 0))

    def simulate(self, t: ArrayLike | None, y: ArrayLike, state: State | None = None) -> Estimate:
        return self.inner.simulate(t, self._inner_reading(jnp.asarray(y, float), 1), state)

    def _inner_reading(self, y: Array, dimensions: int) -> Array:
        return with_reading(y, dimensions, (reading_of(y, dimensions) - self.offset) / self.factor)


def _passed_on(estimate: Estimate) -> Array:
    """What the next stage is given: nothing, where the one before had nothing, so that its clock rests."""
    return jnp.where(estimate.status == Status.INVALID, jnp.nan, estimate.value)


def _first_said(before: Estimate, now: Estimate) -> Estimate:
    return Estimate(now.value, jnp.where(before.status == Status.OK, now.status, before.status))


@inverse_of.register
def _(model: Series) -> AbstractCompensator:
    inverses = tuple(inverse_of(part) for part in reversed(model.parts))
    laws = all(isinstance(one, LawCompensator) for one in inverses)
    return LawCompensator(model) if laws else SeriesCompensator(inverses)


@inverse_of.register
def _(model: Scaled) -> AbstractCompensator:
    inner = inverse_of(model.inner)
    if isinstance(inner, LawCompensator):
        return LawCompensator(model)
    return ScaledCompensator(inner, jnp.asarray(model.factor), jnp.asarray(model.offset))


@inverse_of.register
def _(model: Sum) -> AbstractCompensator:
    if len(model.parts) == 1:
        return inverse_of(model.parts[0])
    ends = search_range(model)
    if not any(map(input_range, model.parts)) or not all(map(is_concrete, ends)):
        raise InputError(
            "not-invertible",
            "no part of the sum says over which inputs it holds, so none can be looked for.",
            fix="BracketedCompensator(model, low, high).",
        )
    return LawCompensator(model) if has_laws(model) else BracketedCompensator(model, *ends)
