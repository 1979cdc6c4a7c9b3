"""The state of a compensator from rows of which both input and output are known."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError
from hysteresis._known_past import known_past, outputs_of

from .._contract import AbstractCompensator
from .._readings import nested
from ._guarded import GuardedState, guard_in
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
    starts = tuple(range(0, count * rows, rows))
    read = np.asarray(outputs(times, flat, starts)).reshape(count, rows)
    if flat.ndim == 2:
        read = np.stack([read, past.inputs[..., 1]], -1)
    each = [None] * count if past.times is None else list(past.times)
    state = compensator.stream(each[0], read[0], compensator.init())[0]
    if (guard := guard_in(compensator)) is None:
        return state
    # Others in the place of its starts: those that the way to both ends tells apart most.
    first = None if past.times is None else past.times[0]
    own = past.inputs[0] if flat.ndim == 2 else past.inputs[0, :, None]
    clock, way = then(*then(first, own[:, 0], float(guard.low)), float(guard.high))
    later = None if clock is None else clock[rows:]
    y = np.asarray(outputs(*past.followed_by(later, driven(model, way[rows:])))).reshape(count, -1)
    apart = np.abs(y[1:, rows:] - y[0, rows:]).max(1)
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


def _model_in(compensator: AbstractCompensator) -> AbstractModel:
    for one in nested(compensator):
        if isinstance(model := getattr(one, "model", None), AbstractModel):
            return model
    raise InputError("not-a-model", "a compensator without a model has no state to tell.")
