"""The marginal likelihood of noise and prior strength of a linear fit, its weights integrated out.

With the columns A, AR(1) noise of the correlations V and the prior's matrix K,

    y ~ N(A x, sigma^2 V),      x ~ N(0, sigma^2 / (N strength) K^-1),      the offset flat.

In the basis U with U'K U = 1 and U'A'A U diagonal the data say something along a few directions only, and
V^-1 needs no more of the rows than `NeighbourSums`. At each of some correlations the normal matrix has the
eigenvalues d_j and the projections c_j of A'V^-1 y, so that

    log p = -[ N log sigma^2 + log det V + sum log(1 + d_j / (N strength))
               + (y'V^-1 y - sum c_j^2 / (d_j + N strength)) / sigma^2 + log(N strength / sigma^2) ] / 2,

which is interpolated in atanh phi, what is in the last round brackets over sigma^2 by its logarithm.

Source: MacKay, Bayesian interpolation, Neural Computation 4 (1992); Rasmussen, Williams, Gaussian Processes
for Machine Learning (2006), section 5.4.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
import scipy.optimize
from jaxtyping import Float

from .._levels import FACTOR, PRIOR_STRENGTHS, ROUNDING, SURE

# Sums over rows from which the normal equations under AR(1) noise follow for any correlation.


class NeighbourSums(NamedTuple):
    """Sums over rows b_i that follow one another in sequences:

        same = sum of b_i b_i',      next = sum of b_i b_(i+1)' + b_(i+1) b_i',
        ends = sum of b b' over the first and the last row of each sequence.

    The inverse of the covariance V_ij = phi^|i - j| of AR(1) noise of unit variance is tridiagonal, so that

        B' V^-1 B = ((1 + phi^2) same - phi next - phi^2 ends) / (1 - phi^2),
        log det V = (rows - sequences) log(1 - phi^2).
    """

    same: Float[np.ndarray, "columns columns"]
    next: Float[np.ndarray, "columns columns"]
    ends: Float[np.ndarray, "columns columns"]
    rows: int
    sequences: int

    def under(self, phi: float) -> Float[np.ndarray, "columns columns"]:
        """B' V^-1 B."""
        found = (1 + phi**2) * self.same - phi * self.next - phi**2 * self.ends
        return found / (1 - phi**2)

    def moved(self, by: Float[np.ndarray, "moved _"]) -> "NeighbourSums":
        """Those of M b_i, b_i without its last column."""
        same, following, ends = (by @ one[:-1, :-1] @ by.T for one in self[:3])
        return NeighbourSums(same, following, ends, self.rows, self.sequences)


def neighbour_sums(
    blocks: Iterable[Float[np.ndarray, "rows columns"]], sequences: Sequence[slice]
) -> NeighbourSums:
    """Those of rows that come in blocks, the `sequences` being slices of all of them."""
    rows = max((each.stop for each in sequences), default=0)
    first, last = np.zeros(rows, bool), np.zeros(rows, bool)
    first[[each.start for each in sequences]] = True
    last[[each.stop - 1 for each in sequences]] = True
    same, following, ends = 0.0, 0.0, 0.0
    begin, before = 0, 0.0
    for block in blocks:
        here = slice(begin, begin + len(block))
        same = same + block.T @ block
        for at in (first[here], last[here]):
            ends = ends + block[at].T @ block[at]
        goes_on = ~first[here]
        behind = np.vstack([before + np.zeros_like(block[:1]), block[:-1]])
        crossed = behind[goes_on].T @ block[goes_on]
        following = following + crossed + crossed.T
        begin, before = here.stop, block[-1:]
    return NeighbourSums(
        np.asarray(same), np.asarray(following), np.asarray(ends), rows, len(sequences)
    )


DECADES = np.log(FACTOR)
"""Deviation of the logarithms of sigma, about the output's range, and of the strength, about `USUAL`."""

PRIOR_VARIANCE = (float(DECADES**2), float(np.pi**2 / 3), float(DECADES**2))
"""Of the prior: phi is uniform between -1 and 1, so 2 atanh phi has a logistic distribution."""

