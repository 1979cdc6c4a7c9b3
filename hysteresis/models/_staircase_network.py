"""A small neural network whose inputs are the contents of a Preisach memory."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from .._errors import InputError
from .._model import AbstractFollowingModel, Series, evaluated, is_start, time_steps
from .._parameter import Output, Starts, Times
from .._registry import register
from ..numerics._functions import clamps


class StaircaseState(NamedTuple):
    """Time, NaN before the first sample; the plays and the delayed inputs, of every channel."""

    t: Array
    z: Float[Array, "*channels plays"]
    q: Float[Array, "*channels lags"]


def _floats(numbers: Iterable[Any]) -> tuple[float, ...]:
    return tuple(map(float, numbers))


@register
class StaircaseNetwork(AbstractFollowingModel[StaircaseState, Array]):
    """A fully connected network of the input and of the memory that the input has left:

        y = centre_y + spread_y N((x - centre) / spread),     x = (u, z_1, ..., z_m, q_1, ..., q_n)
        z_i <- clip(z_i, u - s r_i, u + s r_i),     tau_j q_j' + q_j = u,     N: linear, ReLU, ..., linear

    The plays z_i are the heights of the Preisach staircase, the boundary between relays that are up and
    down, over the lines alpha - beta = 2 r_i. The paper calls them the Preisach transform; given them, the
    output is a function without history. Plays do not depend on time, so the delayed inputs q_j represent
    creep. Without delayed inputs, `times=()`, the network is the paper's. Both start at rest.

    Several channels, inputs (samples, channels), have plays and delays of their own, and x holds them
    channel after channel.

    **Arguments:**

    - `matrices`, `biases`: of the layers, first to last; training changes them. See `random`.
    - `thresholds`: (m,) r_i, in units of `scale`; `times`: (n,) tau_j in s. `centre`, `spread`: of x, then
      of y.
    - `rest`, `scale`: (channels,) the input where plays and delays start, and s.

    Raises `InputError` for sizes that do not fit, thresholds, times or scales that are not positive.

    Source: Kim and Park (2018), section III A, which states neither the inputs nor their number; Brokate
    and Sprekels, Hysteresis and Phase Transitions (1996), for the staircase as plays.

    **Example:**

        >>> network = hysteresis.internal.StaircaseNetwork.random(
        ...     [u], [2 * u], [t], jax.random.key(0), thresholds=(0.5, 1.0), lags=(2.0,))
        >>> network.simulate(t, u).shape
        (13,)
        >>> network.prepare(t, u).shape
        (13, 4)
    """

    matrices: tuple[Float[Array, "_ _"], ...]
    biases: tuple[Float[Array, " _"], ...]
    thresholds: tuple[float, ...] = eqx.field(static=True, converter=_floats)
    times: tuple[float, ...] = eqx.field(static=True, converter=_floats)
    centre: tuple[float, ...] = eqx.field(static=True, converter=_floats)
    spread: tuple[float, ...] = eqx.field(static=True, converter=_floats)
    rest: tuple[float, ...] = eqx.field(default=(0.0,), static=True, converter=_floats)
    scale: tuple[float, ...] = eqx.field(default=(1.0,), static=True, converter=_floats)

    def __check_init__(self) -> None:
        if min((1.0, *self.thresholds, *self.times, *self.spread, *self.scale)) <= 0:
            problem = "thresholds, times, spreads and scales have to be above 0."
            raise InputError("parameter-out-of-bounds", problem)
        if len(self.rest) != len(self.scale) or not self.rest:
            problem = f"{len(self.rest)} readings at rest and {len(self.scale)} scales."
            raise InputError("wrong-channels", problem, fix="give both one for each channel.")
        inputs = self.channels * (1 + len(self.thresholds) + len(self.times))
        if len(self.centre) != inputs + 1 or len(self.spread) != inputs + 1:
            raise InputError(
                "wrong-shape",
                f"{inputs} inputs and an output have {len(self.centre)} centres and "
                f"{len(self.spread)} spreads.",
                fix="start from StaircaseNetwork.random.",
            )

    @property
    def channels(self) -> int:
        """How many readings make a sample."""
        return len(self.rest)

    @classmethod
    def random(
        cls,
        inputs: Sequence[Float[np.ndarray, "_ *channels"]],
        outputs: Sequence[Float[np.ndarray, " _"]],
        times: Sequence[Float[np.ndarray, " _"]],
        key: PRNGKeyArray,
        *,
        thresholds: Sequence[float],
        lags: Sequence[float] = (),
        hidden: Sequence[int] = (25, 12),
        rest: Sequence[float] = (0.0,),
        scale: Sequence[float] = (1.0,),
    ) -> "StaircaseNetwork":
        """An untrained network, its inputs and output scaled by the mean and the spread of these records.

        Matrices are normal with variance 2 / inputs (He 2015), so that ReLUs preserve the size of signals.
        """
        widths = (len(tuple(rest)) * (1 + len(thresholds) + len(lags)), *hidden, 1)
        keys = jax.random.split(key, len(widths) - 1)
        matrices = tuple(
            jax.random.normal(one, (out, in_)) * np.sqrt(2 / in_)
            for one, in_, out in zip(keys, widths, widths[1:], strict=False)
        )
        biases = tuple(jnp.zeros(out) for out in widths[1:])
        same = (0.0,) * (widths[0] + 1), (1.0,) * (widths[0] + 1)
        plain = cls(matrices, biases, thresholds, lags, *same, rest, scale)
        starts = tuple(int(k) for k in np.cumsum([0, *map(len, inputs)])[:-1])
        x = plain.prepare(np.concatenate(times), np.concatenate(inputs), starts=starts)
        whole = [*np.asarray(x).T, np.concatenate(outputs)]
        centre, spread = (tuple(float(f(v)) for v in whole) for f in (np.mean, np.std))
        # The spread of an input that never moves is 0; any other scale avoids the division by it.
        spread = [s if s > 0 else 1.0 for s in spread]
        return cls(matrices, biases, thresholds, lags, centre, spread, rest, scale)

    @classmethod
    def mean(cls, networks: "Sequence[StaircaseNetwork]") -> "StaircaseNetwork":
        """One network that gives the mean of several with the same inputs, such as several trainings.

        Its layers hold all of theirs side by side.

        Raises `InputError` for none, and for networks that differ in more than their weights.
        """
        kinds = {jax.tree.structure(network) for network in networks}
        if len(kinds) != 1:
            said = f"a mean of {len(networks)} networks of {len(kinds)} kinds."
            mend = "give networks of the same layers, thresholds, times and scales."
            raise InputError("bad-parts", said, fix=mend)
        layers = zip(*(network.matrices for network in networks), strict=True)
        first, *later = layers
        matrices = [jnp.concatenate(first), *(jax.scipy.linalg.block_diag(*W) for W in later)]
        layers = zip(*(network.biases for network in networks), strict=True)
        biases = [jnp.concatenate(b) for b in layers]
        # The last layer has an output for each network.
        matrices[-1] = matrices[-1].mean(0, keepdims=True)
        biases[-1] = biases[-1].mean(keepdims=True)
        return replace(networks[0], matrices=tuple(matrices), biases=tuple(biases))

    def init(self, t0: Any = None, u0: Any = None) -> StaircaseState:
        never = jnp.asarray(jnp.nan, float)
        rest = jnp.array(self.rest, float)[:, None]
        z, q = (jnp.repeat(rest, len(part), 1) for part in (self.thresholds, self.times))
        return (
            StaircaseState(never, z, q) if self.channels > 1 else StaircaseState(never, z[0], q[0])
        )

    def follow(
        self, t: Times, u: Series, state: StaircaseState | None = None
    ) -> tuple[StaircaseState, Output]:
        before = self.init() if state is None else state
        x = self.prepare(t, u, before)
        if not len(x):
            return before, jnp.zeros(0)
        last = jnp.zeros(()) if t is None else jnp.asarray(t, float)[-1]
        _, z, q = jnp.split(x[-1].reshape(self.channels, -1), [1, 1 + len(self.thresholds)], 1)
        after = StaircaseState(last, z.reshape(before.z.shape), q.reshape(before.q.shape))
        return after, evaluated(self, x)

    def prepare(
        self, t: Times, u: Series, state: StaircaseState | None = None, *, starts: Starts = (0,)
    ) -> Float[Array, "samples inputs"]:
        """The network's inputs x: all that depends on the record; u (samples,) or (samples, channels)."""
        if t is None and self.times:
            raise InputError("no-time", "delayed inputs need the times.", fix="give t, or lags=().")
        u = jnp.asarray(u, float)
        if u.shape[1:] != (() if self.channels == 1 else (self.channels,)):
            said = f"inputs of shape {u.shape} for a network of {self.channels} channels."
            mend = "give (samples,) of one channel, (samples, channels) of several."
            raise InputError("wrong-channels", said, fix=mend)
        t = jnp.zeros(len(u), u.dtype) if t is None else jnp.asarray(t, float)
        return _inputs(self, t, u, self.init() if state is None else state, starts)

    def evaluate(self, prepared: Float[Array, "samples inputs"]) -> Float[Array, " samples"]:
        dtype = prepared.dtype
        centre, spread = jnp.array(self.centre, dtype), jnp.array(self.spread, dtype)
        # Samples are the last axis, so that the processor's vector instructions run along them.
        value = ((prepared - centre[None, :-1]) / spread[None, :-1]).T
        last = len(self.matrices) - 1
        for k, (W, b) in enumerate(zip(self.matrices, self.biases, strict=True)):
            value = W @ value + b[:, None]
            value = value if k == last else jax.nn.relu(value)
        return centre[-1] + spread[-1] * value[0]


