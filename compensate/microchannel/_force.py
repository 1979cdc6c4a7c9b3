"""The force of one contact from one hysteretic reading."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, register
from hysteresis._model import AbstractFollowingModel
from hysteresis._parameter import PyTree, array_module, as_array, is_concrete
from hysteresis._quantities import Units, conversion

from .._contract import AbstractCompensator, Status
from .._readings import latest_of
from ..inverses._law import UncertainEstimate

Limit = float | tuple[float, ...]
"""Of the reading, or of each channel's."""


def _limit(value: Any) -> Limit:
    return tuple(map(float, value)) if np.ndim(value) else float(value)


class BackwardsInput(eqx.Module):
    """Times and readings, the state they begin in, and where sequences start."""

    t: Array | None
    u: Array
    state: Any
    starts: tuple[int, ...] = eqx.field(static=True)


@register
class BackwardsModel(AbstractFollowingModel[Any, BackwardsInput]):
    """A compensator as a model from reading to force, without its status: y = compensator[u].value.

    **Arguments:** `compensator`, e.g. from `invert`.

    **Example:**

        >>> backwards = compensate.internal.BackwardsModel(compensator)
        >>> backwards.simulate(t, model.simulate(t, u)).round(6).tolist() == u.tolist()
        True
    """

    compensator: AbstractCompensator
    traced = False

    def init(self, t0: ArrayLike | None = None, u0: ArrayLike | None = None) -> PyTree:
        return self.compensator.init()

    def prepare(
        self,
        t: ArrayLike | None,
        u: ArrayLike,
        state: PyTree = None,
        *,
        starts: tuple[int, ...] = (0,),
    ) -> BackwardsInput:
        t, u = None if t is None else jnp.asarray(t, float), jnp.asarray(u, float)
        return BackwardsInput(t, u, self.init() if state is None else state, tuple(starts))

    def evaluate(self, prepared: BackwardsInput) -> Float[Array, " samples"]:
        t, u, ends = prepared.t, prepared.u, (*prepared.starts[1:], len(prepared.u))
        rows = [slice(*ends) for ends in zip(prepared.starts, ends, strict=True)]
        runs = [self.follow(None if t is None else t[k], u[k], prepared.state)[1] for k in rows]
        return jnp.concatenate(runs)

    def follow(
        self, t: ArrayLike | None, u: ArrayLike, state: PyTree = None
    ) -> tuple[PyTree, Float[Array, " samples"]]:
        own = self.init() if state is None else state
        after, found = self.compensator.stream(t, u, own)
        return after, found.value


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

    The model is the paper's network (`StaircaseNetwork`), or any other. `invert` inverts a model that was
    fitted from force to reading, as the sensor works; where the noise of the reading is known, use a
    `MultiContactEstimator` of one contact instead.

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

        >>> backwards = compensate.internal.BackwardsModel(compensator)
        >>> found = compensate.internal.ForceEstimator(backwards, deviation=0.05, high=5.0)
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

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: ForceState
    ) -> tuple[ForceState, UncertainEstimate]:
        """Of readings (samples,), of several channels (samples, channels)."""
        # Outside of JAX's programs it is NumPy's, which compiles nothing for a length.
        xp = array_module(t, y, *jax.tree.leaves((state, self)))
        given: Any = xp.asarray(y, self.deviation.dtype)
        found: Any = xp.zeros(given.shape[:1], given.dtype)
        times: Any = found if t is None else xp.asarray(t, given.dtype)
        channels = given[:, None] if given.ndim == 1 else given
        valid = xp.isfinite(channels).all(1) & xp.isfinite(times)
        latest, model = latest_of(valid), state.model
        # Rows that are none are left out, or in JAX's programs those before them again after no time.
        known = is_concrete(valid)
        rows = np.flatnonzero(valid) if known else jnp.maximum(latest, valid.argmax())
        if len(rows):
            after, moved = self.model.stream(times[rows], given[rows], model)
            model = jax.tree.map(lambda new, old: jnp.where(valid.any(), new, old), after, model)
            found = xp.asarray(moved)[xp.searchsorted(rows, latest)] if known else moved
        found = self.newtons * found
        value = xp.where(latest < 0, state.value, xp.clip(found, 0.0, self.high)[latest])
        low, high = (xp.atleast_1d(np.asarray(x)) for x in (self.low_reading, self.high_reading))
        beyond = ((channels < low[None]) | (channels > high[None])).any(1)
        status = xp.where(found > self.high, Status.SATURATED, Status.OK)
        status = xp.where(beyond, Status.EXTRAPOLATED, status)
        status = xp.where(valid, status, Status.INVALID)
        after = ForceState(model, as_array(value[-1]) if len(value) else state.value)
        deviation = xp.broadcast_to(xp.asarray(self.deviation), value.shape)
        return after, UncertainEstimate(*map(as_array, (value, status, deviation)))
