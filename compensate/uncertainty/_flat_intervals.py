"""How wide the flat places are: all inputs that a reading of a flat model can have come from."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel

from ..inverses._looks import looks_of


class FlatInterval(NamedTuple):
    """Inputs from `low` to `high` give the output that the estimate gives; `width` is their distance."""

    low: Float[Array, " samples"]
    high: Float[Array, " samples"]

    @property
    def width(self) -> Array:
        return self.high - self.low


def flat_intervals(
    model: AbstractModel,
    t: ArrayLike | None,
    estimate: ArrayLike,
    low: float,
    high: float,
    where: ArrayLike | None = None,
    tolerance: float = 1e-12,
) -> FlatInterval:
    """For each estimate u_k the inputs v within [`low`, `high`] with

        |h(v) - h(u_k)| <= tolerance (h(high) - h(low)),

    h being the model's next output after the estimates before it. The model rises with v, or falls with it
    everywhere, so that they are an interval: what a status FLAT leaves open, to be taken as
    the uncertainty of the nearest input, which is held.

    **Arguments:**

    - `t`, `estimate`: (samples,), as given to and found by `simulate`; `t` may be None without rates. Of a
      model that depends on a condition, estimate and condition, (samples, 2).
    - `where`: (samples,) bool, which estimates to look at, such as `status == Status.FLAT`; all by default.
      The interval of the others is the estimate itself.

    **Example:**

        >>> wide = compensate.flat_intervals(model, t, u, low=-10.0, high=10.0).width
        >>> bool((wide < 1e-6).all())
        True
    """
    driven = np.asarray(estimate, float)
    u = driven if driven.ndim == 1 else driven[:, 0]
    looked = np.ones(len(u), bool) if where is None else np.asarray(where, bool)
    look = looks_of(model, t, driven)

    def outputs(levels: np.ndarray) -> np.ndarray:
        return look(np.where(looked[:, None], levels, np.nan))

    below, above = (np.tile([end, end], (len(u), 1)) for end in (low, high))
    least, greatest, y = outputs(np.stack([below[:, 0], above[:, 0], u], 1)).T
    # Of a model that falls, what is mirrored rises.
    way = np.where(greatest < least, -1.0, 1.0)
    margin = tolerance * np.abs(greatest - least)
    wanted = np.stack([way * y - margin, way * y + margin], 1)
    for _ in range(np.finfo(float).nmant + 2):
        middle = below + (above - below) / 2
        short = way[:, None] * outputs(middle) < wanted
        below, above = np.where(short, middle, below), np.where(short, above, middle)
    first, last = np.minimum(above[:, 0], u), np.maximum(np.maximum(above[:, 0], below[:, 1]), u)
    return FlatInterval(*(jnp.asarray(np.where(looked, end, u)) for end in (first, last)))
