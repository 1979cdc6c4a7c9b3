"""What a Preisach fit says of the sums of its weights: their covariance, and which the data determine."""

from typing import NamedTuple

import numpy as np
import scipy.linalg
from jaxtyping import Bool, Float

from ..noise._correlated_noise import noise_behind, spread_over_rows
from ._preisach_normal_equations import gathered
from ._preisach_problem import PreisachProblem


class KnownSums(NamedTuple):
    """Of the rows of `GridUnknowns.sums`, over scale.

    - `covariance`: of the sums. `determined`: which of them the data know rather than the prior.
    - `shift`: how far a prior of a tenth of the strength moves them.
    """

    covariance: Float[np.ndarray, "sums sums"]
    determined: Bool[np.ndarray, " sums"]
    shift: Float[np.ndarray, " sums"]


def known_sums(
    problem: PreisachProblem,
    which: tuple[int, ...],
    strength: float,
    x: Float[np.ndarray, " unknowns"],
) -> KnownSums:
    """What a fit of some parts knows of the sums C x of its unknowns.

        covariance = K' (A' W V W A sigma^2 / N^2 + d d') K,      K = G C',      d = H (x_(lambda / 10) - x)

    W weighs the rows, G is the inverse of H among the unknowns that are not zero. The noise, AR(1) with the
    correlations V, is that behind the residuals. The second term is the bias: how far the unknowns move
    under a prior of a tenth of the strength. Strengths are chosen by held-out errors, and a strong one that
    predicts well moves sums by up to two standard errors.

    A sum is determined if c'G H_d G c >= c'G c / 2, with H_d the H without the prior.
    """
    meaning = problem.meaning
    chosen = np.isin(problem.parts.label, which)
    w = problem.weights[chosen, None]
    rows = int(chosen.sum())
    H, b = problem.objective(which, strength)
    inside = np.flatnonzero((x != 0) | meaning.free)
    at = np.ix_(inside, inside)
    factor = scipy.linalg.cho_factor(H[at])
    C = meaning.sums[:, inside]
    K = scipy.linalg.cho_solve(factor, C.T, check_finite=False)

    def over_all(among: Float[np.ndarray, "inside batch"]) -> np.ndarray:
        found = np.zeros((len(x), among.shape[1]))
        found[inside] = among
        return found

    def left(noise: np.ndarray) -> np.ndarray:
        """What the fit leaves of noise, the signs of its unknowns held."""
        values, turned = np.zeros((len(chosen), noise.shape[1])), 0.0
        values[chosen] = w * noise
        for block in problem.blocks():
            turned = turned + block.transposed(values[block.rows])
        moved = gathered(meaning.space, turned, meaning.expansion)[inside] / rows
        followed = problem.outputs(over_all(scipy.linalg.cho_solve(factor, moved)))
        return noise - w * followed[chosen]

    # One pass over the rows: the fit itself, and what each sum reads of them.
    found = w * problem.outputs(np.hstack([x[:, None], over_all(K)]))[chosen]
    sequences = runs(problem.starts, chosen)
    noise = noise_behind(w[:, 0] * problem.y[chosen] - found[:, 0], left, sequences)
    read = found[:, 1:]
    spread = noise.sigma**2 / rows**2 * (read.T @ spread_over_rows(read, noise.phi, sequences))
    H_weaker = H[at] - 0.9 * strength * problem.prior[at]
    weaker = over_all(scipy.linalg.solve(H_weaker, b[inside], assume_a="pos")[:, None])[:, 0]
    bias = K.T @ (H @ (weaker - x))[inside]
    of_prior = np.einsum("is,ij,js->s", K, strength * problem.prior[at], K)
    determined = of_prior <= 0.5 * np.einsum("si,is->s", C, K)
    return KnownSums(spread + np.outer(bias, bias), determined, bias)


def runs(starts: np.ndarray, chosen: Bool[np.ndarray, " samples"]) -> list[slice]:
    """Among the chosen rows, those of one sequence that follow one another without a gap."""
    rows = np.flatnonzero(chosen)
    new = np.append(True, (np.diff(rows) > 1) | np.isin(rows[1:], starts))
    first = np.flatnonzero(new)
    return [slice(*ends) for ends in zip(first, [*first[1:], len(rows)], strict=True)]
