"""The columns of a linear fit at the rows it was fitted to, its prior, and the sums that mean something."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from hysteresis import InputError, Record

from ..linear._composition import CompositionUnknowns
from ..linear._composition_fit import SLACK
from ..linear._composition_memory import memory_blocks, memory_of
from ..linear._composition_parts import DRIFTS
from ..linear._conditioned_unknowns import ConditionedUnknowns, shares_of
from ..linear._linear_fit import LinearFit
from ..linear._preisach_problem import PreisachProblem
from ..linear._preisach_sums import runs
from ..linear._preisach_unknowns import SUMS, GridUnknowns
from ..linear._unknown_vectors import relative
from ..records._folds import Parts
from ._neighbour_sums import NeighbourSums, neighbour_sums
from ._weights_evidence import Basis, basis_of

LONGEST = 100_000
"""Rows of a composition that the sums are made of; of a longer record stretches of `STRETCH` rows."""

STRETCH = 1000

WIDE = 1e-5
"""What stands for the prior of the offset, over the mean of the others: it is as good as flat."""

STEPS = 480
"""Of each branch of the slow loop."""


class WeightsDesign(NamedTuple):
    """What a posterior of weights needs of a fit; outputs over `scale`.

    - `basis`: of the normal matrix and the prior K. `sums`: of the rows (A U, y).
    - `names`, `totals` (sums, unknowns): sums of the unknowns that mean something, over `scale`.
    """

    basis: Basis
    sums: NeighbourSums
    names: tuple[str, ...]
    totals: Float[np.ndarray, "sums unknowns"]


def weights_design(
    linear: LinearFit, record: Record, used: Bool[np.ndarray, " samples"]
) -> WeightsDesign:
    """Of a fit to the `used` rows of a record.

    Raises `InputError` `no-posterior` for unknowns that an earlier version cut in other cells.
    """
    meaning = linear.meaning
    if not linear.is_current:
        raise InputError(
            "no-posterior",
            "a posterior cannot be drawn for a composition that an earlier version of hysid fitted.",
            cause="its parts had another number of unknowns.",
            fix="fit the record again.",
        )
    if isinstance(meaning, GridUnknowns):
        return _of_grid(meaning, record, used)
    return _of_composition(meaning, record, used)


def _of_grid(meaning: GridUnknowns, record: Record, used: np.ndarray) -> WeightsDesign:
    whole = Parts(np.where(used, 0, -1), (), None, "nothing held out")
    problem = PreisachProblem(record, whole, meaning)
    H, _ = problem.total((0,)).means
    basis = basis_of(H, _with_offset(problem.prior))
    nodes = problem.nodes(basis.directions[:, : basis.known])

    def blocks() -> Iterator[np.ndarray]:
        for block in problem.blocks():
            here = used[block.rows]
            both = np.hstack([block.product(nodes)[here], problem.y[block.rows][here, None]])
            yield problem.weights[block.rows][here, None] * both

    sums = neighbour_sums(blocks(), runs(record.starts, used))
    return WeightsDesign(basis, sums, SUMS, meaning.totals)


def _of_composition(
    meaning: CompositionUnknowns | ConditionedUnknowns, record: Record, used: np.ndarray
) -> WeightsDesign:
    base = meaning.base if isinstance(meaning, ConditionedUnknowns) else meaning
    y = relative(base, record.output)
    used = _stretches(used & (y > base.least + SLACK))  # below it an output tells only a limit
    y = y * record.weights
    rows = np.flatnonzero(used)
    H, knots = np.zeros((len(meaning.totals.T),) * 2), 1
    for _, A in _columns(meaning, record, rows):
        H += A.T @ A
    K = base.prior(1.0)
    names, totals = _sums_of(base)
    if isinstance(meaning, ConditionedUnknowns):
        knots, at = len(meaning.knots), meaning.total_names
        each = [name[len(base.total_names[0]) :] for name in at[:: len(base.total_names)]]
        names = tuple(name + knot for knot in each for name in names)
    basis = basis_of(H / len(rows), _with_offset(np.kron(np.eye(knots), K), base.count))
    U = basis.directions[:, : basis.known]
    blocks = (np.hstack([A @ U, y[here, None]]) for here, A in _columns(meaning, record, rows))
    sums = neighbour_sums(blocks, runs(record.starts, used))
    return WeightsDesign(basis, sums, names, np.kron(np.eye(knots), totals))


def _columns(
    meaning: CompositionUnknowns | ConditionedUnknowns,
    record: Record,
    rows: Int[np.ndarray, " rows"],
) -> Iterator[tuple[Int[np.ndarray, " some"], Float[np.ndarray, "some unknowns"]]]:
    """The output of each unknown alone at some rows, times their weights, in blocks."""
    base = meaning.base if isinstance(meaning, ConditionedUnknowns) else meaning
    for here, memory in memory_blocks(base.memory(), record, rows):
        A = base.columns(memory) * record.weights[here, None]
        if isinstance(meaning, ConditionedUnknowns):
            c = record.columns[meaning.condition][here]
            shares = shares_of(np.array(meaning.knots), meaning.axis, c)
            A = (shares[:, :, None] * A[:, None]).reshape(len(A), -1)
        yield here, A


def _with_offset(K: Float[np.ndarray, "n n"], period: int | None = None) -> np.ndarray:
    """The prior's matrix with a wide prior for the offset, the first unknown of every `period`."""
    K = np.array(K)
    offsets = np.arange(0, len(K), period or len(K))
    K[offsets, offsets] = WIDE * np.trace(K) / len(K)
    return K


