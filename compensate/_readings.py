"""Readings beside a condition: the inverse of a `Conditioned` model is given both in one array."""

from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import Conditioned, Record
from hysteresis._parameter import array_module, is_concrete
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
