"""A guard around a compensator: estimates limited to the trained inputs, and a status while it runs in."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, register
from hysteresis._known_past import known_past, outputs_of
from hysteresis._law_model import once
from hysteresis._parameter import array_module, as_array, as_float, is_concrete
from hysteresis.laws.guard import BEGUN
from hysteresis.numerics._functions import NORMAL_95
from hysteresis.running import Numbers, each, numbers_of
from hysteresis.trees import Tree, node

from .._contract import AbstractCompensator, Found, Status
from .._readings import conditioned_in, latest_of, nested, reading_of, with_reading
from ..inverses._law import beyond_knots
from ..runtime._file import LONGEST
from ._run_in import Start, driven, first_draw, then

BEYOND = ("limit", "nan", "free")
"""What becomes of an estimate beyond the trained inputs."""

ROUNDING = 1e-6
"""Part of the trained range. Just after a reversal 1e-14 of the output is 1e-7 of the input, so an estimate
closer than that to an end is at the end."""


UNSTATED = 0.01
"""Part of the trained range to which starts have to agree where no deviation is stated."""

LASTING = 1000.0
"""Durations of the readings that one step may take."""


def within_of(deviation: float, low: float | Array, high: float | Array) -> float | Array:
    """How far apart the estimates of all starts may be, for a deviation and the trained inputs."""
    return deviation if deviation > 0 else UNSTATED * (high - low)


def limited(
    compensator: AbstractCompensator, value: np.ndarray
) -> tuple[AbstractCompensator, np.ndarray]:
    """Without the guard of the trained inputs; which values are not within them.

    Where it holds an estimate at an end the model's output is not the reading, though it is OK while its
    band reaches the end. From then on what is inside goes on from its own estimates, which are not those
    that are told.
    """
    if (guard := guard_in(compensator)) is None:
        return compensator, np.zeros(value.shape, bool)
    return guard.inner, (value <= float(guard.low)) | (value >= float(guard.high))


def guard_in(compensator: AbstractCompensator) -> "GuardedCompensator[Any] | None":
    """The guard that a compensator is, or is around; None where there is none."""
    return next((one for one in nested(compensator) if isinstance(one, GuardedCompensator)), None)


def longest_step(t: ArrayLike) -> float:
    """The longest time between two samples of a compensator that was made for readings at the times `t`.

    Beyond, a free dashpot would flow so far that nothing of the readings is left in the numbers.
    """
    return min(LASTING * (float(np.ptp(np.asarray(t, float))) or 1.0), LONGEST)


class GuardedState(NamedTuple):
    """The inner state; those of the other starts; the time of the last reading, NaN before the first one,
    and that since the first, long steps shortened; what the guard's law keeps; the last estimate."""

    inner: Any
    others: tuple[Any, ...]
    last: Array
    clock: Array
    limited: Array
    value: Array


def _pair(given: Any) -> tuple[float, float] | None:
    return None if given is None else (float(given[0]), float(given[1]))