@eqx.filter_jit
def _inputs(
    model: StaircaseNetwork, t: Array, u: Array, state: StaircaseState, starts: Starts
) -> Array:
    samples, plays, lags = len(u), len(model.thresholds), len(model.times)
    start = is_start(samples, starts) > 0
    # Channels and their plays or delays are all rows of one table until the end.
    u = u.reshape(samples, model.channels)
    columns = [u[..., None]]
    if plays:
        scale, thresholds = (jnp.array(x, u.dtype) for x in (model.scale, model.thresholds))
        r = jnp.outer(scale, thresholds)[None]
        low, high = (jnp.reshape(u[..., None] + s * r, (samples, -1)) for s in (-1, 1))
        columns.append(clamps(low, high, state.z.ravel(), start).reshape(samples, -1, plays))
    if lags:
        dt = time_steps(t, state.t, starts)[:, None]
        kept = jnp.exp(-dt / jnp.array(model.times, u.dtype)[None])
        q0 = state.q.reshape(model.channels, lags)

        def follow(q: Array, row: tuple[Array, Array, Array]) -> tuple[Array, Array]:
            keeps, now, first = row
            q = keeps[None] * jnp.where(first, q0, q) + (1 - keeps)[None] * now[:, None]
            return q, q

        columns.append(jax.lax.scan(follow, q0, (kept, u, start))[1])
    return jnp.concatenate(columns, 2).reshape(samples, -1)