def _stretches(used: Bool[np.ndarray, " samples"]) -> Bool[np.ndarray, " samples"]:
    """At most `LONGEST` of the rows, in stretches of neighbours."""
    rows = np.flatnonzero(used)
    if len(rows) <= LONGEST:
        return used
    stretch = np.arange(len(rows)) // STRETCH
    count, kept = int(stretch[-1]) + 1, LONGEST // STRETCH
    taken = np.isin(stretch, np.linspace(0, count - 1, kept).astype(int))
    few = np.zeros_like(used)
    few[rows[taken]] = True
    return few


def _sums_of(
    base: CompositionUnknowns,
) -> tuple[tuple[str, ...], Float[np.ndarray, "sums unknowns"]]:
    """The sums of a composition: what it does in a slow loop, and what each part does."""
    return (*SUMS, *base.total_names), np.vstack([slow_loop(base), base.totals])


def slow_loop(base: CompositionUnknowns) -> Float[np.ndarray, "3 unknowns"]:
    """Rows that sum up unknowns to `SUMS`, over `scale`: the second of two loops between the ends of the
    input, so slow that all that relaxes has relaxed and friction by velocity is nothing.

    What drifts does not count.
    """
    up = np.linspace(base.low, base.high, STEPS + 1)
    loop = np.concatenate([up, up[-2::-1]])
    u = np.concatenate([loop, loop[1:]])
    slowly = 1e7 * max([*base.times, base.step, 1e-9])
    record = Record.from_arrays(u, u, slowly * np.arange(len(u)))
    memory = memory_of(base.memory(), record, np.arange(2 * STEPS, len(u)))
    columns = base.columns(memory)
    columns[:, np.repeat([False, *(part in DRIFTS for part in base.parts)], base.sizes)] = 0.0
    rising, falling = columns[: STEPS + 1], columns[: STEPS - 1 : -1]
    side = -1.0 if base.leading else 1.0
    low, high = falling[0], falling[-1]
    width = side * np.sign(base.scale) * _mean_between(falling - rising)
    return np.stack([(low + high) / 2, high - low, width])


def _mean_between(columns: Float[np.ndarray, "rows unknowns"]) -> Float[np.ndarray, " unknowns"]:
    """The mean over an even grid, by the trapezoidal rule."""
    return (columns[1:] + columns[:-1]).mean(0) / 2