@register
class GuardedCompensator(AbstractCompensator[GuardedState, Found]):
    """A compensator whose estimates stay within the inputs that its model was trained on.

    ```math
    \\hat u = \\mathrm{clip}(\\hat u_\\text{inner}, low, high)
    ```

    Every estimate beyond is `EXTRAPOLATED`, or `SATURATED` where the inner compensator says so; one whose
    band of 1.645 `deviation` reaches the trained inputs is not told, nor is rounding, a millionth of the
    range. The memory goes on with what the inner compensator found: an excursion of the input beyond the
    range, and back, is remembered as it was.

    A reading that the training had, below `seen[1]` and above `seen[0]`, is no news where the model is
    `SATURATED`: at rest, noise takes it beyond the outputs that the model has. The end is given, `OK`.

    With `starts`, the state before the first sample is not known: it may be the inner compensator's own, or
    one of these. All of them follow the readings, and the status is `RUN_IN`, in place of `OK` and `FLAT`,

    ```math
    \\text{until}\\quad \\max_k |\\hat u_k - \\hat u_\\text{inner}| \\le \\text{deviation}
    ```

    for a quarter as many readings as they were farther apart, because estimates also cross.

    The deviation of the estimate is that of the inner compensator; beyond the range it does not say how far
    beyond the input is.

    **Arguments:**

    - `inner`: any compensator; it is given times since the first reading.
    - `low`, `high`: the trained inputs, in the input's unit.
    - `beyond`: `"limit"` as above; `"nan"`: an estimate beyond is NaN; `"free"`: only the status tells.
    - `starts`: other states of `inner` before the first reading, at time 0. None: the first state is known.
    - `deviation`: of usual estimates, in the input's unit; 0 where none is stated: starts then have to
      agree to a hundredth of the range.
    - `seen`: the least and the greatest reading of the training rows; None where they are not known.
    - `readings`: readings beyond these are taken for the nearer end, `EXTRAPOLATED`; as exports do.
    - `longest`: the longest time between two readings, in the unit of `t`; a longer one is taken for it,
      `EXTRAPOLATED`, as exports do. None: a step of any length is taken as it is.

    **Raises:** `InputError` `zero-range` for limits that are not low < high, `bad-option` for another
    `beyond`, and for a `longest` that is not positive.
    """

    inner: AbstractCompensator[Any, Found]
    low: Float[Array, ""] = eqx.field(converter=lambda x: jnp.asarray(x, float))
    high: Float[Array, ""] = eqx.field(converter=lambda x: jnp.asarray(x, float))
    beyond: str = eqx.field(default="limit", static=True)
    starts: tuple[Start, ...] = ()
    deviation: float = eqx.field(default=0.0, static=True, converter=float)
    seen: tuple[float, float] | None = eqx.field(default=None, static=True, converter=_pair)
    readings: tuple[float, float] | None = eqx.field(default=None, static=True, converter=_pair)
    longest: Float[Array, ""] | None = eqx.field(default=None, converter=as_float)

    def __check_init__(self) -> None:
        if self.beyond not in BEYOND:
            raise InputError(
                "bad-option",
                f"beyond={self.beyond!r} is unknown.",
                fix='give "limit", "nan" or "free".',
            )
        if is_concrete(self.low) and not bool(self.low < self.high):
            raise InputError(
                "zero-range",
                f"the trained inputs reach from {float(self.low):g} to {float(self.high):g}.",
                fix="give low < high, the least and the greatest input of the training rows.",
            )
        if is_concrete(self.longest) and not np.all(np.asarray(self.longest) > 0):
            raise InputError(
                "bad-option", f"longest={self.longest} is not a time.", fix="give a positive time."
            )

    @property
    def slack(self) -> Array:
        """How far beyond the trained inputs an estimate may be and is not told."""
        return jnp.maximum(ROUNDING * (self.high - self.low), NORMAL_95 * self.deviation)

    @property
    def within(self) -> Array:
        """How far apart the estimates of all starts may be."""
        return jnp.asarray(within_of(self.deviation, self.low, self.high))

    def init(self) -> GuardedState:
        none, others = jnp.asarray(jnp.nan, float), tuple(start.state for start in self.starts)
        own = jnp.asarray(self._numbers.state, float)
        return GuardedState(self.inner.init(), others, none, jnp.zeros_like(none), own, none)

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: GuardedState
    ) -> tuple[GuardedState, Found]:
        # Outside of JAX's programs it is NumPy's, which compiles nothing for a length.
        xp = array_module(t, y, *jax.tree.leaves((self, state)))
        inner, others, *kept = state
        last, clock, limited, before = map(xp.asarray, kept)
        given: Any = xp.asarray(y, float)
        reading = reading_of(given, 1)
        seen = reading
        if self.readings is not None:
            seen = xp.where(xp.isfinite(seen), xp.clip(seen, *self.readings), seen)
        times = xp.zeros_like(reading) if t is None else xp.asarray(t, float)
        longest = xp.inf if self.longest is None else xp.asarray(self.longest)
        first = xp.isnan(last)
        passed, late, last = _clock(xp, longest, clock, last, times, given)
        given = with_reading(given, 1, seen)
        times = None if t is None else passed
        found: Any
        inner, found = self.inner.stream(times, given, inner)
        value, status = xp.asarray(found.value), xp.asarray(found.status)
        ways: Any = [self.inner.stream(times, given, other) for other in others]
        apart = xp.zeros_like(reading)
        for _, way in ways:
            apart = xp.maximum(apart, xp.abs(xp.asarray(way.value) - value))
        unknown = late | (seen != reading)
        if (conditioned := conditioned_in(self.inner)) is not None:
            unknown |= beyond_knots(conditioned, given)
        told = each(
            self._numbers, "limited", value, status, unknown, apart, reading,
            where=xp.where(status == Status.INVALID, xp.nan, reading), state=limited,
            held=xp.where(first, self._limited(xp, value), before), keeps=("beyond",),
        )  # fmt: skip
        if xp is np:
            value = told.value
        else:  # What is not held at an end is the inner estimate, with its derivatives.
            value = jnp.where(told.value == value, value, jax.lax.stop_gradient(told.value))
        if self.beyond == "nan":
            value = xp.where(told.said[:, 0] > 0, xp.nan, value)
        if len(value):
            clock, before = passed[-1], value[-1]
        own = map(as_array, (last, clock, told.state, before))
        after = GuardedState(inner, tuple(state for state, _ in ways), *own)
        found = found._replace(value=as_array(value), status=as_array(told.status))
        if (draws := getattr(found, "draws", None)) is not None:
            found = found._replace(draws=as_array(self._limited(xp, xp.asarray(draws))))
        return after, found

    @once
    def _numbers(self) -> Numbers:
        return numbers_of(self.law())

    def law(self, rounding: float = 0.0) -> Tree:
        """See `hysteresis/laws/guard.py`. `rounding`: of estimates, beyond which slack is no less."""
        least, most = self.seen or (1.0, 0.0)  # no reading is between
        parameters = {
            "low": self.low, "high": self.high, "slack": jnp.maximum(self.slack, rounding),
            "holds": self.beyond == "limit", "decides": True, "least": least, "most": most,
            "within": self.within,
        }  # fmt: skip
        return node("guard", parameters, BEGUN)

    def _limited(self, xp: Any, value: Any) -> Any:
        low, high, slack = map(xp.asarray, (self.low, self.high, self.slack))
        if self.beyond == "free":
            return value
        if self.beyond == "limit":
            return xp.clip(value, low, high)
        return xp.where((value < low - slack) | (value > high + slack), xp.nan, value)


