"""Run-in: whether the state before the first reading still matters, by compensators that began elsewhere.

A robot is switched on at any time, so the memory of its specimen is not known. Beside the compensator that
begins in the virgin state run others, which began at the ends of what the specimen can have been through:

    low:   at the low end, nothing before        high:   all that the training was, then the high end

The start matters no longer where all of them give the same estimate, to within its deviation, and have for
a while, because estimates also cross. That holds for any motion, and needs nothing to be known of the
model. What never relaxes (a path, a wear) differs by what it did within the training, not for ever. Cost:
a compensator's step for each start that matters.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, parameters
from hysteresis._parameter import PyTree
from hysteresis.models._conditioned import condition_of

from .._contract import AbstractCompensator

PAST = 8160
"""Rows to which the training is thinned: paths keep their length, and plain Python takes a second."""

WAY = 16
"""Samples on the way to an end, at least."""


class Past(NamedTuple):
    """What a specimen has been through: times, None without rates, and inputs, (samples,)."""

    times: ArrayLike | None
    inputs: ArrayLike


class Start(NamedTuple):
    """A history that ends at time 0, and the state in which it leaves a compensator that reads it."""

    history: Past
    state: PyTree


def starts_of(
    compensator: AbstractCompensator,
    model: AbstractModel,
    low: float,
    high: float,
    past: Past | None,
    within: float,
) -> tuple[Start, ...]:
    """Starts from which a compensator gives other estimates than from its virgin state, between the ends.

    **Arguments:** as of `histories`; of a model of many draws the first one's outputs are what was read.
    `within`: how far apart estimates may be.

    **Returns:** those that tell something: on a sweep of the trained inputs each is somewhere farther off
    than `within`, and than those before it. None for a model without memory.
    """
    one = first_draw(model)
    sweep, *others = histories(one, low, high, past)
    y, t = outputs(one, sweep), sweep.times
    clock = None if t is None else np.asarray(t) - np.asarray(t)[0]

    def values(state: PyTree) -> np.ndarray:
        return np.asarray(compensator.stream(clock, y, state)[1].value)

    virgin, found = values(compensator.init()), []
    for history in others:
        read = outputs(one, history)
        state = compensator.stream(history.times, read, compensator.init())[0]
        found.append((np.abs(values(state) - virgin), Start(history, state)))
    kept, farthest = [], np.full(len(virgin), within)
    for apart, start in sorted(found, key=lambda pair: -pair[0].max()):
        if (apart > farthest).any():
            kept.append(start)
            farthest = np.maximum(farthest, apart)
    return tuple(kept)


def histories(model: AbstractModel, low: float, high: float, past: Past | None) -> tuple[Past, ...]:
    """Three that end at time 0: from the middle to both ends, which shows what a start changes; at the low
    end alone; the past, then the high end.

    They are of one length, for which one program is compiled: the first sample is repeated.

    **Arguments:** `low`, `high`: the trained inputs; `past`: the rows that the model was fitted to; a model
    without rates needs none.

    Inputs have the model's condition beside them where it depends on one.

    **Raises:** `InputError` `no-time` where the model depends on the rate and no times are given.
    """
    t, u = thinned(past, low)
    speed = _speed(t, u, high - low)
    clock = None if t is None else t[:1]
    begin = clock, np.array([low])
    there = then(clock, np.array([(low + high) / 2]), high, speed)
    return tuple(
        _ended(model, *history, 1 << (len(u) + 2 * WAY - 1).bit_length())
        for history in (then(*there, low, speed), begin, then(t, u, high, speed))
    )


def outputs(model: AbstractModel, past: Past) -> Array:
    """What a compensator reads of a past: (samples,), or (samples, 2) with the condition."""
    u = jnp.asarray(past.inputs)
    y = model.simulate(past.times, u)
    return y if u.ndim == 1 else jnp.stack([y, u[:, 1]], -1)


def first_draw(model: AbstractModel) -> AbstractModel:
    """The model, or the first one of many draws."""
    values = [value for _, _, value in parameters(model) if value is not None]
    many = min((value.ndim for value in values), default=0) > 0
    return jax.tree.map(lambda leaf: leaf[0], model) if many else model


def thinned(past: Past | None, low: float) -> tuple[np.ndarray | None, np.ndarray]:
    """Times and inputs of at most `PAST` rows of a past; without one the low end."""
    if past is None:
        return None, np.array([low])
    u = np.asarray(past.inputs, float)
    every = slice(None, None, -(-len(u) // PAST))
    return None if past.times is None else np.asarray(past.times, float)[every], u[every]


def _speed(t: np.ndarray | None, u: np.ndarray, span: float) -> float:
    """The mean speed of the past, for the way to an end."""
    if t is None or not np.ptp(t) > 0:
        return 1.0
    return max(float(np.abs(np.diff(u)).sum()), span) / float(np.ptp(t))


def then(
    t: np.ndarray | None, u: np.ndarray, end: float, speed: float | None = None
) -> tuple[np.ndarray | None, np.ndarray]:
    """A history that goes on to an end at a speed; at its own mean speed."""
    speed = _speed(t, u, float(np.ptp(u)) or 1.0) if speed is None else speed
    way = np.linspace(u[-1], end, WAY + 1)[1:]
    after = None if t is None else np.append(t, t[-1] + np.abs(way - u[-1]) / speed)
    return after, np.append(u, way)


def _ended(model: AbstractModel, t: np.ndarray | None, u: np.ndarray, length: int) -> Past:
    """With times that end at 0."""
    more = length - len(u)
    u = np.pad(u, (more, 0), mode="edge")
    if t is not None:
        # Rested at the first input for as long as the rest takes: no two samples have one time.
        step = (t[-1] - t[0]) / max(len(t) - 1, 1) or 1.0
        t = np.concatenate([t[0] - step * np.arange(more, 0, -1), t]) - t[-1]
    return Past(t, driven(model, u))


def driven(model: AbstractModel, u: np.ndarray) -> np.ndarray:
    """Inputs as a model takes them: beside the middle of the conditions where it depends on one."""
    if (conditioned := condition_of(model)) is None:
        return u
    knots = np.asarray(conditioned.knots, float)
    return np.column_stack([u, np.full(len(u), (knots[0] + knots[-1]) / 2)])
