"""Models made of models: side by side, one behind the other, scaled."""

import abc
from collections.abc import Callable, Iterable
from functools import reduce
from itertools import chain
from operator import add
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .. import trees
from .._errors import InputError
from .._model import AbstractFollowingModel, AbstractModel, Tree
from .._model import Series as Inputs
from .._parameter import (
    Output,
    Prepared,
    Scalar,
    Starts,
    State,
    Times,
    array_module,
    as_array,
    is_concrete,
    parameter,
)
from .._registry import register

Over = Callable[[AbstractModel, Any, Any], tuple[Any, Any]]
"""A model, its input and its state, to the state after it and its output over a record."""


class AbstractComposite(AbstractFollowingModel[State, Prepared]):
    """A model made of models. What it does over a record each of them does at once."""

    @abc.abstractmethod
    def _over(self, run: Over, u: Any, state: Any) -> tuple[Any, Any]:
        """State and output of what `run` does of each model; of no state where it is None."""

    def follow(self, t: Times, u: Inputs, state: State | None = None) -> tuple[State, Output]:
        return self._over(lambda model, v, own: model.stream(t, v, own), u, state)

    def simulated(self, t: Times, u: Inputs, state: State | None, starts: Starts) -> Output:
        """What `simulate` gives."""

        def run(model: AbstractModel, v: Any, own: Any) -> tuple[Any, Any]:
            return None, model.simulate(t, v, own, starts=starts)

        return self._over(run, u, state)[1]


class AbstractParts(AbstractComposite[tuple[Any, ...], Prepared]):
    """A composition of any number of models, whose state is a tuple of theirs."""

    parts: eqx.AbstractVar[tuple[AbstractModel, ...]]

    def _taken(self, models: tuple[Any, ...], parts: Iterable[Any]) -> tuple[Any, ...]:
        """Models given one after the other, in one list, or by the field's name; those of one of its own
        kind in its place."""
        one_list = len(models) == 1 and isinstance(models[0], list | tuple)
        given: Iterable[Any] = models[0] if one_list else models or parts
        return tuple(
            chain(*(one.parts if isinstance(one, type(self)) else (one,) for one in given))
        )

    def __check_init__(self) -> None:
        if not self.parts or not all(isinstance(part, AbstractModel) for part in self.parts):
            said = f"{len(self.parts)} parts, not all of them models."
            raise InputError("bad-parts", said, fix="give one model or more, as a list or tuple.")

    def init(self, t0: Any = None, u0: Any = None) -> tuple[Any, ...]:
        return tuple(part.init(t0, u0) for part in self.parts)


@register
class Sum(AbstractParts[tuple[Any, ...]]):
    """Models of one input side by side: y = sum of their outputs.

    State and prepared input are tuples of the parts'. It rises with its input where every part does.

    **Arguments:** one or more models, one after the other or in a list: `Sum(a, b)` is `Sum([a, b])`. The
    parts of a `Sum` among them are taken as its own.

    **Raises:** `InputError` `bad-parts` for anything else.

    **Example:**

        >>> line = hysteresis.LinearSponge(K=2.0, b=1.0, threshold=0.0)
        >>> hysteresis.Sum(line, line).simulate(None, np.array([1.0, 2.0])).tolist()
        [6.0, 10.0]
    """

    parts: tuple[AbstractModel, ...]

    def __init__(self, *models: Any, parts: Iterable[Any] = ()):
        self.parts = self._taken(models, parts)

    def _over(self, run: Over, u: Any, state: Any) -> tuple[Any, Any]:
        states = state or (None,) * len(self.parts)
        found = [run(part, u, own) for part, own in zip(self.parts, states, strict=True)]
        outputs = [y for _, y in found]
        xp = array_module(*outputs)
        return tuple(own for own, _ in found), as_array(reduce(add, map(xp.asarray, outputs)))

    def prepare(
        self, t: Times, u: Inputs, state: tuple[Any, ...] | None = None, *, starts: Starts = (0,)
    ) -> tuple[Any, ...]:
        states = (None,) * len(self.parts) if state is None else state
        pairs = zip(self.parts, states, strict=True)
        return tuple(part.prepare(t, u, own, starts=starts) for part, own in pairs)

    def evaluate(self, prepared: tuple[Any, ...]) -> Float[Array, " samples"]:
        pairs = zip(self.parts, prepared, strict=True)
        return reduce(add, (part.evaluate(own) for part, own in pairs))

    def laws(self, eps: float, depth: int) -> Tree:
        if len(self.parts) == 1:
            return self.parts[0].tree(eps, depth)
        parts = [trees.part_tree(part, eps, depth) for part in self.parts]
        return trees.looked_for(self, parts, eps)

    def search_range(self) -> tuple[Any, Any]:
        """Where the ranges of all parts are, as far as they have some, and a little beyond."""
        ends = [found for part in self.parts if (found := trees.input_range(part)) is not None]
        return trees.widened(*trees.common_range(ends)) if ends else trees.reach_of(self)


