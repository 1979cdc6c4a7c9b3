"""Contact position on a soft sensor of many channels, as a smooth function of the readings."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from hysteresis import InputError, register
from hysteresis.numerics._functions import Kernel

from ._localizer import PlaceStatus


class Position(NamedTuple):
    """Of readings (..., channels): where, how sure, and a `PlaceStatus`.

    `deviation` is that of each coordinate: of noise, and of how far the pattern is from those learnt.
    """

    point: Float[Array, "*readings coordinates"]
    deviation: Float[Array, "*readings"]
    status: Int[Array, "*readings"]


def pattern(readings: Float[Array, "*readings channels"]) -> Float[Array, "*readings features"]:
    """What tells the place from the force: readings w as w / |w|, and log |w| beside it.

    Gradients are finite where nothing is read.
    """
    square = jnp.sum(readings**2, axis=-1, keepdims=True)
    size = jnp.sqrt(jnp.where(square > 0, square, 1))
    return jnp.concatenate([readings / size, jnp.log(size)], axis=-1)


@register
class PositionEstimator(eqx.Module):
    """The mean and deviation of a Gaussian process of the `pattern` x, given presses at known places:

        P = mean + k(x, X) K^-1 (P_X - mean),     variance = size^2 + noise^2 - k(x, X) K^-1 k(X, x)

    with the `Kernel` k of features divided by `scale`, and K = k(X, X) + noise^2. Between places that
    were pressed it interpolates; far from all, the deviation grows to that of a sensor that says nothing,
    and the status is UNKNOWN.

    **Arguments:**

    - `readings` (rows, channels), `places` (rows, coordinates): presses to learn from.
    - `kernel`: k and noise, of channels + 1 features, as `hysid.fit_positions` finds for
      `standardised(readings)`.
    - `least`: |w| below which nothing is pressed. `surest`: the status is UNKNOWN where the deviation is
      more than this part of `size`.

    Raises `InputError` for readings and places of unlike rows, or not finite.

    Source: Rasmussen and Williams, Gaussian processes for machine learning (2006), algorithm 2.1.
    """

    centre: Float[Array, " features"]
    scale: Float[Array, " features"]
    mean: Float[Array, " coordinates"]
    known: Float[Array, "rows features"]
    weights: Float[Array, "rows coordinates"]
    precision: Float[Array, "rows rows"]
    kernel: Kernel
    least: Float[Array, ""]
    surest: Float[Array, ""]

    def __init__(
        self, readings: ArrayLike, places: ArrayLike, kernel: Kernel, *,
        least: float = 0.0, surest: float = 0.5,
    ):  # fmt: skip
        readings, places = np.asarray(readings, float), np.asarray(places, float)
        if len(readings) != len(places) or not len(places):
            raise InputError(
                "length-mismatch",
                f"{len(readings)} readings and {len(places)} places.", fix="one place a reading.",
            )  # fmt: skip
        if not (np.isfinite(readings).all() and np.isfinite(places).all()):
            raise InputError("not-finite", "a reading or place is no number.", fix="leave it out.")
        self.known, self.centre, self.scale = standardised(readings)
        self.mean = jnp.asarray(places.mean(0))
        self.kernel = kernel
        self.least, self.surest = jnp.asarray(least, float), jnp.asarray(surest, float)
        factor = jax.scipy.linalg.cho_factor(kernel.among(self.known), lower=True)
        self.weights = jax.scipy.linalg.cho_solve(factor, places - self.mean[None])
        self.precision = jax.scipy.linalg.cho_solve(factor, jnp.eye(len(places)))

    def estimate(self, readings: ArrayLike) -> Position:
        """The positions behind readings (..., channels); one that is no number is INVALID, at the mean."""
        # Numbers of Python's would be constants of the program: others compile another one.
        return self._estimated(jnp.asarray(readings, self.mean.dtype))

    @eqx.filter_jit
    def _estimated(self, readings: Array) -> Position:
        leading = readings.shape[:-1]
        flat = readings.reshape(-1, readings.shape[-1])
        finite = jnp.isfinite(flat).all(-1)
        flat = jnp.where(finite[:, None], flat, 0)
        x = (pattern(flat) - self.centre[None]) / self.scale[None]
        near = self.kernel.between(x, self.known)
        told = jnp.sum(near * (near @ self.precision), axis=1)
        deviation = jnp.sqrt(jnp.maximum(self.kernel.size**2 - told, 0) + self.kernel.noise**2)
        pressed = jnp.sqrt(jnp.sum(flat**2, axis=1)) > self.least
        codes = (PlaceStatus.INVALID, PlaceStatus.NO_PRESS, PlaceStatus.UNKNOWN)
        unsure = deviation > self.surest * self.kernel.size
        status = jnp.select([~finite, ~pressed, unsure], list(map(int, codes)), int(PlaceStatus.OK))
        point = jnp.where(finite[:, None], self.mean[None] + near @ self.weights, self.mean[None])
        return Position(
            point.reshape(*leading, -1), deviation.reshape(leading), status.reshape(leading)
        )


def standardised(
    readings: ArrayLike,
) -> tuple[Float[Array, "rows features"], Float[Array, " features"], Float[Array, " features"]]:
    """Standardised patterns of readings (rows, channels): less their mean, divided by their deviation.

    **Returns:** the standardised patterns, the mean and the deviation.
    """
    x = pattern(jnp.asarray(readings, float))
    centre, scale = x.mean(0), x.std(0)
    scale = jnp.where(scale > 0, scale, 1)
    return (x - centre[None]) / scale[None], centre, scale
