"""Where the next measurement would lie, and whether held-out ones do."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float, Int

from hysteresis import AbstractModel, Record

from .._levels import CHANCE, CONFIDENCE, ROUNDING, SOME_ROWS
from ..noise._model import NoiseModel, rows_of
from ..noise._reml import PARTS
from ..noise._residual_statistics import estimate_noise
from ..records._folds import BLOCKS_OF_FOLD
from ..records._new_record import going_on, prepare
from ..results._fit_result import FitResult
from ..results._repeatability import cycles_or_sequences
from ._log_posterior import likeliest_near, target
from ._posterior import Posterior
from ._sample import sample

LEVELS = (0.5, CONFIDENCE, 1 - CHANCE)
DRAWS = 100
"""Draws of the model, at most."""


class Bands(NamedTuple):
    """Posterior predictive bands over some `rows` of a record.

    - `measured`, `middle` (rows,): readings, and the median prediction.
    - `low`, `high` (levels, rows): of a new reading, for each of `LEVELS`; `clean_low`, `clean_high`: of
      the output without noise.
    - `coverage` (levels,): share of the readings inside. `cycles`: the same by cycle, or by sequence
      where there are several.
    - `effective`: as how many independent readings they count. `said`: whether 90 % hold 90 %.
    """

    rows: Int[np.ndarray, " rows"]
    measured: Float[np.ndarray, " rows"]
    middle: Float[np.ndarray, " rows"]
    low: Float[np.ndarray, "levels rows"]
    high: Float[np.ndarray, "levels rows"]
    clean_low: Float[np.ndarray, "levels rows"]
    clean_high: Float[np.ndarray, "levels rows"]
    coverage: Float[np.ndarray, " levels"]
    cycles: dict[str, Float[np.ndarray, " levels"]]
    effective: float
    said: str


def predictive(
    fit: FitResult, record: Record | None = None, posterior: Posterior | None = None
) -> Bands:
    """Bands of new readings on a record, whatever its own readings are.

    Every draw of the parameters, posterior's or Laplace's where there is no posterior, predicts a
    noise-free output and the noise's marginal scale, which may grow with the reading. A band's end is the
    quantile of the equal mixture of all draws' distributions, so it is smooth and the same every time.
    With Student's t the mixture is of t's, as if correlated residuals had the innovations' tails.

    Of rows that were not fitted a model errs by more than its noise: there the variance is that of the
    held-out parts of the fit at least. What is missing of it is added to the noise's, and the tails are
    those of Student's t: a part, which rises and falls, counts as two facts on it, on noise any number
    (Welch and Satterthwaite).

    Neighbouring rows are no independent facts: as many count as `Noise` says of the residuals, and with
    so many the coverage that would be no surprise is told, 95 % of a binomial's.

    **Arguments:**

    - `record`: as the model sees it; the held-out rows unless given, or the fitted ones where there are
      none.
    - `posterior`: of this fit.

    **Example:**

        >>> bands = identify.predictive(fit)
        >>> identify.LEVELS, bands.low.shape
        ((0.5, 0.9, 0.99), (3, 20))
    """
    if record is None:
        record = fit.train if fit.test is None else fit.test
    held_out = record is not fit.train
    if posterior is None and fit.detail.is_linear:
        posterior = sample(fit, steps=DRAWS // 4, ensembles=4, seed=fit.seed)
    models, noise = _drawn(fit) if posterior is None else _chosen(posterior)
    counted = np.flatnonzero(record.mask)
    rows = counted[:: -(-len(counted) // SOME_ROWS)]
    # All draws of a model prepare an input alike.
    models, one = _widened(models, record)
    prepared = prepare(one, record)
    of_rows = rows_of(record, record.mask, np.zeros(len(record)))
    if (
        record.sigma is not None and fit.train.sigma is not None
    ):  # of the weights that the noise is of
        of_rows = of_rows._replace(weight=fit.train.typical_sigma / record.sigma)
    y, scale = (np.asarray(a) for a in _evaluate(models, noise, prepared, of_rows, rows))
    tail = None if noise.tail is None else np.asarray(noise.tail)
    own = float(np.mean(y.var(0) + scale**2))
    blocks = () if fit.blocks is None or not held_out else fit.blocks
    if len(blocks) and (found := float(np.mean(blocks))) > own:
        scale = np.sqrt(scale**2 + found - own)
        facts = 2 * len(blocks) / BLOCKS_OF_FOLD
        heavier = np.full(len(y), (1 - own / found) ** 2 / facts)
        tail = heavier if tail is None else np.maximum(tail, heavier)
    ends = [0.5, *((1 + sign * level) / 2 for sign in (-1, 1) for level in LEVELS)]
    middle, *bands = (_quantile(q, y, scale, tail) for q in ends)
    low, high = np.split(np.array(bands), 2)
    clean_low, clean_high = np.split(np.quantile(y, ends[1:], axis=0), 2)
    measured = record.output[rows]
    inside = (low <= measured) & (measured <= high)
    names, which = cycles_or_sequences(record)
    which = which[rows]
    cycles = {names[k]: inside[:, which == k].mean(1) for k in np.unique(which[which > 0])}
    sequences = np.flatnonzero(np.diff(np.searchsorted(record.starts, rows, side="right"))) + 1
    residuals = [part for part in np.split(middle - measured, sequences) if len(part)]
    coverage, effective = inside.mean(1), estimate_noise(residuals).effective
    said = _in_words(coverage, effective, len(rows), "held-out" if held_out else "training")
    return Bands(
        rows, measured, middle, low, high, clean_low, clean_high, coverage, cycles, effective, said
    )


def _drawn(fit: FitResult) -> tuple[Any, NoiseModel]:
    """Draws about the likelihood's maximum, Gaussian with its curvature; what the data leave open moves
    by one in the free space, a factor of e, within which a curvature may mean something."""
    aim = target(fit)
    count = len(aim.names)
    top = likeliest_near(aim, aim.start, jnp.ones(count, bool), jnp.ones(len(aim.measured)))
    values, vectors = np.linalg.eigh(np.asarray(top.curvature))
    random = np.random.default_rng(fit.seed).normal(size=(DRAWS, count))
    away = random / np.sqrt(np.maximum(values, 1.0)) @ vectors.T
    points = jnp.asarray(np.asarray(top.point) + away)
    return jax.vmap(aim.model)(points), jax.vmap(aim.noise)(points)


def _widened(models: Any, record: Record) -> tuple[Any, AbstractModel]:
    """All draws, each continued beyond the inputs of the fit as `FitResult.predict` does, and the first."""
    drawn = len(jax.tree.leaves(models)[0])
    first: AbstractModel = jax.tree.map(lambda leaf: leaf[0], models)
    wide = going_on(first, record)
    if [*map(jnp.shape, jax.tree.leaves(wide))] == [*map(jnp.shape, jax.tree.leaves(first))]:
        return models, first
    each = [going_on(jax.tree.map(lambda leaf, k=k: leaf[k], models), record) for k in range(drawn)]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *each), wide


def _chosen(posterior: Posterior) -> tuple[Any, NoiseModel]:
    """Some draws of a posterior."""
    flat = posterior.draws.reshape(-1, len(posterior.names))
    chosen = np.unique(np.linspace(0, len(flat) - 1, min(DRAWS, len(flat))).astype(int))
    noise: dict[str, Any] = {
        part: flat[chosen, posterior.names.index(part)] for part in PARTS if part in posterior.names
    }
    return jax.tree.map(lambda leaf: leaf[chosen], posterior.model), NoiseModel(**noise)


@eqx.filter_jit
def _evaluate(
    models: Any, noise: NoiseModel, prepared: Any, of_rows: Any, rows: Any
) -> tuple[Array, Array]:
    def one(drawn: Any) -> tuple[Array, Array]:
        model, noise = drawn
        y = model.evaluate(prepared)
        return y[rows], noise.scale(of_rows._replace(output=y))[rows]

    return jax.lax.map(one, (models, noise), batch_size=10)


def _quantile(
    q: float,
    y: Float[np.ndarray, "draws rows"],
    scale: Float[np.ndarray, "draws rows"],
    tail: Float[np.ndarray, " draws"] | None,
) -> Float[np.ndarray, " rows"]:
    """Of the mixture of all draws: it lies between the least and the greatest of theirs."""
    each = scipy.special.ndtri(q) if tail is None else scipy.special.stdtrit(1 / tail, q)[:, None]
    ends = y + scale * each
    low, high = ends.min(0), ends.max(0)
    for _ in range(round(-np.log2(ROUNDING))):
        at = (low + high) / 2
        x = (at - y) / scale
        below = scipy.special.ndtr(x) if tail is None else scipy.special.stdtr(1 / tail[:, None], x)
        over = below.mean(0) > q
        low, high = np.where(over, low, at), np.where(over, at, high)
    return (low + high) / 2


def _binomial(q: float, n: int, p: float) -> float:
    """Quantile of the binomial distribution; `scipy.stats`, which has one, takes a second to load."""
    k = float(np.ceil(scipy.special.bdtrik(q, n, p)))
    below = max(k - 1, 0.0)
    return below if scipy.special.bdtr(below, n, p) >= q else k


def _in_words(coverage: np.ndarray, effective: float, rows: int, word: str) -> str:
    held, level, facts = float(coverage[1]), LEVELS[1], max(round(effective), 1)
    low, high = (_binomial(q, facts, level) / facts for q in (0.025, 0.975))
    said = (
        f"The {100 * level:.0f} % band holds {100 * held:.0f} % of {rows:,} {word} rows, which count as"
        f" {facts:,}: {100 * low:.0f} to {100 * high:.0f} % would be no surprise."
    )
    # A few facts may all lie outside nine tenths by chance, but not outside 99 hundredths.
    least = [_binomial(0.0125, facts, p) / facts for p in LEVELS[1:]]
    if (coverage[1:] < least).any():
        said += " It is too narrow: the model is off by more than noise there."
    elif held > high:
        said += " It is wider than need be."
    return said if word == "held-out" else f"{said} These rows were fitted, so that proves little."
