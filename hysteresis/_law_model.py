"""Models that are their laws: everything over time runs the text of `hysteresis/laws`."""

import weakref
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from ._model import AbstractFollowingModel, Series, check_clock, needed_time, one_column
from ._parameter import Output, Starts, Times, array_module, as_array, as_float
from .laws import FORGET
from .running import Numbers, numbers_of, outputs

# What is made of a module's numbers, once.

Made = TypeVar("Made")


def once(make: Callable[[Any], Made]) -> Made:
    """A property that is made at the first use, of a module whose fields never change. While JAX traces the
    numbers, it is made at every use."""
    # Beside the modules: JAX takes one with something in it for a module of another structure.
    known: dict[int, Made] = {}
    FORGET.append(known.clear)

    def get(module: Any) -> Made:
        made = known.get(id(module))
        if made is None:
            made = make(module)
            if not any(isinstance(x, Tracer) for x in jax.tree.leaves(made)):
                known[id(module)] = made
                weakref.finalize(module, known.pop, id(module), None)
        return made

    return property(get, doc=make.__doc__)  # type: ignore[return-value]


OWN = 0
"""Reversals that a Preisach model remembers: as many as it says itself."""


class LawState(NamedTuple):
    """What the laws remember, and the time of the last sample: NaN before the first one."""

    numbers: Float[Array, " state"]
    t: Float[Array, ""]


class LawInput(NamedTuple):
    """Inputs, times since the samples before (NaN or negative where a sequence begins), and what laws
    remember where sequences begin: None before any sample, where that may depend on parameters."""

    u: Float[Array, " samples"]
    dt: Float[Array, " samples"]
    state: Float[Array, " state"] | None


class AbstractLawModel(AbstractFollowingModel[LawState, LawInput]):
    """A model that is a tree of laws: `tree` says which, with which numbers, and all else follows from it.

    Outputs have exact derivatives by the parameters, forwards and backwards, and by inputs forwards.
    """

    traced = False

    may_jump: ClassVar[bool] = True
    """Whether two samples may have one time: not where a speed is taken from them."""

    needs_time: ClassVar[Any] = False
    """Whether outputs depend on the rate: a class says so, or a property where a parameter decides."""

    def init(self, t0: Any = None, u0: Any = None) -> LawState:
        t = jnp.asarray(jnp.nan if t0 is None else t0, float)
        return LawState(as_float(self._numbers.state), t)

    def prepare(
        self, t: Times, u: Series, state: LawState | None = None, *, starts: Starts = (0,)
    ) -> LawInput:
        if t is None and self.needs_time:
            needed_time(type(self).__name__, t)
        own, last = (None, np.nan) if state is None else state
        traced = any(isinstance(x, Tracer) for x in jax.tree.leaves((t, u, last)))
        xp: Any = jnp if traced else np
        u, first = xp.asarray(one_column(u), float), np.asarray(starts)
        times = xp.zeros(u.shape[:1]) if t is None else xp.asarray(t, float)
        dt, since = xp.diff(times, prepend=times[:1]), times[first] - last
        # At once, but for a clock that has gone on since the state.
        begin = xp.where(since > 0, -since, xp.nan)
        if xp is np:
            if self.needs_time:
                check_clock(np.delete(dt, first), self.may_jump)
            dt = np.maximum(dt, 0.0)
            dt[first] = begin
        else:
            dt = jnp.maximum(dt, 0.0).at[first].set(begin)
        return LawInput(as_array(u), as_array(dt), own)

    def evaluate(self, prepared: LawInput) -> Float[Array, " samples"]:
        return self._run(*prepared)[0]

    def follow(self, t: Times, u: Series, state: LawState | None = None) -> tuple[LawState, Output]:
        y, after = self._run(*self.prepare(t, u, state))
        if t is None or not len(y):
            return LawState(after, self.init().t if state is None else state.t), y
        return LawState(after, jnp.asarray(array_module(t).asarray(t)[-1], float)), y

    @once
    def _numbers(self) -> Numbers:
        """Of the laws from input to output, without what only a search for the input needs."""
        forwards = getattr(self, "forwards", None)
        return numbers_of(self.tree(depth=OWN) if forwards is None else forwards())

    def _run(self, u: Array, dt: Array, state: Array | None) -> tuple[Array, Array]:
        numbers = self._numbers if state is None else self._numbers.with_state(state)
        y, after = outputs(numbers, u, dt)
        return as_array(y), as_array(numbers._replace(m=after).state)
