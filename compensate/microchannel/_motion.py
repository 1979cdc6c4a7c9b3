"""Filter for forces whose rate changes slowly between turns, observed through sensors with memory."""

import abc
from typing import Any, Generic, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from hysteresis import InputError, register
from hysteresis._type_variables import State

from .. import _traced as traced
from ..runtime._force_filter import Setting, Way, mean_of, updated


class AbstractSensor(eqx.Module, Generic[State]):
    """What a filter looks through: forces (contacts,) -> readings (channels,), with memory."""

    contacts: eqx.AbstractVar[int]

    @abc.abstractmethod
    def init(self) -> State:
        """The virgin state."""

    @abc.abstractmethod
    def look(
        self, state: State, t: Array, force: Array
    ) -> tuple[Float[Array, " channels"], Float[Array, "channels contacts"]]:
        """The next readings if these were the forces, and their derivatives."""

    @abc.abstractmethod
    def follow(self, state: State, t: Array, force: Array) -> State:
        """The state after these forces."""


class Motion(NamedTuple):
    """What may have happened, (ways,) of each: when the last turn was is not known at once.

    - `x` (ways, states): forces, then rates, then the forces of the last `delay` readings, latest first;
      `covariance` (ways, states, states).
    - `log_weight`: of each way; `sensor`: its state of the sensor.
    - `t`: of the last reading, NaN before the first. `lost`: how many readings in turn surprised all ways.
    """

    x: Float[Array, "ways states"]
    covariance: Float[Array, "ways states states"]
    log_weight: Float[Array, " ways"]
    sensor: Any
    t: Float[Array, ""]
    lost: Int[Array, ""]


class Moved(NamedTuple):
    """The forces' mean and standard deviation over all ways, and how surprising the reading was.

    `late`, `late_deviation`: the same of the forces `delay` readings ago, by what has come since.
    `surprise` is the least squared distance of a way from the reading, in its variance, per channel.
    """

    force: Float[Array, " contacts"]
    deviation: Float[Array, " contacts"]
    late: Float[Array, " contacts"]
    late_deviation: Float[Array, " contacts"]
    surprise: Float[Array, ""]


@register
class MotionFilter(eqx.Module):
    """A filter for forces F whose rates r change little except at turns, on average every 1 / `turns` s:

        dF = r dt,    dr = N(0, acceleration^2 dt),    at a turn r = N(0, turn^2),    z = h(F) + N(0, R)

    A turn shows in the readings only some samples later. So the filter follows several hypotheses in
    parallel, each with its own memory of the sensor: the force turned now, one reading ago, ..., or not at
    all. With every reading a turned copy of the most likely hypothesis replaces the least likely one. Each
    is an extended Kalman filter with a Gauss-Newton update; the estimate is their mean. Forces are limited
    to [0, high]. If three readings in turn surprise every hypothesis, one begins anew at the forces, out of
    some hundred over the whole range, that explain the reading best.

    **Arguments:**

    - `high`: the largest possible force, N.

    **Other arguments:**

    - `acceleration`, N/s^(3/2); `turn`, N/s; `turns`, 1/s. `ways`: the number of hypotheses.
    - `delay`: by how many readings the second, late estimate lags. A turn is hard to detect at first,
      because the reading hardly changes while the sensor's friction reverses, and easy afterwards.
    - `gap_s`: after a longer time without a reading the forces are kept and their rates are unknown.

    **Raises:** `InputError` for numbers that are not positive.

    **Source:** Adams and MacKay, Bayesian online changepoint detection (2007), with a Gaussian sum filter.

    **Example:**

        >>> motion = compensate.microchannel.MotionFilter(high=6.0, ways=4)
        >>> motion.init(channels).covariance.shape
        (4, 4, 4)
    """

    high: float = eqx.field(static=True, converter=float)
    acceleration: float = eqx.field(default=3.0, static=True, converter=float)
    turn: float = eqx.field(default=12.0, static=True, converter=float)
    turns: float = eqx.field(default=2.0, static=True, converter=float)
    ways: int = eqx.field(default=8, static=True)
    delay: int = eqx.field(default=0, static=True)
    gap_s: float = eqx.field(default=0.5, static=True, converter=float)

    def __check_init__(self) -> None:
        for name in ("high", "acceleration", "turn", "turns", "ways", "gap_s"):
            if not 0 < getattr(self, name) < float("inf"):
                raise InputError(
                    "parameter-out-of-bounds",
                    f"{name} is {getattr(self, name):g}, and has to be above 0.",
                )

    def init(self, sensor: AbstractSensor) -> Motion:
        """At rest, without a force, the sensor virgin."""
        states = (2 + self.delay) * sensor.contacts
        x = jnp.zeros((self.ways, states))
        weight = jnp.full(self.ways, -jnp.inf).at[0].set(0.0)
        state = jax.tree.map(lambda leaf: jnp.stack([leaf] * self.ways), sensor.init())
        never = jnp.asarray(jnp.nan, x.dtype)
        covariance, none = jnp.zeros((self.ways, states, states)), jnp.zeros((), int)
        return Motion(x, covariance, weight, state, never, none)

    def update(
        self,
        sensor: AbstractSensor,
        motion: Motion,
        t: Float[Array, ""],
        z: Float[Array, " channels"],
        noise: Float[Array, " channels"],
    ) -> tuple[Motion, Moved]:
        """One reading z of variances `noise`, independent of one another."""
        dt = jnp.where(jnp.isnan(motion.t), self.gap_s, jnp.maximum(t - motion.t, 0.0))
        setting = Setting(traced, self, sensor, t, dt, z, noise)
        x, P, weight, state = motion[:4]
        ways = Way(x, P, weight, state, jnp.zeros_like(weight))
        ways, lost, surprise = updated(setting, ways, motion.lost)
        contacts, last = sensor.contacts, x.shape[1] * bool(self.delay)
        told = mean_of(traced, ways, range(contacts))
        late = mean_of(traced, ways, range(last - contacts, last)) if last else told
        now = Motion(ways.x, ways.covariance, ways.log_weight, ways.sensor, t, lost)
        return now, Moved(*told, *late, surprise)
