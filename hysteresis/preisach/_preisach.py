"""The Preisach model: a density of relays, and the memory tree of the input."""

from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import AbstractModel, Series
from .._parameter import Scalar, is_concrete, parameter
from ._density import AbstractDensity, GridDensity
from ._everett import materialise, read
from ._memory import MemoryTree, memory_tree
from ._stack import OpenLoops

Initial = Literal["negative", "positive", "demagnetised"]


class PreisachState(NamedTuple):
    """The staircase of dominant extrema and where the input stands on it.

    - `loops`: the open loops; their levels are outputs of the relays alone.
    - `u`, `y`: input and relays' output now.
    - `rising`: +1 or -1, which way the input moved last.
    """

    loops: OpenLoops
    u: Array
    y: Array
    rising: Array


class PreisachInput(NamedTuple):
    """The memory tree of an input with its pairs located on the density; see `MemoryTree`."""

    tree: MemoryTree
    sample: Any
    sign: Any
    node: Any
    node_sign: Any
    cell: Array | None
    within: Array | None


class Preisach(AbstractModel[PreisachState, PreisachInput]):
    """Preisach model: relays of every pair of thresholds, weighted by a density.

        y = offset + R(u) + P[u],      P[u](t) = double integral of mu(alpha, beta) relay_ab[u](t)

    Relays are -1 or +1, so P = -mass in negative saturation. On a monotone branch that started at the
    reversal u_r, P(u) = P(u_r) + 2 s E(u, u_r), with the Everett function E of the density and s = +1
    rising, -1 falling; passing an older extremum wipes the loop inside out. The output is
    independent of the rate and of how finely the path was sampled. Beyond [low, high] every relay is
    saturated and only R goes on.

    **Arguments:**

    - `density`: where the relays are, e.g. `GridDensity`.
    - `reversible`: (n,) increments of R over n equal cells of [low, high], none negative; R(low) = 0.
      R is the model's memoryless part, piecewise linear. None for no such part.
    - `offset`: the output's constant.

    **Other arguments:**

    - `leading`: y = offset + R(u) - P[u], for loops traversed clockwise, whose output leads the input
      (displacement -> force). R has to be steep enough for y to rise with u; see `slopes`.
    - `initial`: relays before the first sample: all down (`"negative"`), all up (`"positive"`), or
      down above and up below the anti-diagonal (`"demagnetised"`).
    - `capacity`: reversals a streaming state can hold; beyond it the smallest loop is forgotten.

    Raises `InputError` for a reversible part that does not fit the density or decreases.

    Source: Mayergoyz, Mathematical Models of Hysteresis; Kim 2018, equation (1).
    """

    density: AbstractDensity
    reversible: Float[Array, " cells"] | np.ndarray | None = parameter(
        None, unit="output", bounds=(0.0, float("inf")), meaning="increments of the memoryless part"
    )
    offset: Scalar = parameter(0.0, unit="output", meaning="constant of the output")
    leading: bool = eqx.field(default=False, static=True)
    initial: Initial = eqx.field(default="negative", static=True)
    capacity: int = eqx.field(default=128, static=True)

    def __check_init__(self) -> None:
        if self.reversible is None or not is_concrete(self.reversible):
            return
        if isinstance(self.density, GridDensity) and len(self.reversible) != self.density.cells:
            raise InputError(
                "reversible-length",
                f"{len(self.reversible)} increments for {self.density.cells} cells.",
                fix="give the reversible part one increment per cell of the grid.",
            )
        if not bool((self.reversible >= 0).all()):
            raise InputError("reversible-decreases", "the reversible part has negative increments.")

    # Streaming

    def init(self, t0: Any = None, u0: Any = None) -> PreisachState:
        table = self.density.tabulate()
        low, down = jnp.asarray(self.density.low, float), -self.density.mass(table)
        loops = OpenLoops.none(self.capacity, low, down)
        state = PreisachState(loops, low, down, loops.depth)
        return _settle(self, state, jnp.asarray(self._staircase(), float))

    @eqx.filter_jit
    def step(self, state: PreisachState, t: Any, u: Any) -> tuple[PreisachState, Float[Array, ""]]:
        u = jnp.asarray(u, state.u.dtype)
        state, relays = self._step_relays(self.density.tabulate(), state, u)
        return state, self._output(relays, *self._place(u))

    def _step_relays(
        self, table: Any, state: PreisachState, u: Array
    ) -> tuple[PreisachState, Array]:
        loops, u_before, y_before, rising = state
        u = jnp.clip(u, self.density.low, self.density.high)
        direction = jnp.where(u > u_before, 1, jnp.where(u < u_before, -1, rising))
        s = direction.astype(u.dtype)
        loops = loops.push(direction != rising, u_before, y_before)
        loops = loops.wipe_out(lambda extremum, level: s * u >= s * extremum)
        reversal, level = loops.anchor
        y = level + 2 * s * self.density.everett(table, self.density.pair(u, reversal))
        return PreisachState(loops, u, y, direction), y

    # Batch

    def prepare(
        self,
        t: Series | None,
        u: Series,
        state: PreisachState | None = None,
        *,
        starts: tuple[int, ...] = (0,),
    ) -> PreisachInput:
        past = self._past(state)
        concrete = is_concrete(u) and is_concrete(past)
        u = np.asarray(u, float) if concrete else jnp.asarray(u)
        xp = np if concrete else jnp
        clipped = xp.clip(u, self.density.low, self.density.high)
        ends = (*starts[1:], len(u))
        pieces = [
            piece for a, b in zip(starts, ends, strict=True) for piece in (past, clipped[a:b])
        ]
        path: Any = xp.concatenate(pieces)
        kept = np.arange(len(u)) + np.repeat(
            np.arange(1, len(starts) + 1) * len(past), np.diff([*starts, len(u)])
        )
        tree = memory_tree(path) if concrete else _traced_tree(path)

        anchor = tree.anchor[kept]
        at_node = path[tree.node]
        sample = self.density.pair(clipped, at_node[anchor])
        node = self.density.pair(at_node, at_node[tree.parent])
        prepared = PreisachInput(
            tree._replace(anchor=anchor), sample, 2.0 * tree.rising[anchor].astype(float),
            node, 2.0 * tree.rising[tree.parent].astype(float), *self._place(u),
        )  # fmt: skip
        return jax.tree.map(_to_device, prepared)

    def evaluate(self, prepared: PreisachInput) -> Float[Array, " samples"]:
        tree = prepared.tree
        true = tree.parent[0] == 0
        table = materialise(self.density.tabulate(), true)
        rise = prepared.node_sign * self.density.everett(table, prepared.node)
        rise = jnp.append(rise, 0.0)
        event = read(rise, tree.pushed) - read(rise, tree.popped) - read(rise, tree.popped_too)
        level = read(jnp.cumsum(event), tree.position) - self.density.mass(table)
        level = materialise(level, true)
        relays = read(level, tree.anchor)
        relays += prepared.sign * self.density.everett(table, prepared.sample)
        return self._output(relays, prepared.cell, prepared.within)

    # Parts

    def least_slope(self) -> Float[Array, " cells"]:
        """The least dy/du over each cell of a grid, over every branch an input can reach.

        On a rising branch from r, dy/du in row k is R'_k + 2 s_o (sum of w_kj over the columns from r
        up to the diagonal, whose half cell enters with 0 to 2 times its mass), s_o = +1 lagging, -1
        leading; on a falling branch the same with columns for rows. Negative where the model
        does not rise with its input and cannot be inverted.
        """
        assert isinstance(self.density, GridDensity)
        w = jnp.tril(self.density.weights)
        half = jnp.diagonal(w)
        beside = w - jnp.diag(half)
        swept = jnp.stack([beside[:, ::-1].cumsum(1), beside.T.cumsum(1)])
        swept = jnp.concatenate([jnp.zeros_like(swept[..., :1]), swept], -1)
        swept = jnp.concatenate([swept, swept + 2 * half[None, :, None]], -1)
        least = (2 * self.orientation * swept).min((0, 2))
        reversible = 0.0 if self.reversible is None else self.reversible
        return (least + reversible) * (self.density.cells / (self.density.high - self.density.low))

    @property
    def orientation(self) -> int:
        """+1 where the loops lag the input (counter-clockwise), -1 where they lead it."""
        return -1 if self.leading else 1

    def _past(self, state: PreisachState | None) -> Any:
        """A path of inputs that leads from the negative saturation to `state`."""
        if state is None:
            return np.array([self.density.low, *self._staircase()])
        extremum, depth = state.loops.extremum, state.loops.depth
        if is_concrete(state.u):
            return np.append(np.asarray(extremum)[: int(depth)], float(state.u))
        # A traced depth: fill up with the present input, since a plateau adds no memory.
        open_loops = jnp.arange(self.capacity, dtype=jnp.int32) < depth
        return jnp.append(jnp.where(open_loops, extremum, state.u), state.u)

    def _staircase(self) -> list[float]:
        """Inputs that bring the relays from negative saturation to the initial state."""
        low, high = self.density.low, self.density.high
        if self.initial == "negative":
            return []
        if self.initial == "positive":
            return [high]
        # An alternation that decays by the same step each time, as a laboratory demagnetises.
        turns = self.capacity // 2
        amplitude = (high - low) / 2 * (1 - np.arange(turns) / turns)
        return ((low + high) / 2 + amplitude * (-1.0) ** np.arange(turns)).tolist()

    def _place(self, u: Any) -> tuple[Any, Any]:
        """Cell of the reversible part and position in it, below 0 or above 1 beyond the range."""
        if self.reversible is None:
            return None, None
        n = self.reversible.shape[-1]
        position = (u - self.density.low) * (n / (self.density.high - self.density.low))
        xp = jnp if isinstance(u, jax.Array) else np
        cell = xp.clip(xp.floor(position), 0, n - 1)
        return cell.astype(np.int32), position - cell

    def _output(self, relays: Array, cell: Any, within: Any) -> Array:
        """y from the relays' part and the place on the reversible part."""
        y = self.offset + self.orientation * relays
        if self.reversible is None:
            return y
        increment = jnp.asarray(self.reversible)
        begin = jnp.cumsum(increment) - increment
        return y + read(begin, cell) + within * read(increment, cell)


