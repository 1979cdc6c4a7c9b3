"""The force of one contact from one hysteretic reading."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, Units, conversion, is_concrete, register
from hysteresis._type_variables import PyTree

from .._contract import AbstractCompensator, Status, scan_steps
from ..uncertainty._ensemble import UncertainEstimate

Limit = float | tuple[float, ...]
"""Of the reading, or of each channel's."""


def _limit(value: Any) -> Limit:
    return tuple(map(float, value)) if np.ndim(value) else float(value)


class BackwardsInput(NamedTuple):
    """Times and readings, the state they begin in, and where sequences start."""

    t: Array
    u: Array
    state: Any
    start: Array


@register
class BackwardsModel(AbstractModel[Any, BackwardsInput]):
    """A compensator as a model from reading to force, without its status: y = compensator[u].value.

    **Arguments:** `compensator`, e.g. from `invert`.

    **Example:**

        >>> backwards = compensate.microchannel.BackwardsModel(compensator)
        >>> backwards.simulate(t, model.simulate(t, u)).round(6).tolist() == u.tolist()
        True
    """

    compensator: AbstractCompensator

    def init(self, t0: ArrayLike | None = None, u0: ArrayLike | None = None) -> PyTree:
        return self.compensator.init()

    def step(
        self, state: PyTree, t: ArrayLike | None, u: ArrayLike
    ) -> tuple[PyTree, Float[Array, ""]]:
        state, found = self.compensator.step(state, t, u)
        return state, found.value

    def prepare(
        self,
        t: ArrayLike | None,
        u: ArrayLike,
        state: PyTree = None,
        *,
        starts: tuple[int, ...] = (0,),
    ) -> BackwardsInput:
        u = jnp.asarray(u, float)
        t = jnp.zeros_like(u) if t is None else jnp.asarray(t, u.dtype)
        start = jnp.zeros(len(u), bool).at[jnp.array(starts)].set(True)
        return BackwardsInput(t, u, self.init() if state is None else state, start)

    def evaluate(self, prepared: BackwardsInput) -> Float[Array, " samples"]:
        return _by_steps(self, prepared)


@eqx.filter_jit
def _by_steps(model: BackwardsModel, prepared: BackwardsInput) -> Array:
    def step(state: Any, row: tuple[Array, Array, Array]) -> tuple[Any, Array]:
        t, u, start = row
        begin = jax.tree.map(lambda first, now: jnp.where(start, first, now), prepared.state, state)
        return model.step(begin, t, u)

    rows = prepared.t, prepared.u, prepared.start
    return jax.lax.scan(step, prepared.state, rows)[1]


def _units(model: AbstractModel) -> Units | None:
    """From readings to forces, as a model or its compensator carries them."""
    inner = model.compensator if isinstance(model, BackwardsModel) else model
    return model.units or inner.units


class ForceState(NamedTuple):
    """The model's own state, and the last force."""

    model: Any
    value: Float[Array, ""]


@register
class ForceEstimator(AbstractCompensator[ForceState, UncertainEstimate]):
    """Force from readings, by a model that was trained in this direction.

        F = clip(M[z], 0, high),     deviation: its error on readings that were held out

    The model is the paper's network (`StaircaseNetwork`), a monotone Everett network (`EverettNetwork`), or
    any other. `invert` inverts a model that was fitted from force to reading, as the sensor works; where
    the noise of the reading is known, use a `MultiContactEstimator` of one contact instead.

    **Arguments:**

    - `model`: from a reading to a force, in N or in the unit that the model, or the compensator in a
      `BackwardsModel`, carries: it is converted. `deviation`: N. `high`: largest force of the training, N.
    - `low_reading`, `high_reading`: the range of the readings in the training, a number, or (channels,)
      where the model takes several. A sample with any other reading is EXTRAPOLATED, one without a reading
      INVALID.

    **Raises:** `InputError` for a deviation or range that is not positive, and `wrong-direction` or
    `wrong-unit` for a model whose output is not a force.

    **Source:** Kim and Park (2018), section III A.

    **Example:**

        >>> backwards = compensate.microchannel.BackwardsModel(compensator)
        >>> found = compensate.microchannel.ForceEstimator(backwards, deviation=0.05, high=5.0)
        >>> found.simulate(t, model.simulate(t, u)).value[4:8].round(6).tolist()
        [4.0, 5.0, 5.0, 5.0]
    """

    model: AbstractModel
    deviation: Float[Array, ""] = eqx.field(converter=lambda x: jnp.asarray(x, float))
    high: float = eqx.field(static=True, converter=float)
    low_reading: Limit = eqx.field(default=-jnp.inf, static=True, converter=_limit)
    high_reading: Limit = eqx.field(default=jnp.inf, static=True, converter=_limit)

    def __check_init__(self) -> None:
        deviation = float(self.deviation) if is_concrete(self.deviation) else 1.0
        low, high = np.asarray(self.low_reading), np.asarray(self.high_reading)
        ordered = low.shape == high.shape and bool((low < high).all())
        if not (0 < deviation < jnp.inf and self.high > 0 and ordered):
            raise InputError(
                "bad-option",
                f"deviation {deviation:g} N, forces to {self.high:g} N, readings from "
                f"{self.low_reading} to {self.high_reading}: none of them may be empty.",
            )

        units = _units(self.model)
        if units is not None and units.output != "1" and conversion(units.output, "N") is None:
            is_turned = conversion(units.input, "N") is not None
            raise InputError(
                "wrong-direction" if is_turned else "wrong-unit",
                f"this model leads from {units.input} to {units.output}, not to a force.",
                fix="ForceEstimator(BackwardsModel(invert(model)), ...) for a model of the reading.",
            )

    @property
    def newtons(self) -> float:
        """What one unit of the model's output is in N."""
        units = _units(self.model)
        return 1.0 if units is None else conversion(units.output, "N") or 1.0

    def init(self) -> ForceState:
        return ForceState(self.model.init(), jnp.zeros_like(self.deviation))

    def step(
        self, state: ForceState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[ForceState, UncertainEstimate]:
        y = jnp.asarray(y, self.deviation.dtype)
        t = jnp.asarray(0.0 if t is None else t, y.dtype)
        valid = jnp.isfinite(y).all() & jnp.isfinite(t)
        model, found = self.model.step(state.model, t, y)
        found = self.newtons * found
        value = jnp.clip(found, 0.0, self.high)
        after = ForceState(model, value)
        after = jax.tree.map(lambda new, old: jnp.where(valid, new, old), after, state)
        low, high = (jnp.array(end, y.dtype) for end in (self.low_reading, self.high_reading))
        beyond = ((y < low) | (y > high)).any()
        status = jnp.where(found > self.high, Status.SATURATED, Status.OK)
        status = jnp.where(beyond, Status.EXTRAPOLATED, status)
        status = jnp.where(valid, status, Status.INVALID)
        return after, UncertainEstimate(after.value, status, self.deviation)

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: ForceState | None = None
    ) -> UncertainEstimate:
        """`step` over all samples; readings (samples,), of several channels (samples, channels)."""
        y = jnp.asarray(y, float)
        return scan_steps(self, t, y, self.init() if state is None else state)[1]
