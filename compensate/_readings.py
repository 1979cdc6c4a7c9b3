"""Readings beside a condition: the inverse of a `Conditioned` model is given both in one array."""

from collections.abc import Iterator
from typing import Any, Protocol, TypeVar, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from hysteresis import Conditioned, InputError, Record
from hysteresis._parameter import array_module, as_array, is_concrete
from hysteresis._quantities import Units, require_same
from hysteresis.models._conditioned import condition_of, with_condition


def reading_of(y: Any, dimensions: int) -> Any:
    """The reading itself, of so many dimensions: the first of the pair (y, c), where c is there."""
    return y[..., 0] if y.ndim > dimensions else y


def with_reading(y: Any, dimensions: int, reading: Any) -> Any:
    """The same with another reading; the condition, where there is one, stays."""
    if y.ndim == dimensions:
        return reading
    both = reading[..., None], y[..., 1:].astype(reading.dtype)
    return array_module(reading).concatenate(both, -1)


def latest_of(valid: Any) -> Any:
    """The latest valid sample up to each one; -1 before the first."""
    if is_concrete(valid):
        return np.maximum.accumulate(np.where(valid, np.arange(len(valid)), -1))
    return jax.lax.cummax(jnp.where(valid, jnp.arange(len(valid)), -1))


def nested(compensator: Any) -> Iterator[Any]:
    """A compensator, the one that it is around, and so on inwards."""
    while compensator is not None:
        yield compensator
        compensator = getattr(compensator, "inner", None)


def conditioned_in(compensator: Any) -> Conditioned | None:
    """The model that makes a compensator need a condition beside the reading; None where there is none."""
    if (found := condition_of(getattr(compensator, "model", None))) is not None:
        return found
    for part in vars(compensator).values() if isinstance(compensator, eqx.Module) else ():
        for one in part if isinstance(part, tuple) else (part,):
            if (found := conditioned_in(one)) is not None:
                return found
    return None


def readings_of(compensator: Any, record: Record) -> np.ndarray:
    """The outputs of a record as a compensator takes them: beside the condition where it needs one.

    Raises `InputError` `no-condition` where the record does not have it.
    """
    return with_condition(conditioned_in(compensator), record, record.output)


# `estimate`: a compensator run over all sequences of a record.

Found = TypeVar("Found", covariant=True)


@runtime_checkable
class Simulates(Protocol[Found]):
    """An `AbstractCompensator`, or whatever else finds inputs behind a series of outputs."""

    def simulate(self, t: ArrayLike | None, y: ArrayLike, state: Any = None) -> Found: ...


def estimate(compensator: Simulates[Found], record: Record) -> Found:
    """The input behind the output of every row of a record:

        estimate(compensator, record)[rows] == compensator.simulate(t[rows], y[rows])     for each sequence

    Every sequence begins in the virgin state, with the record's clock where it has one; what follows known
    rows begins in the state that these tell. All rows are history, those outside the mask too. A gap in the
    output is INVALID: the last estimate is held.

    **Arguments:**

    - `compensator`: of a model whose output is the output of the record, in its unit: that of a fit knows
      its `units`. Where the model depends on a condition, the record has it too.
    - `record`: its input is looked at in known rows alone.

    **Returns:** what `compensator.simulate` returns, over the rows (..., samples): `value` in the unit of
    the model's input, `status`, and for compensators that know their error `deviation` and `draws`.

    **Raises:** `InputError` `no-rows`, `no-condition`, `wrong-unit`, and what `compensator.simulate`
    raises.

    **Example:**

        >>> found = compensate.estimate(compensate.invert(fit.model), record)
        >>> found.value.shape
        (101,)
    """
    if not len(record):
        raise InputError("no-rows", "The record has no rows to estimate.", place=record.source)
    check_units(getattr(compensator, "units", None), record, record.known is not None)
    if (conditioned := conditioned_in(compensator)) is not None:
        name, unit = conditioned.condition, conditioned.unit
        require_same([(name, record.conditions.get(name, "1"), unit)])
    found, readings = [], readings_of(compensator, record)
    for rows, first in _stretches(compensator, record):
        t = None if record.time is None else record.time[rows]
        whole = compensator.simulate(t, readings[rows], **first)
        found.append(jax.tree.map(np.asarray, whole))
    return jax.tree.map(lambda *parts: as_array(np.concatenate(parts, axis=-1)), *found)


def check_units(units: Units | None, record: Record, driven: bool = True) -> None:
    """Raise `InputError` `wrong-unit` where columns have others than the `units` from readings to
    estimates; of the input where what has `driven` the readings is looked at."""
    if units is None:
        return
    reading = record.output_name, record.output_unit, units.input
    clock = record.time_name, record.time_unit, units.time
    drive = record.input_name, record.input_unit, units.output
    require_same([reading, clock, *([drive] if driven else [])])


def _stretches(compensator: Any, record: Record) -> Iterator[tuple[slice, dict[str, Any]]]:
    """Rows to run at once, and the state that they begin in where known rows before them tell it."""
    for _, rows in record.sequences():
        known = 0 if record.known is None else int(record.known[rows].sum())
        if not known:
            yield rows, {}
            continue
        head = slice(rows.start, rows.start + known)
        u = with_condition(conditioned_in(compensator), record, record.input)
        t = None if record.time is None else record.time[head]
        yield head, {}
        if head.stop < rows.stop:
            state = compensator.state_from(t, u[head], record.output[head])
            yield slice(head.stop, rows.stop), {"state": state}
