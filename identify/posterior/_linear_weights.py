"""The posterior of linear weights: emcee over noise and prior strength, the weights drawn given each."""

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy.linalg
from jaxtyping import Bool, Float, Int
from threadpoolctl import threadpool_limits

from hysteresis import InputError, Record

from .._levels import HELD, LITTLE, MANY_ROWS, NOTHING, PART, SOME_ROWS
from ..linear._composition import CompositionUnknowns
from ..linear._composition_parts import DRIFTS, memory_blocks, memory_of
from ..linear._conditioned_unknowns import ConditionedUnknowns, shares_of
from ..linear._cross_validation import jittered
from ..linear._linear_fit import LinearFit
from ..linear._preisach_fit import PreisachProblem, runs
from ..linear._preisach_unknowns import SUMS, GridUnknowns
from ..linear._unknown_vectors import in_units, relative
from ..records._folds import Parts
from ..results._fit_result import FitResult
from ..storage._checkpoint import Checkpoint
from ._emcee import first_walkers, sample_ensembles
from ._posterior import Posterior, Progress, posterior_of, summary_of
from ._weights_evidence import (
    PRIOR_VARIANCE,
    Basis,
    NeighbourSums,
    WeightsEvidence,
    basis_of,
    neighbour_sums,
)

# The columns of a linear fit at the rows it was fitted to, its prior, and the sums that mean something.


class WeightsDesign(NamedTuple):
    """What a posterior of weights needs of a fit; outputs over `scale`.

    - `basis`: of the normal matrix and the prior K. `sums`: of the rows (A U, y).
    - `names`, `totals` (sums, unknowns): sums of the unknowns that mean something, over `scale`; draws of
      them are displaced by their `shift`, as those of the fit are.
    """

    basis: Basis
    sums: NeighbourSums
    names: tuple[str, ...]
    totals: Float[np.ndarray, "sums unknowns"]
    shift: Float[np.ndarray, " sums"]


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
        return _of_grid(meaning, linear.shift, record, used)
    return _of_composition(meaning, record, used)


def _of_grid(
    meaning: GridUnknowns, shift: np.ndarray, record: Record, used: np.ndarray
) -> WeightsDesign:
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
    return WeightsDesign(basis, sums, SUMS, meaning.totals, shift)


def _of_composition(
    meaning: CompositionUnknowns | ConditionedUnknowns, record: Record, used: np.ndarray
) -> WeightsDesign:
    base = meaning.base if isinstance(meaning, ConditionedUnknowns) else meaning
    y = relative(base, record.output)
    used = _stretches(used & (y > base.least + HELD))  # below it an output tells only a limit
    y = y * record.weights
    rows = np.flatnonzero(used)
    H, knots = np.zeros((len(meaning.totals.T),) * 2), 1
    for _, A in _columns(meaning, record, rows):
        H += A.T @ A
    K = base.prior(1.0)
    names = (*SUMS, *base.total_names)
    totals = np.vstack([slow_loop(base), base.totals])
    if isinstance(meaning, ConditionedUnknowns):
        knots, at = len(meaning.knots), meaning.total_names
        each = [name[len(base.total_names[0]) :] for name in at[:: len(base.total_names)]]
        names = tuple(name + knot for knot in each for name in names)
    basis = basis_of(H / len(rows), _with_offset(np.kron(np.eye(knots), K), base.count))
    U = basis.directions[:, : basis.known]
    blocks = (np.hstack([A @ U, y[here, None]]) for here, A in _columns(meaning, record, rows))
    sums = neighbour_sums(blocks, runs(record.starts, used))
    wide = np.kron(np.eye(knots), totals)
    return WeightsDesign(basis, sums, names, wide, np.zeros(len(wide)))


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
    """The prior's matrix, as good as flat for the offset, the first unknown of every `period`."""
    K = np.array(K)
    offsets = np.arange(0, len(K), period or len(K))
    K[offsets, offsets] = NOTHING * np.trace(K) / len(K)
    return K


def _stretches(used: Bool[np.ndarray, " samples"]) -> Bool[np.ndarray, " samples"]:
    """At most `MANY_ROWS` of the rows, in stretches of neighbours."""
    rows = np.flatnonzero(used)
    if len(rows) <= MANY_ROWS:
        return used
    stretch = np.arange(len(rows)) // SOME_ROWS
    count, kept = int(stretch[-1]) + 1, MANY_ROWS // SOME_ROWS
    taken = np.isin(stretch, np.linspace(0, count - 1, kept).astype(int))
    few = np.zeros_like(used)
    few[rows[taken]] = True
    return few


