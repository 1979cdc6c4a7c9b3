"""Inverse of a Preisach model: exact on a grid, branch by branch, with the forward model's memory."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from hysteresis import InputError, is_concrete, register
from hysteresis.preisach import AbstractGridDensity, EverettTable, OpenLoops, Preisach, read
from hysteresis.preisach._tree import Branches, branches_of, first_branch
from hysteresis.trees import search_range

from .._contract import AbstractCompensator, Estimate, Status, scan_steps
from ._bisection import BracketedCompensator
from ._inverse_of import inverse_of


class InverseState(NamedTuple):
    """The staircase of dominant extrema, seen from the output.

    - `loops`: the open loops; their levels are outputs z without the offset.
    - `u`, `z`: input and output now; `rising`: +1 or -1, which way they moved last.
    - `value`: the last estimate, which beyond saturation is not `u`.
    """

    loops: OpenLoops
    u: Array
    z: Array
    rising: Array
    value: Array


class _Target(NamedTuple):
    """A branch and how far to go on it: q(u) = s (R(u) - R(r)) + 2 s_o E(u, r) = rise."""

    cell_r: Array
    fraction_r: Array
    s: Array
    rise: Array


@register
class PreisachCompensator(AbstractCompensator[InverseState, Estimate]):
    """Exact inverse of a Preisach model on a grid, branch by branch.

    On a branch from the reversal r the output moved by

        s (z - z_r) = s (R(u) - R(r)) + 2 s_o E(u, r) =: q(u),   s = +-1 rising or falling,

    which grows along the branch: a bisection finds the cell, and within a cell q is quadratic. Loops
    close in z where they close in u, so the memory needs y alone.

    Where q does not grow the nearest input is held (FLAT). Beyond saturation the reversible part
    is followed (EXTRAPOLATED), or the bound held if it does not grow there (SATURATED).
    """

    model: Preisach
    table: EverettTable
    begin: Array
    increment: Array
    floor: Array
    ceiling: Array
    flat_slope: Array
    margin: Array

    def __init__(self, model: Preisach):
        self.model = model
        cells = self._grid.cells
        self.table, self.begin, self.increment, self.floor, self.ceiling = branches_of(model)
        # A millionth of a millionth of the mean slope is rounding, not slope.
        self.flat_slope = 1e-12 * (self.ceiling - self.floor) / cells
        self.margin = 4 * jnp.finfo(self.floor.dtype).eps * (self.ceiling - self.floor)

    def init(self) -> InverseState:
        of = Branches(self.table, self.begin, self.increment, self.floor, self.ceiling)
        begin = first_branch(self.model, of)
        return InverseState(*begin, begin.u)

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: InverseState | None = None
    ) -> Estimate:
        y = jnp.asarray(y, float)
        return scan_steps(self, None, y, self.init() if state is None else state)[1]

    def step(
        self, state: InverseState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[InverseState, Estimate]:
        y = jnp.asarray(y, state.z.dtype)
        valid = jnp.isfinite(y)
        wanted = jnp.where(valid, y - self.model.offset, state.z)
        z = jnp.clip(wanted, self.floor, self.ceiling)
        rising = jnp.where(z > state.z, 1, jnp.where(z < state.z, -1, state.rising))
        s = rising.astype(z.dtype)
        # A reversal of y is one of u, because every branch is monotone. So z alone decides which loops open
        # and close, and an error of u cannot close a loop too early.
        loops = state.loops.push(rising != state.rising, state.u, state.z)
        # Strictly beyond: on a flat branch z may equal a level whose input is not reached yet.
        loops = loops.wipe_out(lambda extremum, level: s * z > s * level)
        u, slope = self._solve(loops, state.u, rising, z)
        # An output that does not move leaves the input in place; solving again could move it by rounding.
        u = jnp.where(z == state.z, state.u, u)

        # Beyond saturation only the reversible part goes on, along its last increment.
        widths = jnp.asarray(np.diff(self._grid.edges)[[-1, 0]], z.dtype)
        width = jnp.where(wanted > z, *widths)
        end = jnp.where(wanted > z, self.increment[-1], self.increment[0])
        goes_on = end > self.flat_slope
        excess = (wanted - z) * width / jnp.where(goes_on, end, 1.0)
        value = jnp.where(valid, u + jnp.where(goes_on, excess, 0.0), state.value)
        status = jnp.where(slope > self.flat_slope, Status.OK, Status.FLAT)
        beyond = jnp.where(goes_on, Status.EXTRAPOLATED, Status.SATURATED)
        status = jnp.where(wanted == z, status, beyond)
        status = jnp.where(valid, status, Status.INVALID)
        return InverseState(loops, u, z, rising, value), Estimate(value, status)

    @property
    def _grid(self) -> AbstractGridDensity:
        assert isinstance(self.model.density, AbstractGridDensity)
        return self.model.density

    def _solve(self, loops: OpenLoops, here: Array, way: Array, z: Array) -> tuple[Array, Array]:
        """The input nearest to the input `here` with q = s (z - z_r), and dq per cell there."""
        grid, s = self._grid, way.astype(z.dtype)
        r, z_r = loops.anchor
        target = _Target(*grid.locate(r), s, s * (z - z_r))

        # The branch ends where the loop it lies in closes, or at the bound.
        bound = jnp.where(way > 0, grid.high, grid.low)
        older = read(loops.extremum, jnp.maximum(loops.depth - 2, 0))
        end = jnp.where(loops.depth >= 2, older, bound)
        first, last = way * grid.locate(here)[0], way * grid.locate(end)[0]

        # Bisect for the last cell, in the direction of travel, that is entered below the target; flat ones,
        # in which it rises by rounding alone, are not gone through.
        # The number of rounds is fixed, so the loop has a known length for `vmap` and for reverse-mode
        # derivatives; a round on a finished interval changes nothing.
        goal = target.rise - self.margin

        def halve(_: Any, interval: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = interval
            # A falling branch is searched in -cell, so that q grows with the index here too; a cell is
            # then entered at its upper node. Rounding up makes an interval of two cells shrink.
            middle = (low + high + 1) >> 1
            node = jnp.where(way > 0, middle, 1 - middle)
            below = self._at_node(target, node) < goal
            inside = low < high
            return (
                jnp.where(inside & below, middle, low),
                jnp.where(inside & ~below, middle - 1, high),
            )

        rounds = int(np.ceil(np.log2(grid.cells))) + 1
        cell = way * jax.lax.fori_loop(0, rounds, halve, (first, last))[0]

        # q = A f^2 + B f + C + rise within the cell; dq/df has the sign of s. The quadratic term is the
        # triangle of relays on the diagonal, which have both thresholds in this cell.
        o = self.model.orientation
        begin, stop = self._at_node(target, cell), self._at_node(target, cell + 1)
        A = 2 * o * read(self.table.diagonal, cell)
        B, C = stop - begin - A, begin - target.rise
        root = jnp.sqrt(jnp.maximum(B * B - 4 * A * C, 0.0))
        entry = jnp.where(way > 0, 0.0, 1.0)
        # Two forms of one root: the sign of B says which one does not cancel.
        divisor = jnp.where(s * B >= 0, -(B + s * root), 2 * A)
        numerator = jnp.where(s * B >= 0, 2 * C, s * root - B)
        fraction = jnp.where(divisor == 0, entry, numerator / jnp.where(divisor == 0, 1.0, divisor))
        fraction = jnp.clip(fraction, 0.0, 1.0)
        # Rounding must not move the input against the output, nor beyond the end of the branch.
        u = grid.at(cell, fraction)
        u = jnp.where(way > 0, jnp.clip(u, here, end), jnp.clip(u, end, here))
        # At the edge of a flat cell the input may be anywhere in it.
        node = cell + jnp.where(way > 0, 1, 0)
        past = jnp.clip(node + way, 0, grid.cells)
        flat = (way * cell < last) & (self._at_node(target, past) <= target.rise + self.margin)
        return u, jnp.where(flat, 0.0, s * (2 * A * fraction + B))

    def _at_node(self, target: _Target, node: Array) -> Array:
        """q at a grid node.

        The reversal r lies at the fraction g of its cell. There E is linear between the nodes, less
        g (1 - g) times the mass of the half cell on the diagonal.
        """
        stride = self.table.node.shape[0]
        g, entry = target.fraction_r, target.cell_r * stride + node
        table = self.table.node.reshape(-1)
        E = read(table, entry) * (1 - g) + read(table, entry + stride) * g
        E += read(self.table.diagonal, target.cell_r) * g * (g - 1)
        R_r = read(self.begin, target.cell_r) + g * read(self.increment, target.cell_r)
        return target.s * (read(self.begin, node) - R_r) + 2 * self.model.orientation * E


@inverse_of.register
def _(model: Preisach) -> PreisachCompensator | BracketedCompensator:
    density = model.density
    if isinstance(density, AbstractGridDensity):
        _check_slopes(model)
    elif model.leading:
        raise InputError(
            "not-invertible",
            f"nothing says that a leading model with a {type(density).__name__} rises with its input.",
            cause="its relays fall as the input rises, and their slope is known on a grid alone.",
            fix="fit a GridDensity, or swap input and output and fit the lagging direction.",
        )
    if isinstance(density, AbstractGridDensity) and model.up is None and not model.dead_band:
        return PreisachCompensator(model)
    return BracketedCompensator(model, *search_range(model))


def _check_slopes(model: Preisach) -> None:
    """Raise `InputError` where the output of a model on a grid can fall while its input rises."""
    if not all(map(is_concrete, jax.tree.leaves(model))):
        return  # one of many under vmap: the fit has seen to its slopes
    grid: Any = model.density
    slope, widths = np.asarray(model.least_slope()), np.diff(grid.edges)
    scale = float(np.abs(np.asarray(grid.masses())).max())
    if (slope * widths < -1e-9 * scale).any():
        k = int(slope.argmin())
        raise InputError(
            "not-invertible",
            f"the output can fall while the input rises from {grid.edges[k]:g} to "
            f"{grid.edges[k + 1]:g}.",
            cause="a signed density, or a reversible part too flat for a leading model.",
            fix="fit the model with its slopes constrained, which identify.fit does.",
        )
