"""The moving Preisach model: the output adds to the input."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import AbstractModel, Series, Tree
from .._parameter import Scalar, is_concrete, parameter
from .._registry import register
from ..trees import node
from ._density import AbstractDensity, GridDensity
from ._everett import read, tabulate_once
from ._preisach import Preisach, _to_device
from ._saturation import saturated_outputs, whole_output
from ._sequences import hang, past_inputs
from ._stack import OpenLoops

_FAR = float(np.finfo(np.float32).max) / 4
"""An input beyond saturation whatever the parameters; its double is still a number in single precision."""


class MovingState(NamedTuple):
    """The staircase of dominant extrema of the applied input, which is clipped to saturation.

    - `loops`: the open loops; their levels are outputs.
    - `u`, `y`: input and output now; `rising`: +1 or -1, which way they moved last.
    """

    loops: OpenLoops
    u: Array
    y: Array
    rising: Array


class MovingInput(NamedTuple):
    """The memory tree of an input, see `MemoryTree`, and the inputs at its anchors and samples."""

    tree: Any
    u_node: Array
    u: Array


class _Branch(NamedTuple):
    """Where branches started: the inner input h and the relays' output there, and +1 or -1."""

    h: Array
    relays: Array
    s: Array


@register
class MovingPreisach(AbstractModel[MovingState, MovingInput]):
    """Della Torre's moving model: a Preisach model whose output is added to its input.

        y = P[h],     h = u + feedback y

    On a branch, h solves h - feedback P(h) = u. The left side must rise on every branch. Then h rises
    where u does, and loops close in h where they close in u, so the memory tree of u applies. Minor
    loops between the same limits of u differ in shape (between the same limits of h they are congruent).

    **Arguments:**

    - `inner`: P, whose density and reversible part are functions of h. It starts saturated.
    - `feedback`: below 1 / (the steepest slope of P); negative where the output opposes the input.

    Raises `InputError` where P does not start saturated, and, for a `GridDensity`, where the feedback is
    so strong that an input may have two outputs.

    Source: Della Torre 1966, Magnetic Hysteresis chapter 4.

    **Example:**

        >>> moving = hysteresis.MovingPreisach(preisach, feedback=0.05)
        >>> np.asarray(moving.simulate(None, np.array([0.0, 6.0, 2.0, 6.0]))).round(2).tolist()
        [-21.0, -6.17, -15.61, -6.17]
    """

    inner: Preisach
    feedback: Scalar = parameter(unit="input / output", meaning="input added by a unit of output")

    def __check_init__(self) -> None:
        saturated = self.inner.initial in ("negative", "positive") and self.inner.up is None
        if not saturated or self.inner.dead_band:
            raise InputError(
                "bad-state",
                "the inner model of a moving one starts saturated, and without a dead band.",
                cause="how far another state reaches in the applied input depends on the parameters.",
                fix='use initial="negative" or "positive", and apply the inputs that lead on from there.',
            )
        on_grid = isinstance(self.inner.density, GridDensity)
        if on_grid and all(is_concrete(value) for value in jax.tree.leaves(self)):
            slopes = self.steepest_slopes()
            if not bool((self.feedback * slopes < 1).all()):
                raise InputError(
                    "feedback-too-strong",
                    f"feedback = {self.feedback:.4g}: where the inner model is steepest an input has"
                    " more than one output.",
                    fix=f"keep feedback times the slopes {slopes[0]:.4g} and {slopes[1]:.4g} below 1.",
                )

    def steepest_slopes(self) -> Float[Array, "2"]:
        """The least and the greatest slope dP/dh, over every branch an input can reach."""
        greatest = -jax.tree.map(jnp.negative, self.inner).least_slope()
        return jnp.stack([self.inner.least_slope().min(), greatest.max()])

    # Streaming

    def init(self, t0: Any = None, u0: Any = None) -> MovingState:
        u, y = self.saturation()[0], saturated_outputs(self.inner)[0]
        loops = OpenLoops.none(self.inner.capacity, u, y)
        state = MovingState(loops, u, y, loops.depth)
        if self.inner.initial == "positive":
            state, _ = self.step(state, 0.0, _FAR)
        return state

    @eqx.filter_jit
    def step(self, state: MovingState, t: Any, u: Any) -> tuple[MovingState, Float[Array, ""]]:
        u = jnp.asarray(u, state.u.dtype)
        table = self.inner.density.tabulate()
        inside = self._clip(u)
        direction = jnp.where(inside > state.u, 1, jnp.where(inside < state.u, -1, state.rising))
        s = direction.astype(u.dtype)
        loops = state.loops.push(direction != state.rising, state.u, state.y)
        loops = loops.wipe_out(lambda extremum, level: s * inside >= s * extremum)
        u_r, y_r = loops.anchor
        # Rounding must not carry it out of the density.
        h_r = jnp.clip(u_r + self.feedback * y_r, self.inner.density.low, self.inner.density.high)
        relays_r = self.inner.orientation * (y_r - self._reversible(h_r))
        h, relays = self._solve(table, _Branch(h_r, relays_r, s), inside)
        y = whole_output(self.inner, relays, h)
        return MovingState(loops, inside, y, direction), y + self._beyond(u - inside)

    # Batch

    def prepare(
        self,
        t: Series | None,
        u: Series,
        state: MovingState | None = None,
        *,
        starts: tuple[int, ...] = (0,),
    ) -> MovingInput:
        past = self._past(state)
        concrete = is_concrete(u) and is_concrete(past)
        u = np.asarray(u, float) if concrete else jnp.asarray(u)
        hung = hang(past, u, starts)
        return jax.tree.map(_to_device, MovingInput(hung.tree, hung.at_node, u))

    def evaluate(self, prepared: MovingInput) -> Float[Array, " samples"]:
        (anchor, _, parent, rising, *_), u_node, u = prepared
        table = tabulate_once(self.inner.density, parent[0] == 0)
        sign = rising.astype(u.dtype)

        def solve_anchor(known: tuple[Array, Array], here: tuple[Array, ...]) -> Any:
            k, parent, sign, u = here
            branch = _Branch(read(known[0], parent), read(known[1], parent), sign)
            found = self._solve(table, branch, u)
            return tuple(part.at[k].set(x) for part, x in zip(known, found, strict=True)), None

        low = jnp.full_like(u_node, self.inner.density.low)
        down = jnp.broadcast_to(-self.inner.density.mass(table), low.shape)
        anchors = jnp.arange(len(u_node)), parent, read(sign, parent), self._clip(u_node)
        (h, relays), _ = jax.lax.scan(solve_anchor, (low, down), anchors)

        inside = self._clip(u)
        branch = _Branch(*(read(part, anchor) for part in (h, relays, sign)))
        h, relays = self._solve(table, branch, inside)
        return whole_output(self.inner, relays, h) + self._beyond(u - inside)

    def laws(self, eps: float, depth: int) -> Tree:
        floor, ceiling = saturated_outputs(self.inner)
        parameters = {"feedback": self.feedback, "floor": floor, "ceiling": ceiling}
        return node("moving", parameters, parts=[self.inner.tree(eps, depth)])

    # Parts

    def saturation(self) -> tuple[Array, Array]:
        """The inputs at which the last relay has switched: all down, and all up."""
        density = self.inner.density
        y_low, y_high = saturated_outputs(self.inner)
        return density.low - self.feedback * y_low, density.high - self.feedback * y_high

    def _past(self, state: MovingState | None) -> Any:
        """A path of inputs that leads from far below saturation to `state`."""
        if state is None:
            return np.array([-_FAR] if self.inner.initial == "negative" else [-_FAR, _FAR])
        path = past_inputs(state.loops, state.u)
        return (np if is_concrete(path) else jnp).append(-_FAR, path[1:])

    def _solve(self, table: Any, branch: _Branch, u: Array) -> tuple[Array, Array]:
        """h with h - feedback P(h) = u on its branch, and the relays' output there, by element.

        Bisection finds h to the last bit. The Newton step after it carries the derivatives.
        """
        density, parts = self.inner.density, (self, table, branch, u)
        frozen = jax.lax.stop_gradient(parts)
        begin, rises = frozen[2].h, branch.s > 0
        low = jnp.where(rises, begin, density.low)
        high = jnp.where(rises, density.high, begin)

        def halve(_: Any, interval: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = interval
            middle = (low + high) / 2
            below = _excess(frozen, middle) < 0
            return jnp.where(below, middle, low), jnp.where(below, high, middle)

        low, high = jax.lax.fori_loop(0, jnp.finfo(u.dtype).nmant + 2, halve, (low, high))
        near = (low + high) / 2
        slope = jax.jvp(lambda h: _excess(frozen, h), (near,), (jnp.ones_like(near),))[1]
        h = near - _excess(parts, near) / slope
        return h, _relays(density, table, branch, h)

    def _clip(self, u: Array) -> Array:
        """u, or the nearest input that saturates every relay."""
        return jnp.clip(u, *self.saturation())

    def _reversible(self, h: Array) -> Array:
        """P without its relays."""
        return whole_output(self.inner, jnp.zeros_like(h), h)

    def _beyond(self, excess: Array) -> Array:
        """What inputs add to y that lie by `excess` beyond saturation: R alone goes on there."""
        density = self.inner.density
        bounds = jnp.array([density.low, density.high])
        step = jnp.array([-1.0, 1.0]) * (density.high - density.low)
        rise = self._reversible(bounds + step) - self._reversible(bounds)
        slope = rise / step
        slope /= 1 - self.feedback * slope
        return excess * jnp.where(excess < 0, slope[0], slope[1])


def _relays(density: AbstractDensity, table: Any, branch: _Branch, h: Array) -> Array:
    return branch.relays + 2 * branch.s * density.everett(table, density.pair(branch.h, h))


def _excess(parts: tuple[MovingPreisach, Any, _Branch, Array], h: Array) -> Array:
    """h - feedback P(h) - u, which rises with h."""
    model, table, branch, u = parts
    y = whole_output(model.inner, _relays(model.inner.density, table, branch, h), h)
    return h - model.feedback * y - u
