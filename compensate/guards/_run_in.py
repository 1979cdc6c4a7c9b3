"""Run-in: what has to pass before a model's memory no longer depends on how it began."""

from functools import singledispatch
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import (
    AbstractModel,
    AbstractViscoelastic,
    Conditioned,
    MovingPreisach,
    NonlinearMaxwell,
    OutputDependentPreisach,
    Scaled,
    Series,
    Softening,
    Sum,
    parameters,
)

END = 0.05
"""Part of the trained range within which an estimate has reached its end: peaks of cycles differ."""

TIMES = 5.0
"""Time constants to wait for, after which 0.7 % of a branch's first state is left."""

LONGEST = 1e30
"""The wait for a branch that never relaxes, such as a dashpot by itself."""

DRAWS = 16
"""Of many models, the longest time constant of so many, evenly taken."""


class RunIn(NamedTuple):
    """What readings have to show before the first state no longer matters.

    - `bottom`, `top`: one estimate has to be at most, another at least that.
    - `time`: that has to pass since the first reading, in the unit of the model's times.
    """

    bottom: float
    top: float
    time: float


class _Memory(NamedTuple):
    """Whether relays, plays and the like remember turning points; the slowest time constant."""

    turns: bool
    time: float


def run_in(model: AbstractModel, low: float, high: float) -> RunIn | None:
    """What fixes the memory of a model that is inverted over the inputs from `low` to `high`.

    Memory of turning points is fixed once the input has been at both ends: estimates within 5 % of the
    range of either count. Branches that relax have forgotten after 5 times the slowest time constant of
    the *inverse*, which is not the model's own: for a sum with the slope D at once and branches
    x' = -r x + d u it is the slowest eigenvalue of -(diag r + d 1^T / D).

    **Arguments:** `model`: fitted, of one set of parameters or with a leading axis of draws.

    **Returns:** None for a model without memory.

    **Example:**

        >>> compensate.run_in(hysteresis.Burgers(2.0, 40.0, 1.0, 5.0), 0.0, 10.0).time > 0
        True
    """
    memory = _memory_of_draws(model, (low + high) / 2, high - low)
    if not memory.turns and memory.time == 0:
        return None
    margin = END * (high - low)
    ends = (low + margin, high - margin) if memory.turns else (np.inf, -np.inf)
    first, last = map(_finite, ends)
    return RunIn(first, last, min(TIMES * memory.time, LONGEST))


def _finite(end: float) -> float:
    """JSON and C have no infinity."""
    return float(np.clip(end, -LONGEST, LONGEST))


def _memory_of_draws(model: AbstractModel, middle: float, span: float) -> _Memory:
    draws = [
        value.shape[0] for _, _, value in parameters(model) if value is not None and value.ndim
    ]
    if min((v.ndim for _, _, v in parameters(model) if v is not None), default=0) == 0:
        return _memory(model, middle, span)
    chosen = np.unique(np.linspace(0, min(draws) - 1, DRAWS).astype(int))
    found = [_memory(jax.tree.map(lambda a, k=k: a[k], model), middle, span) for k in chosen]
    return _longest(found)


def _longest(found: list[_Memory]) -> _Memory:
    return _Memory(any(m.turns for m in found), max((m.time for m in found), default=0.0))


@singledispatch
def _memory(model: AbstractModel, middle: float, span: float) -> _Memory:
    """Of any model: turning points, if it has a state at all, and the longest of its times."""
    times = [
        float(np.max(value)) for _, info, value in parameters(model)
        if value is not None and info.unit == "time"
    ]  # fmt: skip
    return _Memory(bool(jax.tree.leaves(model.init())), max(times, default=0.0))


@_memory.register
def _(model: AbstractViscoelastic, middle: float, span: float) -> _Memory:
    # The chain as the inverse runs it: driven by force where force is the output of the model.
    rates = model._driven_by_force(model.leading).all_rates
    return _Memory(False, _slowest(np.asarray(rates, float)))


@_memory.register
def _(model: Softening, middle: float, span: float) -> _Memory:
    # What is worn stays worn: both ends show all of it, however long it takes to recover.
    return _Memory(True, 0.0)


@_memory.register(Scaled)
@_memory.register(MovingPreisach)
@_memory.register(OutputDependentPreisach)
def _(model: Any, middle: float, span: float) -> _Memory:
    return _memory(model.inner, middle, span)


@_memory.register
def _(model: Conditioned, middle: float, span: float) -> _Memory:
    return _longest([_memory(one, middle, span) for one in model.models])


@_memory.register
def _(model: Series, middle: float, span: float) -> _Memory:
    # Stages are inverted one after the other, each on its own clock.
    return _longest([_memory(part, middle, span) for part in model.parts])


@_memory.register(Sum)
@_memory.register(NonlinearMaxwell)
def _(model: Any, middle: float, span: float) -> _Memory:
    parts = model.parts if isinstance(model, Sum) else (model,)
    rates, drives = (np.concatenate(each) for each in zip(*map(_branches, parts), strict=True))
    others = [p for p in parts if not isinstance(p, AbstractViscoelastic | NonlinearMaxwell)]
    memory = _longest([_memory(part, middle, span) for part in others])
    if not len(rates):
        return memory
    matrix = np.diag(rates) + drives[:, None] / _slope_at_once(model, middle, span)
    return _longest([memory, _Memory(False, _slowest(np.linalg.eigvals(matrix).real))])


def _branches(part: AbstractModel) -> tuple[np.ndarray, np.ndarray]:
    """Rates and drives of the linear branches of a part, from its input to its output."""
    if isinstance(part, AbstractViscoelastic):
        chain = part._driven_by_force(not part.leading)
        return np.asarray(chain.all_rates, float), np.asarray(chain.all_drives, float)
    if isinstance(part, NonlinearMaxwell):
        # A branch Q' = -Q / tau + (g(u))' is g(u) - x with x' = (g(u) - x) / tau; g as a straight line.
        none = np.zeros(1)
        springs = none if part.increments is None else np.asarray(part.increments).sum(-1)
        felt = none if part.strengths is None else np.asarray(part.strengths).mean(-1)
        felt = felt.mean(0) if felt.ndim > 1 else felt
        rates = 1 / np.asarray(part.times, float)
        drives = (springs + felt) / (part.high - part.low) * rates
        return rates, -drives if part.leading else drives
    return np.zeros(0), np.zeros(0)


def _slope_at_once(model: AbstractModel, middle: float, span: float) -> float:
    """The rise of the output in no time over a twentieth of the range, from the middle."""
    t = jnp.asarray(0.0)
    state, y = model.step(model.init(), t, jnp.asarray(middle))
    _, above = model.step(state, t, jnp.asarray(middle + END * span))
    return max(float(above - y) / (END * span), 1e-300)


def _slowest(rates: np.ndarray) -> float:
    """The longest time constant of these rates; `LONGEST` where one does not relax."""
    if not len(rates):
        return 0.0
    # Rounding of an eigenvalue is that of the largest one.
    least = float(rates.min())
    return 1 / least if least > 1e-12 * float(np.abs(rates).max()) else LONGEST