def slow_loop(base: CompositionUnknowns) -> Float[np.ndarray, "3 unknowns"]:
    """Rows that sum up unknowns to `SUMS`, over `scale`: the second of two loops between the ends of the
    input, so slow that all that relaxes has relaxed and friction by velocity is nothing.

    What drifts does not count.
    """
    up = np.linspace(base.low, base.high, SOME_ROWS + 1)
    loop = np.concatenate([up, up[-2::-1]])
    u = np.concatenate([loop, loop[1:]])
    slowly = 1e7 * max([*base.times, base.step, 1e-9])
    record = Record.from_arrays(u, u, slowly * np.arange(len(u)))
    memory = memory_of(base.memory(), record, np.arange(2 * SOME_ROWS, len(u)))
    columns = base.columns(memory)
    columns[:, np.repeat([False, *(part in DRIFTS for part in base.parts)], base.sizes)] = 0.0
    rising, falling = columns[: SOME_ROWS + 1], columns[: SOME_ROWS - 1 : -1]
    side = -1.0 if base.leading else 1.0
    low, high = falling[0], falling[-1]
    width = side * np.sign(base.scale) * np.trapezoid(falling - rising, dx=1 / SOME_ROWS, axis=0)
    return np.stack([(low + high) / 2, high - low, width])


MOST = 100
"""Models of each ensemble: each is a quadratic problem with signs."""

FIRM = 1 / LITTLE
"""How much firmer the projection holds a sum than the data do."""


# Many small factorisations, for which threads of BLAS only wait.
@threadpool_limits.wrap(limits=1, user_api="blas")
def sample_weights(
    fit: FitResult,
    linear: LinearFit,
    steps: int | None,
    most: int,
    ensembles: int,
    walkers: int,
    seed: int,
    kept: Checkpoint,
    tell: Progress,
) -> Posterior:
    """Draw noise, its correlation and the prior's strength by emcee, and given each the unknowns.

    The unknowns are integrated out of the likelihood, see `WeightsEvidence`. Given the others they are
    Gaussian, about those of the fit: what a model misses is not AR(1) noise, under which the centre may be
    ten times as far from the data. Each draw is projected in its own metric onto the models that can be,
    with no negative weight and no falling branch, and with the sums of the draw that the data determine.

    Source: Everink, Dong, Andersen, Bayesian inference with projected densities, SIAM/ASA J. Uncertainty
    Quantification 11 (2023).
    """
    begin = time.perf_counter()
    design = weights_design(linear, fit.train, fit.used)
    left = fit.residuals * fit.train.weights  # as the sums of the rows have them
    left = neighbour_sums([left[fit.used, None]], runs(fit.train.starts, fit.used))
    evidence = WeightsEvidence(design.sums, left)
    place, root = evidence.place, evidence.root
    first = first_walkers(evidence, place, root, ensembles, walkers, seed)
    chains = sample_ensembles(evidence, first, place, root, seed, steps, most, kept, tell)
    thinned, count = chains.thinned, min(steps or MOST, MOST)
    points = thinned[:, np.linspace(0, thinned.shape[1] - 1, count).astype(int)]
    scale = linear.meaning.scale
    given = _Given(linear, design, evidence.place)
    flat = points.reshape(-1, points.shape[-1])
    random = np.random.default_rng([seed, ensembles])
    unknowns = np.empty((len(flat), len(linear.unknowns)))
    for k, point in enumerate(flat):
        unknowns[k] = given.drawn(point, random)
        if k % 20 == 0:
            tell(k, len(flat), "weights")
    sums = in_units(linear.meaning, unknowns) @ design.totals[given.determined].T
    names = tuple(np.array(design.names)[given.determined].tolist())
    draws = np.hstack([sums, evidence.in_units(flat, scale)]).reshape(*points.shape[:2], -1)
    # Given noise and strength the unknowns are independent draws, so theirs is the R-hat of those.
    agreement, ess = float(chains.rhat.max()), min(float(len(flat)), float(chains.ess.min()))
    summaries = [summary_of(name, draws[..., j], ess, agreement) for j, name in enumerate(names)]
    found = posterior_of(
        evidence.names, chains, partial(evidence.in_units, scale=scale), lambda _: None,
        np.array(PRIOR_VARIANCE), begin,
    )  # fmt: skip
    return replace(
        found,
        names=(*names, *evidence.names),
        draws=draws,
        model=linear.meaning.model(unknowns),
        summaries=(*summaries, *found.summaries),
        method=f"{chains.method}; weights projected",
        seconds=time.perf_counter() - begin,
        notes=(*chains.notes, *_left_open(design, given.determined)),
        log_probability=evidence(flat).reshape(points.shape[:2]),
    )


