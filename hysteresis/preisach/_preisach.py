"""The Preisach model: a density of relays, and the memory tree of the input."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import AbstractModel, Series, Tree, one_column
from .._parameter import (
    NOT_NEGATIVE,
    Scalar,
    Starts,
    Times,
    as_array,
    check_shapes,
    is_concrete,
    parameter,
)
from .._registry import register
from ..trees import looked_for
from ._dead_band import play, play_step
from ._density import AbstractDensity, GridDensity, even_place
from ._everett import (
    OpenLoops,
    bilinear,
    everett_terms,
    hang,
    materialise,
    past_inputs,
    read,
    running_sum,
    tabulate_once,
)
from ._memory import Initial, MemoryTree, check_initial, staircase, word_or_inputs
from ._tree import Visited, check_up, grid_tree, occupancy_table, parts_of, running_extremes

# The sums over a memory tree: what the relays have done between its root and each of its anchors.


def anchor_levels(
    tree: MemoryTree, rise: Float[Array, " anchors"], runtime_true: Any
) -> Float[Array, " anchors"]:
    """The sum of the rises of all anchors on the stack when each was pushed, its own included.

    `rise` is the change from an anchor's parent to the anchor. A push adds one, a pop takes an
    anchor's and its parent's: a cumulative sum over the events. `runtime_true` as in `materialise`.
    """
    rise = materialise(rise, runtime_true)  # it is read twice
    change = jnp.concatenate([rise, -rise - read(rise, tree.parent), jnp.zeros(1, rise.dtype)])
    change = materialise(change, runtime_true)
    return materialise(read(running_sum(read(change, tree.event)), tree.position), runtime_true)


SMALL_TABLE = 100_000
"""Tables with fewer entries than this are stored once more where they are read. That also stores their
gradient, which then takes a third of the time. A larger table takes longer to copy than that saves."""


class PreisachState(NamedTuple):
    """The staircase of dominant extrema and where the input stands on it.

    - `loops`: the open loops; their levels are outputs of the relays alone.
    - `u`, `y`: the relays' input and output now.
    - `rising`: +1 or -1, which way the input moved last.
    - `visited`: the least and greatest input so far; None without a fitted first state `up`, which
      is no part of `y`.
    - `held`: the input behind the dead band, NaN before the first sample; None without one.
    """

    loops: OpenLoops
    u: Array
    y: Array
    rising: Array
    visited: Visited | None
    held: Array | None


class PreisachInput(NamedTuple):
    """The memory tree of an input with its pairs located on the density; see `MemoryTree`.

    - `sample`, `sign` (samples,): each sample's anchor and itself, and 2 rising or -2 falling.
    - `past`, `past_sign`: the same of the paths to the first state, whose inputs are `before`.
    - `place` (anchors,): where each anchor stands in the past and the samples, one after the other.
    - `cell`, `within` (samples,): the place on the reversible part, or None.
    - `unvisited` (samples,): greatest and least input so far, or None.
    """

    tree: MemoryTree
    sample: Any
    sign: Any
    past: Any
    past_sign: Any
    before: Any
    place: Any
    cell: Array | None
    within: Array | None
    unvisited: Any


@register
class Preisach(AbstractModel[PreisachState, PreisachInput]):
    """Preisach model: relays of every pair of thresholds, weighted by a density.

        y = offset + R(u) + P[u],      P[u](t) = double integral of mu(alpha, beta) relay_ab[u](t)

    Relays are -1 or +1, so P = -mass in negative saturation. On a monotone branch that started at the
    reversal u_r, P(u) = P(u_r) + 2 s E(u, u_r), with the Everett function E of the density and s = +1
    rising, -1 falling; passing an older extremum wipes out the loop inside. The output does
    not depend on the rate or on the density of samples along the path. Beyond [low, high] every relay is
    saturated and only R continues; `hysteresis.internal.extended` widens the grid.

    **Arguments:**

    - `density`: where the relays are, e.g. `GridDensity`.
    - `reversible`: (n,) increments of R over the cells of a grid density, or n equal ones of
      [low, high], none negative; R(low) = 0. R is the model's memoryless part, piecewise linear.
      None for no such part.
    - `offset`: the output's constant.
    - `up`: (n, n) for each grid cell, the mass of its relays that are up before the first sample, between
      0 and the cell's weight. They stay up until the input reaches one of their thresholds. `up` needs
      `initial="negative"` and a grid density. None for no such relays.

    **Other arguments:**

    - `leading`: y = offset + R(u) - P[u], for loops traversed clockwise, whose output leads the input
      (displacement -> force). R must be steep enough for y to rise with u; see `least_slope`.
    - `initial`: relays before the first sample: all down (`"negative"`), all up (`"positive"`), or
      down above and up below the anti-diagonal (`"demagnetised"`); or inputs in [low, high] that
      lead there from all down, such as `(3.0, 1.0, 2.0)`.
    - `capacity`: reversals a streaming state can hold, at least three; beyond it the smallest loop is
      forgotten. The output is then off by at most twice E(a, b), a the youngest reversal still
      held and b the oldest one forgotten, until the input leaves [a, b].
    - `dead_band`: half width of a play operator in front of the relays, not of R: inputs that move by
      less make no reversals. See `input_noise`.

    Raises `InputError` for a reversible part that does not fit the density or decreases, masses `up` that
    the cells cannot have, and settings that do not meet these conditions.

    Source: Mayergoyz, Mathematical Models of Hysteresis; Kim 2018, equation (1).

    **Example:**

        >>> density = hysteresis.preisach.GridDensity(0.0, 10.0, np.tri(2))
        >>> relays = hysteresis.Preisach(density, reversible=np.array([1.0, 1.0]), offset=3.0)
        >>> relays.simulate(None, np.array([0.0, 5.0, 10.0, 5.0, 0.0])).tolist()
        [0.0, 3.0, 8.0, 5.0, 0.0]
    """

    density: AbstractDensity
    reversible: Float[Array, " cells"] | np.ndarray | None = parameter(
        None, unit="output", **NOT_NEGATIVE, meaning="increments of the memoryless part"
    )
    offset: Scalar = parameter(0.0, unit="output", meaning="constant of the output")
    up: Float[Array, "cells cells"] | np.ndarray | None = parameter(
        None,
        unit="output",
        **NOT_NEGATIVE,
        meaning="mass of the relays of each cell that are up before the first sample",
    )
    leading: bool = eqx.field(default=False, static=True, kw_only=True)
    initial: Initial = eqx.field(
        default="negative", static=True, kw_only=True, converter=word_or_inputs
    )
    capacity: int = eqx.field(default=128, static=True, kw_only=True)
    dead_band: float = eqx.field(default=0.0, static=True, kw_only=True, converter=float)

    def __check_init__(self) -> None:
        check_initial(self.initial, self.density.low, self.density.high)
        if isinstance(self.density, GridDensity):
            check_shapes(reversible=(self.reversible, f"{self.density.cells}"))
        self._check_up()
        if self.capacity < 3:
            raise InputError(
                "bad-option", f"{self.capacity} reversals hold no loop.", fix="give 3 or more."
            )
        if not 0 <= self.dead_band < float("inf"):
            said = f"half a dead band is {self.dead_band:g} wide."
            raise InputError("bad-option", said, fix="give 0, or three times input_noise(u).")

    def _check_up(self) -> None:
        if self.up is None:
            return
        if self.initial != "negative" or not isinstance(self.density, GridDensity):
            raise InputError(
                "bad-state",
                "relays that are up before the first sample are counted from all down, on a grid.",
                fix='give initial="negative" and a GridDensity, or leave out `up`.',
            )
        check_up(self.up, self.density.weights)

    # Streaming

    def init(self, t0: Any = None, u0: Any = None) -> PreisachState:
        table = self.density.tabulate()
        low, down = jnp.asarray(self.density.low, float), -self.density.mass(table)
        loops = OpenLoops.none(self.capacity, low, down)
        visited = None if self.up is None else Visited.nothing()
        held = jnp.asarray(jnp.nan, float) if self.dead_band else None
        state = PreisachState(loops, low, down, loops.depth, visited, held)
        return _settle(self, state, jnp.asarray(self._staircase(), float))

    def step(self, state: PreisachState, t: Any, u: Any) -> tuple[PreisachState, Float[Array, ""]]:
        # A number of Python's would be a constant of the program: each compiles another one.
        return self._stepped(state, jnp.asarray(u, state.u.dtype))

    @eqx.filter_jit
    def _stepped(self, state: PreisachState, u: Array) -> tuple[PreisachState, Array]:
        held = None if state.held is None else play_step(u, self.dead_band, state.held)
        state = state._replace(held=held)
        table = self.density.tabulate()
        state, relays = self._step_relays(table, state, u if held is None else held)
        if state.visited is not None:
            state = state._replace(visited=state.visited.also(state.u))
            up = occupancy_table(jnp.asarray(self.up))
            relays += 2 * bilinear(up, self._unvisited(state.visited))
        return state, self._output(relays, *self._place(u))

    def _step_relays(
        self, table: Any, state: PreisachState, u: Array
    ) -> tuple[PreisachState, Array]:
        loops, u_before, y_before, rising = state[:4]
        u = jnp.clip(u, self.density.low, self.density.high)
        direction = jnp.where(u > u_before, 1, jnp.where(u < u_before, -1, rising))
        s = direction.astype(u.dtype)
        loops = loops.push(direction != rising, u_before, y_before)
        loops = loops.wipe_out(lambda extremum, level: s * u >= s * extremum)
        reversal, level = loops.anchor
        y = level + 2 * s * self.density.everett(table, self.density.pair(u, reversal))
        return state._replace(loops=loops, u=u, y=y, rising=direction), y

    # Batch

    def prepare(
        self, t: Times, u: Series, state: PreisachState | None = None, *, starts: Starts = (0,)
    ) -> PreisachInput:
        return jax.tree.map(_to_device, self.located(u, state, starts=starts))

    def located(
        self, u: Series, state: PreisachState | None = None, *, starts: Starts = (0,)
    ) -> PreisachInput:
        """`prepare`, with NumPy arrays for inputs in NumPy: nothing is compiled, and nothing copied."""
        past = self._past(state)
        concrete = is_concrete(u) and is_concrete(past)
        u = np.asarray(one_column(u), float) if concrete else jnp.asarray(u)
        seen = self._seen(u, state, starts)
        tree, at_node, past, past_anchor, place = hang(past, seen, starts)

        def branch(anchor: Any, u: Any) -> tuple[Any, Any]:
            # Anchor first: the samples of a branch then read along one row of a table.
            return self.density.pair(at_node[anchor], u), 2.0 * tree.rising[anchor].astype(float)

        visited = None
        if self.up is not None:
            before = state.visited if state is not None else None
            visited = running_extremes(seen, before or Visited.nothing(), starts)
        return PreisachInput(
            tree, *branch(tree.anchor, seen), *branch(past_anchor, past), past, place,
            *self._place(u), self._unvisited(visited),
        )  # fmt: skip

    def evaluate(self, prepared: PreisachInput) -> Float[Array, " samples"]:
        return self.look_up(tabulate_once(self.density, prepared.tree.parent[0] == 0), prepared)

    def look_up(self, table: Any, prepared: PreisachInput) -> Float[Array, " samples"]:
        """`evaluate` with the density's table, `density.tabulate()`, at hand."""
        tree = prepared.tree
        true = tree.parent[0] == 0
        # `evaluate` has stored the table once; storing it again is for its gradient, see `SMALL_TABLE`.
        if sum(part.size for part in jax.tree.leaves(table)) < SMALL_TABLE:
            table = materialise(table, true)
        past = prepared.past_sign * self.density.everett(table, prepared.past)
        # The change from an anchor's parent to the anchor is that of the sample at which the input turned,
        # so anchors need no look-ups of their own. Anchors of the path to the first state are in `past`.
        place = jnp.maximum(prepared.place - len(past), 0)
        before, place_past = prepared.place < len(past), jnp.minimum(prepared.place, len(past) - 1)
        if 8 * len(place) < len(prepared.sign) and isinstance(self.density, GridDensity):
            # A branch then has over eight samples on average. Looking up the few anchors again is faster
            # than storing the rises of all samples to read them twice. E's term of the anchor alone is the
            # same for all samples of its branch, so it is computed once and added to the anchor's level.
            both, _, of_sample = everett_terms(table, prepared.sample)
            own = prepared.sign * (both + of_sample)
            at_node = jax.tree.map(lambda part: read(part, place), prepared.sample)
            both, of_parent, of_node = everett_terms(table, at_node)
            rise = read(prepared.sign, place) * (both + of_parent + of_node)
            of_past = everett_terms(table, prepared.past)[2]
            of_anchor = jnp.where(before, read(of_past, place_past), of_node)
            of_anchor *= 2 * tree.rising.astype(rise.dtype)
        else:
            own = prepared.sign * self.density.everett(table, prepared.sample)
            own = materialise(own, true)
            rise, of_anchor = read(own, place), 0.0
        rise = jnp.where(before, read(past, place_past), rise)
        # The root of the tree is negative saturation, where all relays together give -mass.
        level = anchor_levels(tree, rise, true) - self.density.mass(table) + of_anchor
        relays = read(level, tree.anchor) + own
        if self.up is not None:
            # Relays with both thresholds outside the visited inputs are still in their first state: those
            # that were up count +1 instead of -1.
            up = materialise(occupancy_table(jnp.asarray(self.up)), true)
            relays += 2 * bilinear(up, prepared.unvisited)
        return self._output(relays, prepared.cell, prepared.within)

    def laws(self, eps: float, depth: int) -> Tree:
        if not isinstance(self.density, GridDensity):
            raise InputError(
                "not-exportable",
                f"a Preisach model with a {type(self.density).__name__} has no tree of laws.",
                cause="the law knows densities on a grid alone.",
                fix="fit a GridDensity (hysid fit --model Preisach).",
            )
        if self.up is None and not self.dead_band:
            return grid_tree(self, eps, depth)
        return looked_for(self, parts_of(self, eps, depth), eps)

    def search_range(self) -> tuple[float, float]:
        return self.density.low - self.dead_band, self.density.high + self.dead_band

    # Parts

    def least_slope(self) -> Float[Array, " cells"] | Float[np.ndarray, " cells"]:
        """The least dy/du over each cell of a grid, over every branch an input can reach.

        On a rising branch from r, dy/du in row k is R'_k + 2 s_o (sum of w_kj over the columns from r
        up to the diagonal, whose half cell enters with 0 to 2 times its mass), s_o = +1 lagging, -1
        leading; on a falling branch the same with columns for rows. Negative where the model
        does not rise with its input and cannot be inverted.
        """
        assert isinstance(self.density, GridDensity)
        masses = self.density.weights
        reversible = 0.0 if self.reversible is None else self.reversible
        concrete = is_concrete(masses) and is_concrete(reversible)
        xp = np if concrete else jnp  # where nothing is traced, nothing needs compiling
        w, reversible = xp.tril(xp.asarray(masses)), xp.asarray(reversible)
        half = xp.diagonal(w)
        beside = w - xp.diag(half)
        swept = xp.stack([beside[:, ::-1].cumsum(1), beside.T.cumsum(1)])
        swept = xp.concatenate([xp.zeros_like(swept[..., :1]), swept], -1)
        swept = xp.concatenate([swept, swept + 2 * half[None, :, None]], -1)
        least = (2 * self.orientation * swept).min((0, 2))
        return (least + reversible) / np.diff(self.density.edges)

    @property
    def orientation(self) -> int:
        """+1 where the loops lag the input (counter-clockwise), -1 where they lead it."""
        return -1 if self.leading else 1

    def _past(self, state: PreisachState | None) -> Any:
        """A path of inputs that leads from the negative saturation to `state`."""
        if state is None:
            return np.array([self.density.low, *self._staircase()])
        return past_inputs(state.loops, state.u)

    def _seen(self, u: Any, state: PreisachState | None, starts: Starts) -> Any:
        """What the relays see of the inputs: behind the dead band, within the bounds."""
        xp = jnp if isinstance(u, jax.Array) else np
        if self.dead_band:
            held = jnp.asarray(jnp.nan, float) if state is None else state.held
            u = xp.asarray(play(jnp.asarray(u), self.dead_band, held, starts))
        return xp.clip(u, self.density.low, self.density.high)

    def _staircase(self) -> list[float]:
        density, turns = self.density, self.capacity // 2
        return staircase(self.initial, density.low, density.high, turns)

    def _unvisited(self, visited: Visited | None) -> Any:
        """Where the relays begin that no input has reached yet."""
        return None if visited is None else self.density.pair(visited.greatest, visited.least)

    def _place(self, u: Any) -> tuple[Any, Any]:
        """Cell of the reversible part and fraction of it, below 0 or above 1 beyond the range."""
        if self.reversible is None:
            return None, None
        if isinstance(self.density, GridDensity):
            return self.density.locate(u)
        return even_place(u, self.density.low, self.density.high, self.reversible.shape[-1])

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


def _to_device(part: Any) -> Array:
    array = as_array(part)
    return jnp.asarray(array, float) if jnp.issubdtype(array.dtype, jnp.floating) else array