def _clock(xp: Any, longest: Any, begin: Any, last: Any, t: Any, y: Any) -> tuple[Any, Any, Any]:
    """The inner clock, which begins with the first reading and in which no step is longer than `longest`;
    which samples come after a longer one; the time of the last reading."""
    valid = xp.isfinite(y) if y.ndim == 1 else xp.isfinite(y).all(axis=-1)
    at = xp.concatenate([xp.full(1, -1), latest_of(valid)])
    times = xp.concatenate([t, last[None]])  # the last one is that at -1
    wait = t - times[at[:-1]]
    passed = xp.where(valid & (wait > 0), wait, 0.0)
    return begin + xp.cumsum(xp.minimum(passed, longest)), passed >= longest, times[at[-1]]


# The state of a compensator from rows of which both input and output are known.


def warmed(
    compensator: AbstractCompensator, t: ArrayLike | None, u: ArrayLike, y: ArrayLike
) -> Any:
    """The state after known rows: it has read what the model gives along the likeliest history."""
    model = first_draw(_model_in(compensator))
    if t is None:
        model.prepare(None, jnp.asarray(u))  # raises where the rate matters
    past, outputs = known_past(model, t, u, y), outputs_of(model)
    count, rows = past.inputs.shape[:2]
    flat = past.inputs.reshape(count * rows, *past.inputs.shape[2:])
    times = None if past.times is None else past.times.ravel()
    starts = tuple(range(0, count * rows, rows))
    read = np.asarray(outputs(times, flat, starts)).reshape(count, rows)
    if flat.ndim == 2:
        read = np.stack([read, past.inputs[..., 1]], -1)
    each = [None] * count if past.times is None else list(past.times)
    state = compensator.stream(each[0], read[0], compensator.init())[0]
    if (guard := guard_in(compensator)) is None:
        return state
    # Others in the place of its starts: those that the way to both ends tells apart most.
    first = None if past.times is None else past.times[0]
    own = past.inputs[0] if flat.ndim == 2 else past.inputs[0, :, None]
    clock, way = then(*then(first, own[:, 0], float(guard.low)), float(guard.high))
    later = None if clock is None else clock[rows:]
    y = np.asarray(outputs(*past.followed_by(later, driven(model, way[rows:])))).reshape(count, -1)
    apart = np.abs(y[1:, rows:] - y[0, rows:]).max(1)
    farthest = 1 + np.argsort(-apart)[: len(guard.starts)]
    inner, uncounted = guard.inner, guard.init().limited  # what was counted is of other starts

    def compared(state: Any) -> Any:
        if not isinstance(state, GuardedState):
            return state._replace(inner=compared(state.inner))
        others = []
        for k in farthest:  # on the guard's own clock
            own = None if first is None else each[k] - each[k][-1] + float(state.clock)
            others.append(inner.stream(own, read[k], inner.init())[0])
        return state._replace(others=tuple(others), limited=uncounted)

    return compared(state)


def _model_in(compensator: AbstractCompensator) -> AbstractModel:
    for one in nested(compensator):
        if isinstance(model := getattr(one, "model", None), AbstractModel):
            return model
    raise InputError("not-a-model", "a compensator without a model has no state to tell.")
