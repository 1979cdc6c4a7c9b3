"""Several input channels: a map of them to one scalar, each with a memory of its own where it has one."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._parameter import Scalar, as_float, check_increasing, check_shapes
from .._registry import register
from ..numerics._recurrence import slow_states, stops

Channels = Float[Array, "samples channels"] | Any
Column = Float[np.ndarray, " samples"]


@register
class ChannelMap(eqx.Module):
    """Several channels x_1 ... x_C combined into one scalar, each through a curve of its own:

        s = offset + f_1(x_1) + ... + f_C(x_C)

    f_c is a polygon: straight between its nodes, and constant beyond the first and the last, because
    nothing is known there. With `memory` each channel v_c, in parts of its fitted range, also
    adds what it leaves behind:

        s = ... + sum_c (sum_j m_cj stop_j(v_c) + sum_k m_ck (v_c - average_k(v_c)))

    with stop operators of some `radii` and exponential averages over some `times`, which begin with the
    first row. These go on with the channel beyond its fitted range.

    The scalar has the unit of the output. Each curve converts its channel's unit to that unit, so channels
    may have different units.

    A curve may rise or fall. A sensor's channels also respond to other quantities than the wanted one
    (a loop, a sideways pull, warmth); those responses cancel where some curves fall. The next stage
    rises: in every model that is fitted to the scalar, the output rises with it.

    **Arguments:**

    - `nodes`: (channels, n + 1) values of each channel, increasing.
    - `values`: (channels, n + 1) of each curve at its nodes, in the unit of the output.
    - `offset`: in the unit of the output.
    - `names`, `units`: of the channels.
    - `trained`: the least and the greatest scalar of the rows that it was fitted to; None if unknown.
    - `radii`: of the stop operators, in parts of the range of the nodes. `times`: of the averages.
    - `memory`: (channels, radii + times) their weights, in the unit of the output.

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
    radii: tuple[float, ...] = eqx.field(default=(), static=True)
    times: tuple[float, ...] = eqx.field(default=(), static=True)
    memory: Float[Array, "channels memories"] | None = eqx.field(default=None, converter=as_float)

    def __check_init__(self) -> None:
        count, memories = len(self.names), len(self.radii) + len(self.times)
        memory = np.zeros((count, 0)) if self.memory is None else self.memory
        check_shapes(
            0, False, names=(self.names, "channels"), units=(self.units, "channels"),
            nodes=(self.nodes, "channels nodes"), values=(self.values, "channels nodes"),
            memory=(memory, f"{count} {memories}"),
        )  # fmt: skip
        check_shapes(2, nodes=(self.nodes[0], "nodes"))
        if min((*self.radii, *self.times), default=1.0) <= 0:
            said = f"radii = {self.radii}, times = {self.times}."
            raise InputError("parameter-out-of-bounds", said, fix="keep them above 0.")
        check_increasing("nodes", self.nodes)

    def __call__(self, x: Channels, time: Column | None = None) -> Float[Array, " samples"]:
        """The scalar at every sample of one sequence; `time` is needed where there are `times`.

        Raises `InputError` `no-time` where they are and it is not given.
        """
        return self.curves(x) if self.memory is None else self.curves(x) + self.left(x, time)

    def curves(self, x: Channels) -> Float[Array, " samples"]:
        """The offset and the curves' part of the scalar; a function of JAX."""
        each = jax.vmap(jnp.interp, in_axes=(1, 0, 0))
        return self.offset + each(jnp.asarray(x, float), self.nodes, self.values).sum(0)

    def left(self, x: Channels, time: Column | None) -> Column:
        """What the channels of one sequence leave behind, in NumPy: no part of a JAX program."""
        found = np.zeros(len(x))
        for v, weights in zip(self.parts_of_range(x).T, np.asarray(self.memory), strict=True):
            found += memory_columns(v, time, self.radii, self.times) @ weights
        return found

    def parts_of_range(self, x: Channels) -> np.ndarray:
        """The channels in parts of the range of their nodes."""
        low, high = np.asarray(self.nodes)[:, 0], np.asarray(self.nodes)[:, -1]
        return (np.asarray(x) - low) / (high - low)


def memory_columns(
    v: Column, time: Column | None, radii: tuple[float, ...], times: tuple[float, ...]
) -> Float[np.ndarray, "samples memories"]:
    """What one sequence of a channel leaves behind: its stops, then its slow states."""
    found = [stops(v, np.array(radii))] if radii else []
    if times:
        if time is None:
            raise InputError(
                "no-time", "The channels have a memory of times.", fix="give the time (--time)."
            )
        found.append(slow_states(v, time, np.array(times)))
    return np.hstack(found)
