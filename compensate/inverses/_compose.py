"""Inverses of composed models of which a part is no law: of a chain the chain of inverses."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, Mixture, Scaled, Series, Sum, register
from hysteresis._parameter import is_concrete
from hysteresis._type_variables import PyTree
from hysteresis.trees import input_range, search_range

from .._contract import AbstractCompensator, Estimate, Status
from .._readings import reading_of, with_reading
from ._bisection import BracketedCompensator
from ._default import check_rises
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

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: tuple[PyTree, ...]
    ) -> tuple[tuple[PyTree, ...], Estimate]:
        y = jnp.asarray(y, float)
        after, estimate = [], Estimate(reading_of(y, 1), jnp.zeros(y.shape[:1], int))
        for k, (inverse, own) in enumerate(zip(self.inverses, state, strict=True), 1):
            # Nothing, where the one before had nothing, so that the next one's clock rests.
            seen = jnp.where(estimate.status == Status.INVALID, jnp.nan, estimate.value)
            last = k == len(self.inverses)
            own, found = inverse.stream(t, with_reading(y, 1, seen) if last else seen, own)
            after.append(own)
            status = jnp.where(estimate.status == Status.OK, found.status, estimate.status)
            estimate = Estimate(found.value, status)
        return tuple(after), estimate


class Unscaled(AbstractCompensator[tuple[()], Estimate]):
    """(y - offset) / factor."""

    factor: Float[Array, ""]
    offset: Float[Array, ""]

    def init(self) -> tuple[()]:
        return ()

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: tuple[()]
    ) -> tuple[tuple[()], Estimate]:
        value = (jnp.asarray(y, float) - self.offset) / self.factor
        return state, Estimate(value, jnp.zeros(value.shape, int))


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
    outer = Unscaled(jnp.asarray(model.factor), jnp.asarray(model.offset))
    return SeriesCompensator((outer, inner))


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
    if any(map(_falls, model.parts)):
        check_rises(model)
    return LawCompensator(model) if has_laws(model) else BracketedCompensator(model, *ends)


@inverse_of.register
def _(model: Mixture) -> AbstractCompensator:
    if len(model.models) == 1:
        return inverse_of(model.whole.parts[0])
    if any(map(_falls, model.models)):
        check_rises(model)
    return (
        LawCompensator(model)
        if has_laws(model)
        else BracketedCompensator(model, *search_range(model))
    )


def _falls(model: AbstractModel) -> bool:
    """Whether the output of a model falls as its input rises, by its scales."""
    if isinstance(model, Scaled):
        return _falls(model.inner) != bool(is_concrete(model.factor) and np.all(model.factor < 0))
    if isinstance(model, Series):
        return sum(map(_falls, model.parts)) % 2 == 1
    return isinstance(model, Sum) and any(map(_falls, model.parts))
