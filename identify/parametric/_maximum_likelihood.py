"""Maximum likelihood of parameters and noise together, with the kind of noise chosen by evidence."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._levels import CHANCE, ENOUGH_ROWS, LITTLE, NOTHING, STEPS
from ..noise._arithmetic import Arithmetic, Rows
from ..noise._model import Left, NoiseModel, believed, nothing_speaks_against
from ..noise._reml import Linearised, noise_fit, of_free
from ..noise._reml import score as own_score
from ..noise._residual_statistics import Noise, widening
from ..parameters._transform import Transform
from ._multistart import Optimum, Problem
from ._standard_errors import Skewness, points_about, skewness

FIRST, HOPELESS = 2, CHANCE / 100
"""After FIRST rounds the search stops where the adequacy test of the residuals has a smaller p-value."""

STEP = 1.0
"""Largest change of an unconstrained parameter in one round."""

PLAIN = (("sigma",), ("sigma", "phi"), ("sigma", "phi", "theta"))
"""Kinds that are tried before the others: Gaussian and of one size, independent or correlated."""

IMPOSSIBLE = 1e-40
"""p-value of what the best plain kind leaves, below which tails and growth do not explain it either. They
change the statistics of the test by a factor, not by orders of magnitude."""


class Likeliest(NamedTuple):
    """The maximum of the likelihood.

    - `free`: the model's parameters in unconstrained space. `root`: root'root is the Fisher information
      there. `wider`: factor on each standard error because the noise model itself is estimated.
    - `noise`: the noise model of the kind chosen. `evidence`: -log evidence of each kind tried.
    - `believed`: p-value of the adequacy test of the residuals under that noise. `rows`: number of rows
      used. `converged`: whether the last round moved by less than a tolerance.
    """

    free: Float[np.ndarray, " parameters"]
    root: Float[np.ndarray, "rows parameters"]
    wider: Float[np.ndarray, " parameters"]
    noise: NoiseModel
    evidence: dict[tuple[str, ...], float]
    believed: float
    rows: int
    converged: bool = True

    @property
    def over_the_best(self) -> dict[str, float]:
        """-log evidence of each kind of noise, by its name, minus the least."""
        least = min(self.evidence.values())
        some = ((NoiseModel(**dict.fromkeys(k, 0.0)), e) for k, e in self.evidence.items())
        return {one.words: e - least for one, e in some}

    def summary(self) -> Noise:
        """Standard deviation and correlation time; of Student's t the deviation, not the scale."""
        noise = self.noise
        tail = 0.0 if noise.tail is None else float(noise.tail)
        time = max(float(noise.correlation_time), 1.0)
        return Noise(float(noise.sigma) / np.sqrt(1 - 2 * tail), self.rows, time)


def likeliest(
    problem: Problem,
    rows: Rows,
    free: Float[np.ndarray, " parameters"],
    kinds: tuple[tuple[str, ...], ...],
    temper: float = 1.0,
) -> Likeliest | None:
    """Go from a least-squares fit to the maximum likelihood, and choose the kind of noise by evidence.

    Each round linearises the model, estimates noise and parameters together for every kind (`noise_fit`),
    and moves to the parameters of the kind with the greatest evidence. The evidence is the restricted
    likelihood with the penalty of BIC: half of log(rows) for each part of the noise. In a long record the
    first rows choose the kind. Plain kinds come first, and the others only where something speaks against
    the best of them. The rounds stop early where even the best kind fails the adequacy test.

    `temper`: number of rows that count as one, relative to user-specified priors. Returns None where the
    rounds do not reach a maximum.
    """
    z, least, choice, bounds = np.asarray(free), np.inf, len(kinds) > 1, problem.bounds
    near: dict[tuple[str, ...], np.ndarray] = {}
    evidence: dict[tuple[str, ...], float] = {}
    for k in range(1, STEPS + 1):
        at = linearised_at(problem, rows, z)
        at = at._replace(pull=temper * at.pull, precision=temper * at.precision)
        if choice and k == 1:
            few = at
            if len(at.residuals) > ENOUGH_ROWS:
                first_rows = Rows(*(x[:ENOUGH_ROWS] for x in at.rows))
                few = at._replace(
                    residuals=at.residuals[:ENOUGH_ROWS],
                    jacobian=at.jacobian[:ENOUGH_ROWS],
                    rows=first_rows,
                )
            kinds = _worth_trying(few, kinds, near)
            if not kinds:
                return None
            first = likeliest_about(few, kinds, near)
            evidence = first.evidence
            if few is not at:
                if first.believed(few) < CHANCE:
                    return None
                kinds = (first.kind,)
            # What is that far behind stays there when the model is linearised anew.
            kinds = tuple(
                one for one in kinds if evidence[one] < min(evidence.values()) - np.log(NOTHING)
            )
        now = likeliest_about(at, kinds, near)
        if len(kinds) > 1 or not choice:
            evidence = evidence | now.evidence
        root = now.left.root(np.asarray(at.precision))
        cost = float(now.cost + temper * (bounds.penalty(jnp.asarray(z)) if bounds.asked else 0.0))
        moved, least = float(np.linalg.norm(root @ now.away)), min(least, cost)
        if not moved > NOTHING:  # standard deviations; not a number neither
            break
        if k == FIRST and choice and now.believed(at) < HOPELESS:
            break
        z = z + now.away * min(1.0, STEP / float(np.max(np.abs(now.away))))
    if not np.isfinite(moved) or cost > least + 1:
        return None
    return Likeliest(
        z, root, widening(at, now.noise, now.kind), model_of(now.noise, now.kind), evidence,
        now.believed(at), int(np.sum(rows.counted)), moved < LITTLE,
    )  # fmt: skip


