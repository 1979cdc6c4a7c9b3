"""The contract every compensator keeps, and `invert`, the way to get one."""

import abc
from functools import singledispatch
from typing import Any, Generic, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from hysteresis import AbstractModel, InputError, html_of, parameters
from hysteresis._type_variables import State

from .runtime._status import Status as Status


class Estimate(NamedTuple):
    """The input a compensator finds behind an output, and the `Status` of each value."""

    value: Float[Array, "*samples"]
    status: Int[Array, "*samples"]


class AbstractCompensator(eqx.Module, Generic[State]):
    """A model run backwards, sample by sample, with the model's own memory. The law it keeps:

        model.simulate(t, compensator.simulate(t, y).value) == y     on the reachable set

    to 1e-9 of the range of y; elsewhere the status says why not. It never raises inside a loop.
    """

    @abc.abstractmethod
    def init(self) -> State:
        """The state that belongs to the model's virgin state."""

    @abc.abstractmethod
    def step(self, state: State, t: Any, y: Any) -> tuple[State, Estimate]:
        """One output in, one estimate of the input out."""

    @abc.abstractmethod
    def simulate(self, t: Any, y: Any, state: State | None = None) -> Estimate:
        """`step` over all samples: arrays of the shape of `y`; `t` may be None without rates."""

    def _repr_html_(self) -> str | None:
        return html_of(self)


def invert(model: AbstractModel, output_sigma: Any = None, seed: int = 0) -> AbstractCompensator:
    """The exact inverse of a fitted model, as a compensator.

    Of many models, such as `Posterior.model`, an `EnsembleCompensator`, which tells how far their
    estimates lie apart; `output_sigma` and `seed` are its own.

    Raises `InputError` where the model has no inverse: a decreasing stage, a signed density, no slope.
    """
    from .uncertainty._ensemble import (
        EnsembleCompensator,  # which is a compensator, and inverts one draw
    )

    if min((value.ndim for _, _, value in parameters(model) if value is not None), default=0):
        return EnsembleCompensator(model, output_sigma, seed)
    if output_sigma is not None:
        raise InputError(
            "one-model",
            "one model's inverse has no spread for a reading's noise to add to.",
            fix="FilteredCompensator(model, input_step, output_sigma), or invert(posterior.model, ...).",
        )
    return inverse_of(model)


@singledispatch
def inverse_of(model: AbstractModel) -> AbstractCompensator:
    """`invert` of one kind of model; each kind registers its own."""
    raise InputError(
        "not-invertible",
        f"no inverse is known for {type(model).__name__}.",
        fix="BracketedCompensator(model, low, high), if its output rises with its input.",
    )


def last_valid(y: Float[Array, " samples"]) -> tuple[Array, Array]:
    """Which samples are finite, and for each the latest one that is: -1 before the first."""
    valid = jnp.isfinite(y)
    index = jnp.arange(y.shape[0])
    return valid, jax.lax.cummax(jnp.where(valid, index, -1))


@eqx.filter_jit
def scan_steps(compensator: Any, t: Array | None, y: Array, state: Any) -> tuple[Any, Any]:
    """`step` over all samples of anything that has one, compiled once per length: state, estimates."""
    t = jnp.zeros(y.shape[:1], y.dtype) if t is None else jnp.asarray(t, y.dtype)
    return jax.lax.scan(lambda carry, sample: compensator.step(carry, *sample), state, (t, y))