def _left_open(design: WeightsDesign, determined: Bool[np.ndarray, " sums"]) -> tuple[str, ...]:
    left = [name for name, known in zip(design.names, determined, strict=True) if not known]
    if not left:
        return ()
    return (
        f"the data do not determine {', '.join(left)}: the prior says more of each than they do, so they"
        " are not among the parameters.",
    )


class _Given:
    """Draws of the unknowns given noise and prior strength.

    - `determined`: which of the design's sums the data know rather than the prior, at the likeliest noise
      and strength. At most half of the variance c'G c is the prior's, c'G (H - H_d) G c, with G the inverse
      of H and H_d the H without the prior; or, of `SUMS`, its deviation is less than `PART` of the prior's.
    """

    def __init__(
        self, linear: LinearFit, design: WeightsDesign, place: Float[np.ndarray, " 3"]
    ) -> None:
        self.linear, self.design = linear, design
        self.U, self.known = design.basis.directions, design.basis.known
        self._sums = design.sums.moved(design.basis.dual)
        factor, strength = self._normal(place)
        along = design.totals @ self.U
        solved = scipy.linalg.solve_triangular(factor, along[:, : self.known].T, lower=True)
        of_known = (solved**2).sum(0)
        variance = of_known + (along[:, self.known :] ** 2).sum(1) / strength
        back = scipy.linalg.solve_triangular(factor.T, solved)
        of_prior = strength * (back**2).sum(0) + (along[:, self.known :] ** 2).sum(1) / strength
        before = (along**2).sum(1) / strength
        bare = [name.partition(" at ")[0] for name in design.names]  # without that of a condition
        narrow = np.isin(bare, SUMS) & (variance < PART**2 * before)
        self.determined: Bool[np.ndarray, " sums"] = (of_prior <= 0.5 * variance) | narrow
        held = design.totals[self.determined]
        firmly = FIRM / np.maximum(variance[self.determined], 1e-300)
        self._held = (held.T * firmly) @ held
        self._shift = (held.T * firmly) @ design.shift[self.determined]

    def drawn(
        self, point: Float[np.ndarray, " 3"], random: np.random.Generator
    ) -> Float[np.ndarray, " unknowns"]:
        """One draw: the unknowns of a model that are nearest to it by its precision."""
        noise = random.normal(size=len(self.U)) * np.exp(point[0]) / np.sqrt(self.design.sums.rows)
        factor, strength = self._normal(point)
        away = noise / np.sqrt(strength)
        away[: self.known] = scipy.linalg.solve_triangular(factor.T, noise[: self.known])
        H = jittered(self._under(point) + self._held)  # a drawn prior may be next to none
        x = self.linear.unknowns + self.U @ away
        shift = self._shift * (1 + random.normal())  # as uncertain as it is large
        return self.linear.meaning.minimum(H, H @ x + shift, x > 0)

    def _under(self, point: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "unknowns unknowns"]:
        """The precision of all unknowns given noise and strength, times the noise's variance over N."""
        H = self._sums.under(float(np.tanh(point[1] / 2))) / self._sums.rows
        return H + float(np.exp(point[2])) * self.design.basis.prior

    def _normal(
        self, point: Float[np.ndarray, " 3"]
    ) -> tuple[Float[np.ndarray, "known known"], float]:
        """Of the known directions: the Cholesky factor of U'A'V^-1 A U / N + strength, and the strength."""
        H = self.design.sums.under(float(np.tanh(point[1] / 2)))[:-1, :-1] / self.design.sums.rows
        strength = float(np.exp(point[2]))
        return scipy.linalg.cholesky(H + strength * np.eye(self.known), lower=True), strength
