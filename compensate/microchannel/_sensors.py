"""Observation model of the force filter: the fitted channels of a sensor."""

from collections.abc import Iterable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, register
from hysteresis._type_variables import PyTree

from ._motion import AbstractSensor


@register
class ChannelSensor(AbstractSensor[tuple[PyTree, ...]]):
    """Channels in series: every contact adds its own part to every layer's reading,

        z_l = zero_l + sum_k G_lk M_k[F_k],

    with a model M_k, force -> reading, of each location, and the layers' gains. So models that were
    fitted to presses of one location at a time predict the reading of several contacts.

    **Arguments:**

    - `models`: one for each location. `gains`: G, (layers, locations); None for 1 in one layer.
    - `zero` (layers,): the reading where nothing is pressed; 0 by default.

    **Raises:** `InputError` where these do not fit.

    **Example:**

        >>> sensor = compensate.microchannel.ChannelSensor([model, model], [[1.0, 0.5], [0.5, 1.0]])
        >>> reading, slope = sensor.look(sensor.init(), jnp.array(0.0), jnp.array([2.0, 0.0]))
        >>> np.asarray(reading).round(2).tolist()
        [2.7, 1.35]
    """

    models: tuple[AbstractModel, ...] = eqx.field(converter=tuple)
    gains: Float[Array, "layers locations"]
    zero: Float[Array, " layers"]

    def __init__(
        self,
        models: Iterable[AbstractModel],
        gains: ArrayLike | None = None,
        zero: ArrayLike | None = None,
    ):
        self.models = tuple(models)
        self.gains = jnp.ones((1, len(self.models))) if gains is None else jnp.asarray(gains, float)
        if self.gains.ndim != 2 or self.gains.shape[1] != len(self.models) or not self.models:
            raise InputError(
                "wrong-channels",
                f"gains of shape {self.gains.shape} for {len(self.models)} locations.",
                fix="give one row for each layer, one column for each location's model.",
            )
        layers = len(self.gains)
        self.zero = jnp.zeros(layers) if zero is None else jnp.asarray(zero, float)
        if self.zero.shape != (layers,):
            raise InputError(
                "wrong-channels",
                f"zero of shape {self.zero.shape} for {layers} layers.",
                fix="give one reading at rest for each layer.",
            )

    @property
    def contacts(self) -> int:  # type: ignore[override]
        return len(self.models)

    def init(self) -> tuple[PyTree, ...]:
        return tuple(model.init() for model in self.models)

    def look(self, state: tuple[PyTree, ...], t: Array, force: Array) -> tuple[Array, Array]:
        found = [
            jax.jvp(lambda u, m=model, s=own: m.step(s, t, u)[1], (F,), (jnp.ones_like(F),))
            for model, own, F in zip(self.models, state, force, strict=True)
        ]
        y, slope = (jnp.stack(part) for part in zip(*found, strict=True))
        return self.zero + self.gains @ y, self.gains * slope[None]

    def follow(self, state: tuple[PyTree, ...], t: Array, force: Array) -> tuple[PyTree, ...]:
        each = zip(self.models, state, force, strict=True)
        return tuple(model.step(own, t, F)[0] for model, own, F in each)
