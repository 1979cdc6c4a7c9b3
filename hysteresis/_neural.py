"""A small network of what a Preisach memory holds."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from ._clamps import clamps
from ._errors import InputError
from ._model import AbstractModel, Series, is_start, time_steps


class StaircaseState(NamedTuple):
    """Time, NaN before the first sample; the plays; the delayed inputs."""

    t: Array
    z: Float[Array, " plays"]
    q: Float[Array, " lags"]


class StaircaseNetwork(AbstractModel[StaircaseState, Array]):
    """A fully connected network of the input and of the memory it has left:

        y = centre_y + spread_y N((x - centre) / spread),     x = (u, z_1, ..., z_m, q_1, ..., q_n)
        z_i <- clip(z_i, u - r_i, u + r_i),     tau_j q_j' + q_j = u,     N: linear, ReLU, ..., linear

    The plays z_i are the heights of the Preisach staircase, the boundary between relays that are up and
    down, over the lines alpha - beta = 2 r_i: what the paper calls the Preisach transform, after which
    the output is a function and has no history. It has no time: delayed inputs q_j say what creep
    holds; without them, `times=()`, the network is the paper's. Both start at rest, at 0.

    **Arguments:**

    - `matrices`, `biases`: of the layers, first to last; what a training changes. See `random`.
    - `thresholds`: (m,) r_i; `times`: (n,) tau_j. `centre`, `spread`: of x, then of y.

    Raises `InputError` for sizes that do not fit, thresholds or times that are not positive.

    Source: Kim and Park (2018), section III A, which prints neither inputs nor their number; Brokate and
    Sprekels, Hysteresis and Phase Transitions (1996), for plays as the staircase.
    """

    matrices: tuple[Float[Array, "_ _"], ...]
    biases: tuple[Float[Array, " _"], ...]
    thresholds: tuple[float, ...] = eqx.field(static=True, converter=tuple)
    times: tuple[float, ...] = eqx.field(static=True, converter=tuple)
    centre: tuple[float, ...] = eqx.field(static=True, converter=tuple)
    spread: tuple[float, ...] = eqx.field(static=True, converter=tuple)

    def __check_init__(self) -> None:
        inputs = 1 + len(self.thresholds) + len(self.times)
        if min((1.0, *self.thresholds, *self.times, *self.spread)) <= 0:
            raise InputError("not-positive", "thresholds, times and spreads have to be above 0.")
        if len(self.centre) != inputs + 1 or len(self.spread) != inputs + 1:
            raise InputError(
                "network-inputs",
                f"{inputs} inputs and an output have {len(self.centre)} centres and "
                f"{len(self.spread)} spreads.",
                fix="start from StaircaseNetwork.random.",
            )

    @classmethod
    def random(
        cls,
        inputs: Sequence[Float[np.ndarray, " samples"]],
        outputs: Sequence[Float[np.ndarray, " samples"]],
        times: Sequence[Float[np.ndarray, " samples"]],
        key: PRNGKeyArray,
        *,
        thresholds: Sequence[float],
        lags: Sequence[float] = (),
        hidden: Sequence[int] = (25, 12),
    ) -> "StaircaseNetwork":
        """A network to start a training from, its inputs and output scaled as these records' are.

        Matrices are normal with variance 2 / inputs (He 2015), which keeps the size of what ReLUs pass.
        """
        widths = (1 + len(thresholds) + len(lags), *hidden, 1)
        keys = jax.random.split(key, len(widths) - 1)
        matrices = tuple(
            jax.random.normal(one, (out, in_)) * np.sqrt(2 / in_)
            for one, in_, out in zip(keys, widths, widths[1:], strict=False)
        )
        biases = tuple(jnp.zeros(out) for out in widths[1:])
        same = (0.0,) * (widths[0] + 1), (1.0,) * (widths[0] + 1)
        plain = cls(matrices, biases, thresholds, lags, *same)
        pairs = zip(times, inputs, strict=True)
        x = np.concatenate([np.asarray(plain.prepare(t, u)) for t, u in pairs])
        whole = [*x.T, np.concatenate([np.asarray(y) for y in outputs])]
        centre, spread = (tuple(float(f(v)) for v in whole) for f in (np.mean, np.std))
        # An input that never moves says nothing, whatever its scale.
        return cls(
            matrices, biases, thresholds, lags, centre, [s if s > 0 else 1.0 for s in spread]
        )

    def init(self, t0: Any = None, u0: Any = None) -> StaircaseState:
        never = jnp.asarray(jnp.nan, float)
        return StaircaseState(never, jnp.zeros(len(self.thresholds)), jnp.zeros(len(self.times)))

    def step(
        self, state: StaircaseState, t: Any, u: Any
    ) -> tuple[StaircaseState, Float[Array, ""]]:
        u, t = jnp.asarray(u, state.z.dtype), jnp.asarray(t, state.z.dtype)
        dt = jnp.where(jnp.isnan(state.t), 0.0, t - state.t)
        r, tau = jnp.array(self.thresholds, u.dtype), jnp.array(self.times, u.dtype)
        z = jnp.clip(state.z, u - r, u + r)
        kept = jnp.exp(-dt / tau)
        q = kept * state.q + (1 - kept) * u
        x = jnp.concatenate([u[None], z, q])
        return StaircaseState(t, z, q), self.evaluate(x[None])[0]

    def prepare(
        self,
        t: Series | None,
        u: Series,
        state: StaircaseState | None = None,
        *,
        starts: tuple[int, ...] = (0,),
    ) -> Float[Array, "samples inputs"]:
        """The network's inputs x: all that depends on the record."""
        if t is None and self.times:
            raise InputError("no-time", "delayed inputs need the times.", fix="give t, or lags=().")
        u = jnp.asarray(u, float)
        t = jnp.zeros_like(u) if t is None else jnp.asarray(t, float)
        return _inputs(self, t, u, self.init() if state is None else state, starts)

    def evaluate(self, prepared: Float[Array, "samples inputs"]) -> Float[Array, " samples"]:
        dtype = prepared.dtype
        centre, spread = jnp.array(self.centre, dtype), jnp.array(self.spread, dtype)
        # Samples last, so that they are what the processor's vectors hold.
        value = ((prepared - centre[None, :-1]) / spread[None, :-1]).T
        last = len(self.matrices) - 1
        for k, (W, b) in enumerate(zip(self.matrices, self.biases, strict=True)):
            value = W @ value + b[:, None]
            value = value if k == last else jax.nn.relu(value)
        return centre[-1] + spread[-1] * value[0]


@eqx.filter_jit
def _inputs(
    model: StaircaseNetwork, t: Array, u: Array, state: StaircaseState, starts: tuple[int, ...]
) -> Array:
    start = is_start(len(u), starts) > 0
    columns = [u[:, None]]
    if model.thresholds:
        r = jnp.array(model.thresholds, u.dtype)[None]
        columns.append(clamps(u[:, None] - r, u[:, None] + r, state.z, start))
    if model.times:
        dt = time_steps(t, state.t, starts)[:, None]
        kept = jnp.exp(-dt / jnp.array(model.times, u.dtype)[None])

        def follow(q: Array, row: tuple[Array, Array, Array]) -> tuple[Array, Array]:
            keeps, now, first = row
            q = keeps * jnp.where(first, state.q, q) + (1 - keeps) * now
            return q, q

        columns.append(jax.lax.scan(follow, state.q, (kept, u, start))[1])
    return jnp.concatenate(columns, 1)
