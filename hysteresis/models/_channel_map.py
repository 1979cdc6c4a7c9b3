"""Several input channels: a static map of them to one scalar."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._parameter import Scalar, as_float, is_concrete
from .._registry import register


@register
class ChannelMap(eqx.Module):
    """Several channels x_1 ... x_C combined into one scalar, each through a curve of its own:

        s = offset + f_1(x_1) + ... + f_C(x_C)

    f_c is a polygon: straight between its nodes, and constant beyond the first and the last, because
    nothing is known there. The scalar has the unit of the output. Each curve converts its channel's
    unit to that unit, so channels may have different units.

    A curve may rise or fall. A sensor's channels also respond to other quantities than the wanted one
    (a loop, a sideways pull, warmth); those responses cancel where some curves fall. The next stage
    rises: in every model that is fitted to the scalar, the output rises with it.

    **Arguments:**

    - `nodes`: (channels, n + 1) values of each channel, increasing.
    - `values`: (channels, n + 1) of each curve at its nodes, in the unit of the output.
    - `offset`: in the unit of the output.
    - `names`, `units`: of the channels.
    - `trained`: the least and the greatest scalar of the rows that it was fitted to; None if unknown.

    Raises `InputError` where an argument does not meet these conditions.

    **Example:**

        >>> nodes, values = [[0.0, 1.0], [0.0, 2.0]], [[0.0, 10.0], [0.0, -4.0]]
        >>> left_right = hysteresis.ChannelMap(nodes, values, 0.0, ("left", "right"), ("V", "V"))
        >>> left_right([[0.5, 1.0], [1.0, 0.0]]).tolist()
        [3.0, 10.0]
    """

    nodes: Float[Array, "channels nodes"] = eqx.field(converter=as_float)
    values: Float[Array, "channels nodes"] = eqx.field(converter=as_float)
    offset: Scalar = eqx.field(converter=as_float)
    names: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    trained: tuple[float, float] | None = eqx.field(default=None, static=True)

    def __check_init__(self) -> None:
        shapes = self.nodes.shape, self.values.shape
        count = {len(self.names), len(self.units), *(shape[0] for shape in shapes)}
        if shapes[0] != shapes[1] or shapes[0][-1] < 2 or len(count) > 1:
            raise InputError(
                "length-mismatch",
                f"nodes {shapes[0]}, values {shapes[1]}, {len(self.names)} names,"
                f" {len(self.units)} units.",
                fix="give each channel a name, a unit and as many values as nodes, at least two.",
            )
        if is_concrete(self.nodes) and not np.all(np.diff(np.asarray(self.nodes)) > 0):
            raise InputError(
                "parameter-out-of-bounds", f"nodes = {self.nodes}.", fix="keep them increasing."
            )

    def __call__(self, x: Float[Array, "samples channels"] | Any) -> Float[Array, " samples"]:
        """The scalar at every sample."""
        each = jax.vmap(jnp.interp, in_axes=(1, 0, 0))
        return self.offset + each(jnp.asarray(x, float), self.nodes, self.values).sum(0)