class About(NamedTuple):
    """Maximum likelihood of noise and parameters of a linearised model.

    - `kind`: the kind of noise with the greatest evidence. `evidence`: -log evidence of each kind.
    - `noise`: its parameters in unconstrained space. `away`: the change of the model's parameters that
      goes with it. `cost`: -log of the restricted likelihood, with the prior relative to its value at the
      point of linearisation.
    - `left`: what that noise leaves, whitened.
    """

    kind: tuple[str, ...]
    evidence: dict[tuple[str, ...], float]
    noise: Float[np.ndarray, " parts"]
    away: Float[np.ndarray, " parameters"]
    cost: float
    left: Left

    def believed(self, at: Linearised) -> float:
        """p-value of the adequacy test of the residuals."""
        return believed(self.left, at.rows.place, self.spent)

    @property
    def spent(self) -> int:
        """How many of phi and theta the noise has."""
        return len({"phi", "theta"} & set(self.kind))


def likeliest_about(
    at: Linearised,
    kinds: tuple[tuple[str, ...], ...],
    near: dict[tuple[str, ...], np.ndarray],
) -> About:
    """Estimate every kind of noise. `near` has the last estimate of each, where the next one starts."""
    found = []
    for kind in kinds:
        # A new kind starts from the last one that lacks one of its parts.
        simpler = [one for one in near if len(one) == len(kind) - 1 and set(one) < set(kind)]
        found.append(noise_fit(at, kind, near.get(kind, near[simpler[-1]] if simpler else None)))
        near[kind] = found[-1].free
    parts = np.array([len(kind) for kind in kinds])
    evidence = np.array([one.cost for one in found])
    evidence = evidence + parts * np.log(np.count_nonzero(at.rows.counted)) / 2
    evidence = np.where(np.isfinite(evidence), evidence, np.inf)
    best = int(np.argmin(evidence))
    free, away, cost = found[best]
    noise = of_free(free, kinds[best])
    W = np.asarray(noise.whitened(at.jacobian, at.rows))
    x = np.asarray(noise.whitened(at.residuals, at.rows))
    if noise.misfit is not None:
        # The misfit has taken up these shapes, so the test need not look for them.
        x = np.asarray(noise.without_misfit(x, at.rows))
        values, vectors = np.linalg.eigh(noise.information_of(at.jacobian, at.rows))
        W = vectors.T * np.sqrt(np.maximum(values, 0.0))[:, None]
        shapes = np.asarray(at.rows.shapes)[:, :0]
    else:
        shapes = np.asarray(noise.whitened(at.rows.shapes, at.rows))
    left = Left(x, W, shapes, np.asarray(noise.information))
    of_kinds = dict(zip(kinds, evidence.tolist(), strict=True))
    return About(kinds[best], of_kinds, free, away, cost, left)


def _worth_trying(
    at: Linearised, kinds: tuple[tuple[str, ...], ...], near: dict[tuple[str, ...], np.ndarray]
) -> tuple[tuple[str, ...], ...]:
    """The plain kinds where nothing speaks against the best of them, none where no kind can explain the
    residuals, else all."""
    plain = tuple(kind for kind in kinds if kind in PLAIN)
    if not plain:
        return kinds
    first = likeliest_about(at, plain, near)
    if first.believed(at) < IMPOSSIBLE:
        return ()
    return plain if nothing_speaks_against(first.left, at.rows, first.spent) else kinds