@eqx.filter_jit
def _settle(model: Preisach, state: PreisachState, path: Array) -> PreisachState:
    """The state after a path of inputs."""
    table = model.density.tabulate()
    return jax.lax.scan(lambda s, u: model._step_relays(table, s, u), state, path)[0]


def _traced_tree(path: Array) -> MemoryTree:
    """`memory_tree` of a traced path: the host computes the indices, padded to a fixed capacity.

    Padding hangs on anchor 0 and its events move nothing, so outputs do not change; values are
    gathered from the traced path by these indices, so gradients flow to the input.
    """
    samples = path.shape[0]
    sizes = [samples] * 4 + [2 * samples] * 3 + [samples]

    def on_host(path: Any) -> MemoryTree:
        tree = memory_tree(np.asarray(path))
        anchors = len(tree.node)

        def fill(part: np.ndarray, size: int, by: int) -> np.ndarray:
            return np.append(part, np.full(size - len(part), by)).astype(np.int32)

        # One past the last anchor means "none": that place is now one past the capacity.
        events = (
            np.where(e == anchors, samples, e) for e in (tree.pushed, tree.popped, tree.popped_too)
        )
        return MemoryTree._make((
            tree.anchor.astype(np.int32),
            fill(tree.node, samples, 0), fill(tree.parent, samples, 0), fill(tree.rising, samples, 1),
            *(fill(e, 2 * samples, samples) for e in events),
            fill(tree.position, samples, 0),
        ))  # fmt: skip

    result = MemoryTree._make(jax.ShapeDtypeStruct((size,), jnp.int32) for size in sizes)
    return jax.pure_callback(on_host, result, jax.lax.stop_gradient(path), vmap_method="sequential")


def _to_device(part: Any) -> Array:
    array = jnp.asarray(part)
    return array.astype(float) if jnp.issubdtype(array.dtype, jnp.floating) else array
