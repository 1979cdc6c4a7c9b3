"""Filter for forces whose rate changes slowly between turns, observed through sensors with memory."""

import abc
from typing import Any, Generic, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from hysteresis import InputError, register
from hysteresis._type_variables import State

ITERATIONS = 2
"""Of Gauss-Newton: a branch's slope jumps where the force turns. A third changes nothing to be seen."""


LOST, PATIENCE = 25.0, 3
"""Squared surprise of a channel from which on a reading is none that the hypotheses expect; how many such
readings in turn say that all of them are lost."""

SOUGHT = 128
"""Forces that a lost filter tries at most, evenly over their range."""


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
        motion = jax.lax.cond(
            motion.lost >= PATIENCE,
            lambda: self._found_again(sensor, motion, t, z, noise),
            lambda: motion,
        )
        dt = jnp.where(jnp.isnan(motion.t), self.gap_s, jnp.maximum(t - motion.t, 0.0))
        gap, dt = dt >= self.gap_s, jnp.minimum(dt, self.gap_s)
        # The likeliest way turns, in the place of the least likely one; after a gap they all do.
        best, least = jnp.argmax(motion.log_weight), jnp.argmin(motion.log_weight)
        born = jnp.arange(self.ways) == least
        source = jnp.where(born, best, jnp.arange(self.ways))
        motion = jax.tree.map(lambda leaf: leaf[source] if jnp.ndim(leaf) else leaf, motion)
        chance = -jnp.expm1(-self.turns * dt)
        weight = jnp.where(born, jnp.log(chance), motion.log_weight + jnp.log1p(-chance))

        one = jax.vmap(self._one, (None, 0, 0, 0, 0, None, None, None, None))
        x, P, likelihood, surprise = one(
            sensor, motion.sensor, motion.x, motion.covariance, born | gap, t, dt, z, noise
        )
        weight += likelihood
        weight -= jax.scipy.special.logsumexp(weight)
        contacts = sensor.contacts
        state = jax.vmap(sensor.follow, (0, None, 0))(motion.sensor, t, x[:, :contacts])

        now, then = slice(0, contacts), slice(-contacts, None) if self.delay else slice(0, contacts)
        told = (*_mean(weight, x, P, now), *_mean(weight, x, P, then))
        least_surprise = surprise.min() / z.shape[0]
        lost = jnp.where(least_surprise > LOST, motion.lost + 1, 0)
        return Motion(x, P, weight, state, t, lost), Moved(*told, least_surprise)

    def _found_again(
        self, sensor: AbstractSensor, motion: Motion, t: Array, z: Array, noise: Array
    ) -> Motion:
        """The least likely way begins anew, at the forces that best explain the reading.

        Where a sensor's model is flat, a reading says nothing about the forces, and no Gauss-Newton step
        leads back from there. So forces all over their range are tried, with the memory of the likeliest
        way, and with that of a sensor that was never pressed: what the lost ways remember never happened.
        """
        contacts, best = sensor.contacts, jnp.argmax(motion.log_weight)
        each = max(3, round(SOUGHT ** (1 / contacts)))
        ends = jnp.linspace(0.0, self.high, each)
        tried = jnp.stack(jnp.meshgrid(*[ends] * contacts, indexing="ij"), -1).reshape(-1, contacts)
        kept = jax.tree.map(lambda leaf: leaf[best], motion.sensor)
        memories = jax.tree.map(lambda *leaves: jnp.stack(leaves), kept, sensor.init())

        def off(memory: Any, force: Array) -> Array:
            return jnp.sum((z - sensor.look(memory, t, force)[0]) ** 2 / noise)

        missed = jax.vmap(jax.vmap(off, (None, 0)), (0, None))(memories, tried)
        which, where = jnp.unravel_index(jnp.argmin(missed), missed.shape)
        memory = jax.tree.map(lambda leaf: leaf[which], memories)
        force = tried[where]
        x = jnp.tile(force, 2 + self.delay).at[contacts : 2 * contacts].set(0.0)
        spread = jnp.full_like(x, ends[1]).at[contacts : 2 * contacts].set(self.turn)
        least = jnp.argmin(motion.log_weight)
        even = (
            jnp.full_like(motion.log_weight, -jnp.log(2.0 * self.ways)).at[least].set(jnp.log(0.5))
        )
        return motion._replace(
            x=motion.x.at[least].set(x),
            covariance=motion.covariance.at[least].set(jnp.diag(spread**2)),
            log_weight=even,
            sensor=jax.tree.map(lambda all_, one: all_.at[least].set(one), motion.sensor, memory),
            lost=jnp.zeros_like(motion.lost),
        )

    def _one(
        self,
        sensor: AbstractSensor,
        state: Any,
        x: Array,
        P: Array,
        turned: Array,
        t: Array,
        dt: Array,
        z: Array,
        noise: Array,
    ) -> tuple[Array, Array, Array, Array]:
        """One hypothesis: x and P after the reading, log-likelihood, and squared normalised innovation."""
        contacts = sensor.contacts
        x, P = self._ahead(x, P, turned, dt, contacts)
        force = x[:contacts]
        after, left, likelihood, surprise = x, P, jnp.zeros_like(t), jnp.zeros_like(t)
        for k in range(ITERATIONS):
            y, H = sensor.look(state, t, force)
            after, left = x, P
            # Channel by channel, so that nothing has to be solved but numbers.
            for channel in range(z.shape[0]):
                h = H[channel]
                off = z[channel] - y[channel] - h @ (after[:contacts] - force)
                column = left[:, :contacts] @ h
                variance = h @ column[:contacts] + noise[channel]
                after += column * (off / variance)
                left -= jnp.outer(column, column) / variance
                if k == 0:
                    likelihood -= 0.5 * (off**2 / variance + jnp.log(variance))
                    surprise += off**2 / variance
            force = jnp.clip(after[:contacts], 0.0, self.high)
        rate = after[contacts : 2 * contacts]
        rate = jnp.where((force <= 0) & (rate < 0), 0.0, rate)
        past = jnp.clip(after[2 * contacts :], 0.0, self.high)
        return jnp.concatenate([force, rate, past]), left, likelihood, surprise

    def _ahead(
        self, x: Array, P: Array, turned: Array, dt: Array, contacts: int
    ) -> tuple[Array, Array]:
        """Forces and rates predicted a time dt ahead."""
        rate, one = x[contacts : 2 * contacts], jnp.eye(contacts)
        on = (
            jnp.array([[1.0, 1.0], [0.0, 1.0]]),
            self.acceleration**2
            * jnp.stack([jnp.stack([dt**3 / 3, dt**2 / 2]), jnp.stack([dt**2 / 2, dt])]),
        )
        # Somewhere between the readings the old rate gave way to the new one.
        turn = (
            jnp.array([[1.0, 0.5], [0.0, 0.0]]),
            self.turn**2
            * jnp.stack([jnp.stack([dt**2 / 3, dt / 2]), jnp.stack([dt / 2, jnp.ones_like(dt)])]),
        )
        A, Q = (jnp.where(turned, there, here) for there, here in zip(turn, on, strict=True))
        A = A.at[0, 1].multiply(dt)
        Q = (
            jnp.kron(Q, one)
            .at[:contacts, :contacts]
            .add(jnp.where(turned, jnp.diag(rate**2) * dt**2 / 12, 0.0))
        )
        kept = self.delay * contacts
        whole = jnp.zeros_like(P).at[: 2 * contacts, : 2 * contacts].set(jnp.kron(A, one))
        for k in range(self.delay):
            row, column = (2 + k) * contacts, (1 + k if k else 0) * contacts
            whole = whole.at[row : row + contacts, column : column + contacts].set(one)
        x = whole @ x
        x = x.at[:contacts].set(jnp.clip(x[:contacts], 0.0, self.high))
        return x, whole @ P @ whole.T + jnp.pad(Q, (0, kept))


def _mean(weight: Array, x: Array, P: Array, which: slice) -> tuple[Array, Array]:
    """Mean and standard deviation of some states over all hypotheses."""
    share, x = jnp.exp(weight)[:, None], x[:, which]
    mean = (share * x).sum(0)
    own = jnp.diagonal(P, axis1=1, axis2=2)[:, which]
    spread = (share * (own + (x - mean[None]) ** 2)).sum(0)
    return mean, jnp.sqrt(jnp.maximum(spread, 0.0))
