"""The state of a compensator from rows of which both input and output are known."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError
from hysteresis._known_past import known_past, outputs_of

from .._contract import AbstractCompensator
from ._guarded import GuardedCompensator, GuardedState
from ._run_in import driven, first_draw, then


def warmed(
    compensator: AbstractCompensator, t: ArrayLike | None, u: ArrayLike, y: ArrayLike
) -> Any:
    """The state after known rows: it has read what the model gives along the likeliest history."""
    model = first_draw(_model_in(compensator))
    if t is None:
        model.prepare(None, jnp.asarray(u))  # raises where the rate matters
    past, outputs = known_past(model, t, u, y), outputs_of(model)
    count, rows = past.inputs.shape[:2]
    flat = past.inputs.reshape(count * rows, *past.inputs.shape[2:])
    times = None if past.times is None else past.times.ravel()
    read = np.asarray(outputs(times, flat, tuple(range(0, count * rows, rows)))).reshape(
        count, rows
    )
    if flat.ndim == 2:
        read = np.stack([read, past.inputs[..., 1]], -1)
    each = [None] * count if past.times is None else list(past.times)
    state = compensator.stream(each[0], read[0], compensator.init())[0]
    if (guard := _guard_in(compensator)) is None:
        return state
    # Others in the place of its starts: those that the way to both ends tells apart most.
    first = None if past.times is None else past.times[0]
    own = past.inputs[0] if flat.ndim == 2 else past.inputs[0, :, None]
    clock, way = then(*then(first, own[:, 0], float(guard.low)), float(guard.high))
    later = None if clock is None else clock[rows:]
    y = np.asarray(outputs(*past.followed_by(later, driven(model, way[rows:]))))
    apart = np.abs(y.reshape(count, -1)[1:, rows:] - y.reshape(count, -1)[0, rows:]).max(1)
    farthest = 1 + np.argsort(-apart)[: len(guard.starts)]
    inner, uncounted = guard.inner, guard.init().limited  # what was counted is of other starts

    def compared(state: Any) -> Any:
        if not isinstance(state, GuardedState):
            return state._replace(inner=compared(state.inner))
        others = []
        for k in farthest:  # on the guard's own clock
            own = None if first is None else each[k] - each[k][-1] + float(state.clock)
            others.append(inner.stream(own, read[k], inner.init())[0])
        return state._replace(others=tuple(others), limited=uncounted)

    return compared(state)


def _guard_in(compensator: Any) -> GuardedCompensator | None:
    while compensator is not None and not isinstance(compensator, GuardedCompensator):
        compensator = getattr(compensator, "inner", None)
    return compensator


def _model_in(compensator: Any) -> AbstractModel:
    while compensator is not None:
        if isinstance(model := getattr(compensator, "model", None), AbstractModel):
            return model
        compensator = getattr(compensator, "inner", None)
    raise InputError("not-a-model", "a compensator without a model has no state to tell.")
