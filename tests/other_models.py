"""Models that other people could have written, one of them under a name of ours."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from hysteresis import AbstractModel, InputError, Scalar, parameter, register


class AbstractMemoryless(AbstractModel[tuple[()], Any]):
    """The output is a function of the present input."""

    def init(self, t0: Any = None, u0: Any = None) -> tuple[()]:
        return ()

    def step(self, state: tuple[()], t: Any, u: Any) -> tuple[tuple[()], Float[Array, ""]]:
        return (), self.evaluate(jnp.asarray(u))

    def prepare(self, t: Any, u: Any, state: Any = None, *, starts: tuple[int, ...] = (0,)) -> Any:
        return jnp.asarray(u)


class AbstractSlope(AbstractMemoryless):
    """A straight line through the origin."""

    slope: eqx.AbstractVar[Scalar]

    def evaluate(self, prepared: Any) -> Any:
        return self.slope * prepared + self.constant()

    def constant(self) -> Any:
        """Of the output."""
        return getattr(self, "offset", 0.0)


@register(guess=lambda record: Gain(1.0))
class Gain(AbstractSlope):
    """A gain that is not 0."""

    slope: Scalar = parameter()

    def __check_init__(self) -> None:
        if not isinstance(self.slope, jnp.ndarray) or self.slope == 0:
            raise InputError("gain-zero", "the gain is 0.")


@register
class Line(AbstractSlope):
    """With a constant."""

    slope: Scalar = parameter(1.0)
    offset: Scalar = parameter(0.0)


class Preisach(AbstractSlope):
    """Named as one of ours."""

    slope: Scalar = parameter()
    offset: Scalar = parameter(0.0)


register(Preisach, name="TheirPreisach")


class Unregistered(AbstractSlope):
    """Known to nobody."""

    slope: Scalar = parameter()
    offset: Scalar = parameter(0.0)


@register
class Weighted(AbstractSlope):
    """With fields of every kind."""

    parts: tuple[AbstractModel, ...]
    kept: Any
    limit: float = eqx.field(static=True)
    words: tuple[Any, ...] = eqx.field(static=True)
    options: Any = eqx.field(static=True, default=None)
    pair: Any = None
    slope: Scalar = parameter(1.0)