@register
class Scaled(AbstractComposite[Any, Any]):
    """A model in other units or with its sign turned: y = offset + factor * inner[u].

    **Arguments:** `inner`, any model; `factor`, not zero, and `offset`.

    Raises `InputError` for a factor of 0.

    **Example:**

        >>> line = hysteresis.LinearSponge(K=2.0, b=1.0)
        >>> turned = hysteresis.Scaled(line, factor=-1.0, offset=10.0)
        >>> turned.simulate(None, np.array([1.0, 2.0])).tolist()
        [7.0, 5.0]
    """

    inner: AbstractModel
    factor: Scalar = parameter(1.0, unit="1", meaning="factor of the output")
    offset: Scalar = parameter(0.0, unit="output", meaning="constant of the output")

    def __check_init__(self) -> None:
        if is_concrete(self.factor) and not np.all(self.factor):
            raise InputError(
                "parameter-out-of-bounds", "a factor of 0 leaves nothing of the model."
            )

    def init(self, t0: Any = None, u0: Any = None) -> Any:
        return self.inner.init(t0, u0)

    def _over(self, run: Over, u: Any, state: Any) -> tuple[Any, Any]:
        state, y = run(self.inner, u, state)
        return state, self.offset + self.factor * y

    def prepare(self, t: Times, u: Inputs, state: Any = None, *, starts: Starts = (0,)) -> Any:
        return self.inner.prepare(t, u, state, starts=starts)

    def evaluate(self, prepared: Any) -> Float[Array, " samples"]:
        return self.offset + self.factor * self.inner.evaluate(prepared)

    def laws(self, eps: float, depth: int) -> Tree:
        parameters = {"factor": self.factor, "offset": self.offset}
        return trees.node("scaled", parameters, parts=[self.inner.tree(eps, depth)])


class SeriesInput(eqx.Module):
    """The prepared input of the first stage, and the states in which the later ones begin."""

    first: Any
    t: Array | None
    states: tuple[Any, ...]
    starts: Starts = eqx.field(static=True)


@register
class Series(AbstractParts[SeriesInput]):
    """Models one behind the other: the output of each stage is the input of the next.

    State is a tuple of the stages'. Every `evaluate` prepares the later stages anew.

    **Arguments:** the stages, first to last, one after the other or in a list: `Series(a, b)` is
    `Series([a, b])`.

    **Raises:** `InputError` `bad-parts` for anything but models.

    **Example:**

        >>> line = hysteresis.LinearSponge(K=2.0, b=1.0, threshold=0.0)
        >>> hysteresis.Series(line, line).simulate(None, np.array([1.0, 2.0])).tolist()
        [7.0, 11.0]
    """

    parts: tuple[AbstractModel, ...]

    def __init__(self, *models: Any, parts: Iterable[Any] = ()):
        self.parts = self._taken(models, parts)

    def _over(self, run: Over, u: Any, state: Any) -> tuple[Any, Any]:
        after = []
        for part, own in zip(self.parts, state or (None,) * len(self.parts), strict=True):
            own, u = run(part, u, own)
            after.append(own)
        return tuple(after), u

    def prepare(
        self, t: Times, u: Inputs, state: tuple[Any, ...] | None = None, *, starts: Starts = (0,)
    ) -> SeriesInput:
        states = (None,) * len(self.parts) if state is None else state
        first = self.parts[0].prepare(t, u, states[0], starts=starts)
        found = SeriesInput(first, None if t is None else jnp.asarray(t), states[1:], starts)
        if t is None:
            jax.eval_shape(self.evaluate, found)  # a later stage may need the times, and says so
        return found

    def evaluate(self, prepared: SeriesInput) -> Float[Array, " samples"]:
        first, *later = self.parts
        y = first.evaluate(prepared.first)
        for part, state in zip(later, prepared.states, strict=True):
            y = part.evaluate(part.prepare(prepared.t, y, state, starts=prepared.starts))
        return y

    def laws(self, eps: float, depth: int) -> Tree:
        return trees.series(*(part.tree(eps, depth) for part in self.parts))