def plainest(
    free: Float[np.ndarray, " parameters"],
    residuals: Float[np.ndarray, " rows"],
    jacobian: Float[np.ndarray, "rows parameters"],
    rows: Rows,
) -> tuple[Likeliest, Left]:
    """Independent Gaussian noise at a least-squares fit, in closed form: sigma^2 = sum of squares / (rows -
    parameters). Its own uncertainty multiplies variances by cosh(2 sd of log sigma), see `widening`."""
    counted, weight = int(np.sum(rows.counted)), np.asarray(rows.weight)
    residuals, jacobian = residuals * weight, jacobian * weight[:, None]
    sigma = float(np.sqrt(residuals @ residuals / max(counted - len(free), 1)))
    x, W = residuals / (sigma or 1.0), jacobian / (sigma or 1.0)
    scores = np.sum((x**2 - 1)[np.asarray(rows.counted)] ** 2)
    wider = np.full(len(free), np.sqrt(np.cosh(2 / np.sqrt(1 + scores))))
    left = Left(x, W, np.asarray(rows.shapes) * weight[:, None], np.ones(()))
    return Likeliest(free, W, wider, NoiseModel(sigma), {("sigma",): 0.0}, 1.0, counted), left


def linearised(problem: Problem, at: Optimum, rows: Rows) -> Linearised:
    """The model linearised where its output and the Jacobian are known."""
    bounds = problem.bounds
    residuals = np.where(np.asarray(rows.counted), at.predicted - problem.measured, 0.0)
    pull, precision = np.zeros(len(at.free)), np.zeros((len(at.free),) * 2)
    if bounds.asked:
        pull, precision = map(np.asarray, _slopes_of_penalty(bounds, jnp.asarray(at.free)))
    rows = rows._replace(output=at.predicted)
    return Linearised(residuals, at.jacobian, rows, pull, precision)


def linearised_at(problem: Problem, rows: Rows, z: Float[np.ndarray, " parameters"]) -> Linearised:
    """The model linearised about z, by the program that fits it."""
    weights = np.where(rows.counted, rows.weight, 0.0)
    return linearised(problem, problem.refined(weights, z, steps=1), rows)


@eqx.filter_jit
def _slopes_of_penalty(bounds: Transform, z: Array) -> tuple[Array, Array]:
    """Gradient and Hessian of the priors' penalty."""
    return jax.grad(bounds.penalty)(z), jax.hessian(bounds.penalty)(z)


def skewness_at(
    problem: Problem,
    rows: Rows,
    noise: NoiseModel,
    free: Float[np.ndarray, " parameters"],
    covariance: Float[np.ndarray, "parameters parameters"],
    weight: float,
) -> Skewness:
    """Skewness of weighted log-likelihood plus log-prior, noise fixed."""
    known, scores = noise.arithmetic(), []
    for z in points_about(free, covariance):
        # One after the other: of a million rows each takes 60 MB.
        at = linearised_at(problem, rows, z)
        with np.errstate(divide="ignore", invalid="ignore"):  # an exact fit has no noise
            scores.append(weight * score(at, problem.measured, known) - at.pull)
        del at
    return skewness(np.array(scores), covariance)


def model_of(free: Float[np.ndarray, " parts"], kind: tuple[str, ...]) -> NoiseModel:
    """The noise model of unconstrained parameters."""
    noise = of_free(free, kind)
    parts: dict[str, Any] = {part: np.asarray(getattr(noise, part)) for part in kind}
    return NoiseModel(**parts)


def score(
    at: Linearised, measured: Float[np.ndarray, " rows"], noise: Arithmetic
) -> Float[np.ndarray, " parameters"]:
    """The gradient of the log-likelihood with respect to z."""
    J, r = np.asarray(at.jacobian), np.asarray(at.residuals)
    if noise.growth is None and noise.misfit is None:
        W = np.asarray(noise.whitened(np.column_stack([r, J]), at.rows))
        return -W[:, 1:].T @ own_score(noise, W[:, 0])
    # The size of the noise follows the output, too: differences along every parameter.
    size = np.sqrt(np.sum(np.asarray(noise.whitened(J, at.rows)) ** 2, 0))
    h = 1e-4 / np.where(size > 0, size, 1.0)

    def likelihood(r: np.ndarray) -> float:
        return float(noise.log_likelihood(r, at.rows._replace(output=measured + r)))

    return np.array(
        [
            (likelihood(r + s * c) - likelihood(r - s * c)) / (2 * s)
            for s, c in zip(h, J.T, strict=True)
        ]
    )
