"""The forces of several contacts at once, from channels in which their readings add, by a filter."""

import itertools
from collections.abc import Callable, Iterable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, register
from hysteresis._parameter import PyTree

from .. import _traced as traced
from .._contract import AbstractStreamed, Status, scanned
from ..runtime._contact_forces import LOST, Setting, Way, mean_of, updated


@register
class ChannelSensor(eqx.Module):
    """Channels in series: every contact adds its own part to every layer's reading,

        z_l = zero_l + sum_k G_lk M_k[F_k],

    with a model M_k, force -> reading, of each location, and the layers' gains. So models that were
    fitted to presses of one location at a time predict the reading of several contacts.

    **Arguments:**

    - `models`: one for each location. `gains`: G, (layers, locations); None for 1 in one layer.
    - `zero` (layers,): the reading where nothing is pressed; 0 by default.

    **Raises:** `InputError` where these do not fit.

    **Example:**

        >>> sensor = compensate.internal.ChannelSensor([model, model], [[1.0, 0.5], [0.5, 1.0]])
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
    def contacts(self) -> int:
        """How many."""
        return len(self.models)

    def init(self) -> tuple[PyTree, ...]:
        """The virgin state."""
        return tuple(model.init() for model in self.models)

    def look(self, state: tuple[PyTree, ...], t: Array, force: Array) -> tuple[Array, Array]:
        """The next readings if these were the forces, and their derivatives (layers, contacts)."""
        found = [
            jax.jvp(lambda u, m=model, s=own: m.step(s, t, u)[1], (F,), (jnp.ones_like(F),))
            for model, own, F in zip(self.models, state, force, strict=True)
        ]
        y, slope = (jnp.stack(part) for part in zip(*found, strict=True))
        return self.zero + self.gains @ y, self.gains * slope[None]

    def follow(self, state: tuple[PyTree, ...], t: Array, force: Array) -> tuple[PyTree, ...]:
        """The state after these forces."""
        each = zip(self.models, state, force, strict=True)
        return tuple(model.step(own, t, F)[0] for model, own, F in each)


class Motion(NamedTuple):
    """What may have happened: a `Way` of arrays (ways, ...), because when the last turn was is not known at
    once; the time of the last reading, NaN before the first; how many in turn surprised all ways."""

    ways: Way
    t: Float[Array, ""]
    lost: Int[Array, ""]


class ContactForces(NamedTuple):
    """Forces (..., contacts) in N, their standard deviations, and a `Status` for each reading.

    `late`, `late_deviation`: of the forces `delay` readings ago, which by now are known better.
    EXTRAPOLATED says that no forces explain the reading, SATURATED that one is at the end of its range.
    """

    value: Float[Array, "*samples contacts"]
    deviation: Float[Array, "*samples contacts"]
    late: Float[Array, "*samples contacts"]
    late_deviation: Float[Array, "*samples contacts"]
    status: Int[Array, "*samples"]


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

        >>> motion = compensate.internal.MotionFilter(high=6.0, ways=4)
        >>> motion.init(channels).ways.covariance.shape
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

    def init(self, sensor: ChannelSensor) -> Motion:
        """At rest, without a force, the sensor virgin."""
        states = (2 + self.delay) * sensor.contacts
        weight = jnp.full(self.ways, -jnp.inf).at[0].set(0.0)
        state = jax.tree.map(lambda leaf: jnp.stack([leaf] * self.ways), sensor.init())
        x, covariance = jnp.zeros((self.ways, states)), jnp.zeros((self.ways, states, states))
        ways = Way(x, covariance, weight, state, jnp.zeros_like(weight))
        return Motion(ways, jnp.asarray(jnp.nan, x.dtype), jnp.zeros((), int))

    def update(
        self,
        sensor: ChannelSensor,
        motion: Motion,
        t: Float[Array, ""],
        z: Float[Array, " channels"],
        noise: Float[Array, " channels"],
    ) -> tuple[Motion, ContactForces]:
        """One reading z of variances `noise`, independent of one another."""
        dt = jnp.where(jnp.isnan(motion.t), self.gap_s, jnp.maximum(t - motion.t, 0.0))
        setting = Setting(traced, self, sensor, t, dt, z, noise)
        ways, lost, surprise = updated(setting, motion.ways, motion.lost)
        contacts, last = sensor.contacts, ways.x.shape[1] * bool(self.delay)
        told = mean_of(traced, ways, range(contacts))
        late = mean_of(traced, ways, range(last - contacts, last)) if last else told
        status = jnp.where((told[0] >= self.high).any(), Status.SATURATED, Status.OK)
        status = jnp.where(surprise > LOST, Status.EXTRAPOLATED, status)
        return Motion(ways, t, lost), ContactForces(*told, *late, status)


class MultiContactState(NamedTuple):
    """What may have happened, and the last forces."""

    motion: Motion
    last: ContactForces


@register
class MultiContactEstimator(AbstractStreamed[MultiContactState, ContactForces]):
    """Forces of several contacts from a differentiable sensor model with memory, by Gauss-Newton:

        maximise  -sum_l (z_l - h_l(F))^2 / (2 sigma_l^2) + log p(F | before)      at every reading

    for each hypothesis about recent turns of the forces, see `MotionFilter`. With one contact and one
    channel it estimates the force from one reading; it is the best choice where noise matters.

    **Arguments:**

    - `sensor`: forces -> readings, of models fitted to presses of one location.
    - `reading_sigma`: standard deviation of each channel's reading, its noise and the models' error.
    - `motion`: how forces move.

    **Raises:** `InputError` for deviations that are not positive.

    **Source:** the inverse for which Kim and Park (2018), section III D, use a grid search.

    **Example:**

        >>> motion = compensate.internal.MotionFilter(high=6.0, ways=3)
        >>> both = compensate.internal.MultiContactEstimator(channels, [0.01, 0.01], motion)
        >>> y = np.asarray(model.simulate(t, u))  # the first contact alone is pressed
        >>> both.simulate(0.1 * t, np.column_stack([y, 0.5 * y])).value[4].round(1).tolist()
        [4.0, 0.0]
    """

    sensor: ChannelSensor
    reading_sigma: Float[Array, " channels"]
    motion: MotionFilter
    along = 0

    def __init__(self, sensor: ChannelSensor, reading_sigma: ArrayLike, motion: MotionFilter):
        sigma = np.atleast_1d(np.asarray(reading_sigma, float))
        if sigma.ndim != 1 or not (np.isfinite(sigma) & (sigma > 0)).all():
            raise InputError(
                "bad-deviation", "reading_sigma is no standard deviation for each channel."
            )
        self.sensor, self.reading_sigma, self.motion = sensor, jnp.asarray(sigma), motion

    def init(self) -> MultiContactState:
        """At rest, no location pressed."""
        none = jnp.zeros(self.sensor.contacts)
        last = ContactForces(none, none, none, none, jnp.asarray(Status.OK, int))
        return MultiContactState(self.motion.init(self.sensor), last)

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: MultiContactState
    ) -> tuple[MultiContactState, ContactForces]:
        """Readings (samples, channels)."""
        z = jnp.asarray(y, float)
        if z.ndim != 2 or z.shape[1] != self.reading_sigma.shape[0]:
            raise InputError(
                "wrong-channels",
                f"readings of shape {z.shape} for {self.reading_sigma.shape[0]} channels.",
                fix="give (samples, channels).",
            )
        return scanned(self, t, z, state)

    def take(
        self, state: MultiContactState, t: ArrayLike | None, reading: ArrayLike
    ) -> tuple[MultiContactState, ContactForces]:
        """One reading (channels,) in V at time t in s. One with a NaN is INVALID: all is held."""
        z = jnp.asarray(reading, self.reading_sigma.dtype)
        t = jnp.asarray(t, z.dtype)
        valid = jnp.isfinite(z).all() & jnp.isfinite(t)
        found = self.motion.update(self.sensor, state.motion, t, z, self.reading_sigma**2)
        after = MultiContactState(*found)
        after = jax.tree.map(lambda new, old: jnp.where(valid, new, old), after, state)
        status = jnp.where(valid, after.last.status, Status.INVALID)
        return after, after.last._replace(status=status)


# Forces of several contacts as in the paper: a recurrent network for each, and a search.

SEQUENCE = 20
PREOCCUPIED = 10
REACH_N, RESOLUTION_N = 0.4, 0.1
GATES = 4

Network = Callable[[Array], Array]
"""Windows of forces (windows, sequence) -> readings at their ends (windows, layers)."""


class ForceNetwork(eqx.Module):
    """Readings from the last 20 forces of one location: LSTM layers, a dense layer, a linear layer.

        i, f, o = sigmoid(W x + U h + b),  c <- f c + i relu(W x + U h + b),  h <- o relu(c)  in each layer
        z = V relu(D dropout(h_3) + d) + v,      of the last of the sequence

    **Arguments:** the weights, see `random`; `dropout`: the share of the last layer that a training omits;
    `inference`: True omits none.

    **Source:** Kim and Park (2018), section III D: three layers of 70, dropout of 0.5 at the third, a fully
    connected layer of 25, ReLU throughout, sequences of 20.

    **Example:**

        >>> start = compensate.internal.ForceNetwork.random(jax.random.key(0), hidden=6, depth=1)
        >>> start(jnp.zeros((13, 20))).shape
        (13, 2)
    """

    matrices: tuple[Float[Array, "_ gates"], ...]
    biases: tuple[Float[Array, " gates"], ...]
    dense: Float[Array, "hidden dense"]
    dense_bias: Float[Array, " dense"]
    line: Float[Array, "dense layers"]
    line_bias: Float[Array, " layers"]
    dropout: float = eqx.field(default=0.5, static=True)
    inference: bool = False

    @classmethod
    def random(
        cls,
        key: PRNGKeyArray,
        *,
        layers: int = 2,
        hidden: int = 70,
        depth: int = 3,
        dense: int = 25,
    ) -> "ForceNetwork":
        """A network to start a training from; forget gates begin open, as is usual."""
        keys = iter(jax.random.split(key, depth + 2))

        def normal(in_: int, out: int) -> Array:
            return jax.random.normal(next(keys), (in_, out)) / np.sqrt(in_)

        inputs = [1] + [hidden] * (depth - 1)
        matrices = tuple(normal(in_ + hidden, GATES * hidden) for in_ in inputs)
        open_ = jnp.zeros(GATES * hidden).at[hidden : 2 * hidden].set(1.0)
        return cls(
            matrices, (open_,) * depth, normal(hidden, dense), jnp.zeros(dense),
            normal(dense, layers), jnp.zeros(layers),
        )  # fmt: skip

    def __call__(
        self, force: Float[Array, "windows sequence"], key: PRNGKeyArray | None = None
    ) -> Float[Array, "windows layers"]:
        """Readings at the end of windows of forces; `key` for the dropout of a training."""
        rows = jnp.swapaxes(force, 0, 1)[..., None]
        for W, b in zip(self.matrices, self.biases, strict=True):
            rows = _layer(W, b, rows)
        last = rows[-1]
        if not self.inference and key is not None:
            kept = jax.random.bernoulli(key, 1 - self.dropout, last.shape)
            last = jnp.where(kept, last / (1 - self.dropout), 0.0)
        last = jax.nn.relu(last @ self.dense + self.dense_bias[None])
        return last @ self.line + self.line_bias[None]


def _layer(W: Array, b: Array, rows: Float[Array, "sequence windows in_"]) -> Array:
    hidden = W.shape[1] // GATES
    into, round_ = W[:-hidden], W[-hidden:]
    driven = rows @ into + b[None, None]

    def move(carry: tuple[Array, Array], x: Array) -> tuple[tuple[Array, Array], Array]:
        h, c = carry
        i, f, o, g = jnp.split(x + h @ round_, GATES, axis=1)
        c = jax.nn.sigmoid(f) * c + jax.nn.sigmoid(i) * jax.nn.relu(g)
        h = jax.nn.sigmoid(o) * jax.nn.relu(c)
        return (h, c), h

    none = jnp.zeros((rows.shape[1], hidden), rows.dtype)
    return jax.lax.scan(move, (none, none), driven)[1]


def windows(
    force: Float[np.ndarray, " samples"], sequence: int = SEQUENCE
) -> Float[np.ndarray, "samples sequence"]:
    """The last `sequence` forces at every sample, the latest last; before the first they are zero."""
    padded = np.concatenate([np.zeros(sequence - 1), np.asarray(force, float)])
    return np.lib.stride_tricks.sliding_window_view(padded, sequence).copy()


class SearchEstimator(AbstractStreamed[Array, Array]):
    """The paper's inverse: a grid search for the forces whose reading is closest.

        F_n = argmin over F in F_(n-1) + {-0.4, -0.3, ..., 0.4}^contacts of |z_n - sum_k N_k(F_k, past)|^2

    Two contacts have 81 pairs of forces, from two times 9 sequences. The search starts from ten zeros, and
    forces are never negative. It gives no uncertainty, and no force can change faster than 0.4 N a sample.

    **Arguments:** `networks`, one for each location: (windows, sequence) -> (windows, layers).

    **Source:** Kim and Park (2018), section III D.

    **Example:**

        >>> networks = [lambda F: F[:, -1:] * jnp.array([[1.0, 0.5]])]
        >>> search = compensate.internal.SearchEstimator(networks)
        >>> search.simulate(None, np.array([[0.3, 0.15], [0.6, 0.3]])).round(6).tolist()
        [[0.3], [0.6]]
    """

    networks: tuple[Network, ...] = eqx.field(converter=tuple)
    sequence: int = eqx.field(default=SEQUENCE, static=True)
    along = 0

    def __check_init__(self) -> None:
        if not self.networks or self.sequence < PREOCCUPIED:
            raise InputError("bad-option", f"no network, or sequences shorter than {PREOCCUPIED}.")

    def init(self) -> Float[Array, "contacts past"]:
        """The forces found last: the paper's ten zeros, and those before them that fill a sequence."""
        return jnp.zeros((len(self.networks), self.sequence - 1))

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: Array
    ) -> tuple[Array, Float[Array, "samples contacts"]]:
        """Readings (samples, layers)."""
        return scanned(self, None, jnp.asarray(y, float), state)

    def take(self, state: Array, t: ArrayLike | None, reading: ArrayLike) -> tuple[Array, Array]:
        """One reading (layers,) in, forces (contacts,) in N out; `t` does not matter."""
        z = jnp.asarray(reading, state.dtype)
        valid = jnp.isfinite(z).all()
        count = round(REACH_N / RESOLUTION_N)
        away = RESOLUTION_N * jnp.arange(-count, count + 1, dtype=z.dtype)
        tried = jnp.maximum(state[:, -1:] + away[None], 0.0)
        read = []
        for network, past, own in zip(self.networks, state, tried, strict=True):
            same = jnp.broadcast_to(past, (len(away), *past.shape))
            read.append(network(jnp.concatenate([same, own[:, None]], 1)))
        grid = jnp.array(list(itertools.product(range(len(away)), repeat=len(self.networks))))
        whole = sum(r[grid[:, k]] for k, r in enumerate(read))
        best = grid[jnp.argmin(((whole - z[None]) ** 2).sum(1))]
        force = jnp.take_along_axis(tried, best[:, None], 1)
        after = jnp.concatenate([state[:, 1:], force], 1)
        state = jnp.where(valid, after, state)
        return state, state[:, -1]