USUAL = PRIOR_STRENGTHS[len(PRIOR_STRENGTHS) // 2]
"""Median of the prior of the strength."""

STRENGTHS = np.log(USUAL) + DECADES * np.linspace(-2, 2, 100)
"""Logarithms of the strengths that the readings are asked about: two deviations of the prior either way."""

ENDS = (-2.0, 4.0)
"""Of atanh phi, at most."""

NEAR, STEP = 10.0, 0.5
"""Correlations are close together within so many deviations of the likeliest, and so far apart there."""

COARSE = 10
"""Correlations between the ends."""

Points = Float[np.ndarray, "points 3"]


class Basis(NamedTuple):
    """Directions U with U'K U = 1, U'A'A U diagonal; those that the data know come first.

    - `directions` (unknowns, unknowns); `known`: how many the data know.
    - `dual`: K U of the known ones. `prior`: K.
    """

    directions: Float[np.ndarray, "unknowns unknowns"]
    known: int
    dual: Float[np.ndarray, "unknowns known"]
    prior: Float[np.ndarray, "unknowns unknowns"]


def basis_of(
    H: Float[np.ndarray, "unknowns unknowns"], K: Float[np.ndarray, "unknowns unknowns"]
) -> Basis:
    """The basis of the normal matrix H, a mean over rows, and the prior's K."""
    values, U = scipy.linalg.eigh(H, K, check_finite=False)
    values, U = values[::-1], U[:, ::-1]
    known = max(int((values > ROUNDING).sum()), 1)
    return Basis(U, known, K @ U[:, :known], K)


class WeightsEvidence:
    """log p(y | log sigma, 2 atanh phi, log strength) plus the log prior, of many points at once.

    - `sums`: of the rows (A U, y), U the known directions. Outputs are in units of their range.
    - `ends`: of atanh phi. `place`, `root`: the mean, and a root of the covariance.

    Noise is no more correlated than what the fit leaves, whose sums are `left`, beyond its standard error
    and what the weights took from it: else a misfit, smooth but for small steps, would be one of
    differences alone.
    """

    names = ("sigma", "phi", "prior.strength")

    def __init__(self, sums: NeighbourSums, left: NeighbourSums) -> None:
        self.sums = sums
        alike = left.next.item() / 2 / max(left.same.item(), 1e-300)
        most = np.arctanh(np.clip(alike, 0.0, np.tanh(ENDS[1])))
        most += SURE / np.sqrt(sums.rows) + (len(sums.same) - 1) / sums.rows
        self.ends = ENDS[0], min(float(most), ENDS[1])
        top, width = self._top()
        near = top + width * np.arange(-NEAR, NEAR + STEP / 2, STEP)
        nodes = np.concatenate(
            [np.linspace(*self.ends, COARSE), near[(near > self.ends[0]) & (near < self.ends[1])]]
        )
        self.nodes: Float[np.ndarray, " nodes"] = np.unique(nodes)
        each = [self._at(float(v)) for v in self.nodes]
        self._values, self._squares, self._yy, self._log_det = (
            np.stack(part) for part in zip(*each, strict=True)
        )
        self.place: Float[np.ndarray, " 3"]
        self.root: Float[np.ndarray, "3 3"]
        self.place, self.root = self._moments(width)

    def __call__(self, points: Points) -> Float[np.ndarray, " points"]:
        """Of every point; -inf beyond the `ends`."""
        log_sigma, z, log_strength = points.T
        v = z / 2
        first = np.clip(np.searchsorted(self.nodes, v) - 2, 0, len(self.nodes) - 4)
        at = first[:, None] + np.arange(4)
        known = self._values[at], self._squares[at], self._yy[at], self._log_det[at]
        # Readings without noise want no prior: beyond these strengths its own prior alone decides.
        limited = np.clip(log_strength, STRENGTHS[0], STRENGTHS[-1])
        spread, left, log_det = self._parts(known, limited[:, None])
        shares = _lagrange(self.nodes[at], v)
        # What is left keeps its sign by its logarithm.
        left, flat = np.exp((shares * np.log(left)).sum(1)), (shares * (spread + log_det)).sum(1)
        with np.errstate(all="ignore"):
            likelihood = 2 * (self.sums.rows - 1) * log_sigma + flat + left * np.exp(-2 * log_sigma)
            value = -0.5 * likelihood + _log_prior(points)
        inside = (v > self.ends[0]) & (v < self.ends[1]) & np.isfinite(value)
        return np.where(inside, value, -np.inf)

    @staticmethod
    def in_units(points: Float[np.ndarray, "*points 3"], scale: float) -> np.ndarray:
        """sigma in the unit of the output, phi, and the prior's strength."""
        values = np.exp(points)
        values[..., 1] = np.tanh(points[..., 1] / 2)
        values[..., 0] *= abs(scale)
        return values

    def _at(self, v: float) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Eigenvalues, squared projections, y'V^-1 y and log det V at atanh phi = v."""
        phi = float(np.tanh(v))
        whole = self.sums.under(phi)
        log_det = (self.sums.rows - self.sums.sequences) * np.log1p(-(phi**2))
        values, vectors = scipy.linalg.eigh(whole[:-1, :-1], check_finite=False)
        along = vectors.T @ whole[:-1, -1]
        return np.maximum(values, 0.0), along**2, whole[-1, -1], float(log_det)

    def _parts(
        self, known: tuple[np.ndarray, ...], log_strength: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Log determinants of the prior, what is left of y'V^-1 y, and log det V."""
        values, squares, yy, log_det = known
        prior = self.sums.rows * np.exp(log_strength)
        total = values + prior[..., None]
        spread = np.log(total / prior[..., None]).sum(-1) + np.log(prior)
        left = np.maximum(yy - (squares / total).sum(-1), 1e-24 * yy)
        return spread, left, log_det

    def _over_strengths(self, v: float) -> tuple[np.ndarray, np.ndarray]:
        """-log p at atanh phi = v and each of `STRENGTHS`, and log sigma where it is least."""
        known = tuple(np.asarray(x)[None] for x in self._at(v))
        spread, left, log_det = self._parts(known, STRENGTHS)
        rows = self.sums.rows - 1
        return 0.5 * (rows * np.log(left) + spread + log_det), 0.5 * np.log(left / rows)

    def _top(self) -> tuple[float, float]:
        """atanh phi of the likeliest noise, whatever its size and the prior, and its deviation."""

        def loss(v: float) -> float:
            return float(self._over_strengths(v)[0].min())

        found: Any = scipy.optimize.minimize_scalar(
            loss,
            bounds=(self.ends[0] + 0.1, self.ends[1] - 0.01),
            method="bounded",
            options={"xatol": 1e-3},
        )
        top, h = float(found.x), 0.05
        curvature = (loss(top + h) + loss(top - h) - 2 * loss(top)) / h**2
        return top, float(1 / np.sqrt(max(curvature, 1.0)))

    def _moments(self, width: float) -> tuple[np.ndarray, np.ndarray]:
        """Mean and a root of the covariance, by sums over the nodes and `STRENGTHS`."""
        loss, log_sigma = np.stack([self._over_strengths(float(v)) for v in self.nodes], 1)
        z, log_strength = np.broadcast_arrays(2 * self.nodes[:, None], STRENGTHS)
        points = np.stack([log_sigma, z, log_strength], -1).reshape(-1, 3)
        log_weight = np.log(np.gradient(self.nodes))[:, None] - loss
        log_weight = log_weight.ravel() + _log_prior(points)
        weight = np.exp(log_weight - log_weight.max())
        # That of sigma given the others, and what lies between neighbouring nodes and strengths.
        inside = [
            0.5 / self.sums.rows,
            *(np.array([2 * STEP * width, np.diff(STRENGTHS)[0]]) ** 2 / 12),
        ]
        covariance = np.cov(points.T, aweights=weight, ddof=0) + np.diag(inside)
        place, root = np.average(points, 0, weight), np.linalg.cholesky(covariance)
        apart = min(float(np.sqrt(covariance[1, 1])), self.ends[1] - self.ends[0])
        place[1] = np.clip(place[1], 2 * self.ends[0] + apart, 2 * self.ends[1] - apart)
        return place, root


def _lagrange(nodes: Float[np.ndarray, "points 4"], x: np.ndarray) -> np.ndarray:
    """Shares of four nodes in the cubic through them."""
    shares = np.ones_like(nodes)
    for k in range(4):
        for other in range(4):
            if other != k:
                shares[:, k] *= (x - nodes[:, other]) / (nodes[:, k] - nodes[:, other])
    return shares


def _log_prior(points: Points) -> np.ndarray:
    """Log-normal sigma and strength, within a factor of a thousand; phi uniform between -1 and 1."""
    log_sigma, z, log_strength = points.T
    of_logs = log_sigma**2 + (log_strength - np.log(USUAL)) ** 2
    return -of_logs / (2 * DECADES**2) - 2 * np.logaddexp(z / 2, -z / 2)
