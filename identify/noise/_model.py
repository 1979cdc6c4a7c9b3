"""The one noise model: what residuals are expected to be, for least squares and for the posterior."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
import scipy
import scipy.linalg
from jaxtyping import Array, Bool, Float

from hysteresis import Record, Scalar, parameter
from hysteresis._parameter import array_module
from hysteresis.records._arrays import pieces

from .._levels import FEW, HELD_AT_ONCE
from ._arithmetic import Arithmetic, Known, Rows


class NoiseModel(eqx.Module):
    """Residuals r_i = s_i e_i of scale s_i, correlated from row to row, with tails as long as need be:

        s_i^2 = (sigma^2 + (growth y_i)^2 + (input_sigma dy/du_i)^2) / weight_i^2
        e_i = phi e_(i-1) + w_i + theta w_(i-1),      e_i of unit variance,

    w Gaussian or Student's t with 1 / tail degrees of freedom (then sigma is the scale, not the deviation).
    What is None is not there: without theta this is AR(1), without phi too the residuals are independent.

    With `misfit` the model itself is off by a smooth function of the input and its direction, the same in
    every cycle: sum_k c_k shape_k(u_i), c_k Gaussian of deviation misfit / k. It is integrated over: with A
    the whitened shapes times their deviations the log-likelihood of whitened residuals x changes by

        -log det(I + A'A) / 2 + x'A (I + A'A)^-1 A'x / 2.

    The likelihood is exact: the one-step-ahead errors v_i = e_i - E[e_i | before] follow

        v_i = e_i - phi e_(i-1) - theta / rho_(i-1) v_(i-1),      var v_i = rho_i / gamma,
        rho_i = 1 + q theta^2i / (1 + q (1 - theta^2i) / (1 - theta^2)),
        q = (phi + theta)^2 / (1 - phi^2),      gamma = 1 + q,

    i counted from the start of the stretch, where v_0 = e_0.

    Source: Brockwell, Davis, Time Series: Theory and Methods, 2nd ed., section 5.3 (innovations algorithm);
    the closed form of rho solves its recursion rho_(i+1) = 1 + theta^2 - theta^2 / rho_i. Kennedy, O'Hagan,
    Bayesian calibration of computer models, J. R. Statist. Soc. B 63 (2001), of the misfit.
    """

    sigma: Scalar = parameter(
        unit="output", bounds=(0.0, float("inf")), meaning="size of the residuals"
    )
    growth: Scalar | None = parameter(
        None, bounds=(0.0, float("inf")), meaning="part of the reading that adds to it"
    )
    input_sigma: Scalar | None = parameter(
        None, unit="input", bounds=(0.0, float("inf")), meaning="error of the input's readings"
    )
    phi: Scalar | None = parameter(None, bounds=(-1.0, 1.0), meaning="part carried to the next row")
    theta: Scalar | None = parameter(
        None, bounds=(-1.0, 1.0), meaning="part of the last surprise that comes again"
    )
    tail: Scalar | None = parameter(
        None, bounds=(0.0, 0.5), meaning="1 / degrees of freedom of Student's t"
    )
    misfit: Scalar | None = parameter(
        None, unit="output", bounds=(0.0, float("inf")), meaning="size of the model's own error"
    )

    @property
    def words(self) -> str:
        """What kind it is: "Gaussian", "AR(1), Student's t, growing with the reading"."""
        correlated = "ARMA(1,1)" if self.theta is not None else "AR(1)"
        said = [correlated] if self.phi is not None else []
        said += ["Gaussian" if self.tail is None else "Student's t"]
        said += ["growing with the reading"] if self.growth is not None else []
        said += ["errors in the input"] if self.input_sigma is not None else []
        return ", ".join(said + ["a misfit of the model"] * (self.misfit is not None))

    @property
    def is_white(self) -> bool:
        """Whether it is Gaussian, independent from row to row and of one size."""
        more = self.growth, self.input_sigma, self.phi, self.theta, self.tail, self.misfit
        return all(part is None for part in more)

    def scale(self, rows: Rows) -> Float[Known, " rows"]:
        """s_i."""
        return self.arithmetic(rows).scale(rows)

    def whitened(
        self, r: Float[Known, "rows *columns"], rows: Rows
    ) -> Float[Known, "rows *columns"]:
        """One-step-ahead errors over their deviations: independent, of unit variance; linear in r.

        Several columns go through the same filter.
        """
        return self.arithmetic(rows, r).whitened(r, rows)

    def pointwise(self, r: Float[Known, " rows"], rows: Rows) -> Float[Known, " rows"]:
        """log p(r_i | those before), 0 where a row does not count."""
        return self.arithmetic(rows, r).pointwise(r, rows)

    def log_likelihood(self, r: Float[Known, " rows"], rows: Rows) -> Known:
        """log p(r), whatever the misfit."""
        return self.arithmetic(rows, r).log_likelihood(r, rows)

    @property
    def information(self) -> Known:
        """E[(d log density / dx)^2]: 1, of Student's t (nu + 1) / (nu + 3)."""
        return self.arithmetic().information

    @property
    def correlation_time(self) -> Known:
        """1 + 2 sum of the autocorrelations, in rows."""
        return self.arithmetic().correlation_time

    def arithmetic(self, rows: Rows | None = None, r: Any = 0.0) -> Arithmetic:
        """By NumPy where the noise and what it is asked of are known."""
        parts = {part: getattr(self, part) for part in Arithmetic._fields if part != "xp"}
        some = [x for x in parts.values() if x is not None]
        xp = array_module(*some, r, *([] if rows is None else rows))
        known = {part: None if x is None else xp.asarray(x) for part, x in parts.items()}
        return Arithmetic(**known, xp=xp)


def rows_of(
    record: Record, used: Bool[np.ndarray, " rows"], predicted: Float[np.ndarray, " rows"]
) -> Rows:
    """`Rows` of a record of which the `used` rows count."""
    begins = used.copy()
    begins[1:] &= ~used[:-1]
    begins[record.starts] = used[record.starts]
    index = np.arange(len(used))
    place = index - np.maximum.accumulate(np.where(begins, index, 0))
    slope = np.zeros_like(predicted)
    for _, rows in record.sequences():
        if rows.stop - rows.start > 1:
            du, dy = np.gradient(record.input[rows]), np.gradient(predicted[rows])
            moves = np.abs(du) > 1e-3 * np.max(
                np.abs(du)
            )  # where the input rests there is no slope
            slope[rows] = np.where(moves, dy / np.where(moves, du, 1.0), 0.0)
    place = np.where(used, place, 0.0).astype(predicted.dtype)
    weight = record.weights.astype(predicted.dtype)
    return Rows(used, place, predicted, slope, shapes_of(record, used), weight)


def shapes_of(
    record: Record, used: Bool[np.ndarray, " rows"], most: int = 4
) -> Float[np.ndarray, "rows shapes"]:
    """Chebyshev's polynomials T_k(x), k = 1 ... most, x from -1 to 1 over the used inputs; before each of
    them T_(k - 1)(x) times the input's direction. 0 in rows that are not used."""
    u = record.input
    low, high = u[used].min(initial=np.inf), u[used].max(initial=-np.inf)
    x = np.clip(2 * (u - low) / max(high - low, 1e-300) - 1, -1.0, 1.0)
    angle, step = np.arccos(x), np.diff(u, prepend=u[:1])
    step[record.starts] = 0.0
    direction, wave = np.sign(step), np.ones_like(u)
    found = np.empty((len(u), 2 * most), u.dtype)
    for k in range(most):
        found[:, 2 * k] = direction * wave
        wave = np.cos((k + 1) * angle)
        found[:, 2 * k + 1] = wave
    found[~used] = 0.0
    return found


# What a noise model leaves of the residuals, and the chance that this is noise.

# Correlated noise behind a linear fit whose many unknowns have followed part of it.
#
# Residuals r = M e of a linear fit are smaller than the noise e, and less correlated, because the fit
# follows the slow part of e: under AR(1) noise of 0.7 the residuals of a Preisach grid have a correlation
# of 0.53, and intervals made of them held 64 to 74 per cent of the truths at nominal 90. M is known. So the
# noise is the one whose simulated residuals M e have the size and the correlation that were found.


CORRELATIONS = 1 - np.geomspace(1.0, 0.05, 10)
"""Of neighbouring rows, that are simulated: even steps of log(1 - phi). Residuals are interpolated."""

Noises = Float[np.ndarray, "rows series"]


class CorrelatedNoise(NamedTuple):
    """AR(1) noise: e_i = phi e_(i-1) + w_i with the standard deviation `sigma`."""

    sigma: float
    phi: float


def noise_behind(
    residuals: Float[np.ndarray, " rows"],
    left: Callable[[Noises], Noises],
    sequences: Sequence[slice],
) -> CorrelatedNoise:
    """The AR(1) noise whose residuals look like those of a fit.

    **Arguments:**

    - `residuals`: of the rows that were fitted.
    - `left`: M, what the fit leaves of series of noise in these rows.
    - `sequences`: rows that follow one another; noise does not go on from one sequence to the next.

    **Returns:** sigma, in the unit of the residuals, and phi between 0 and 0.95.
    """
    # The random numbers are the same for all, so that what is interpolated is smooth.
    count = int(np.clip(HELD_AT_ONCE // len(residuals), 1, FEW))
    white = np.random.default_rng(0).normal(size=(len(residuals), count))
    noise = np.empty((len(residuals), len(CORRELATIONS), count))
    for k, phi in enumerate(CORRELATIONS):
        for rows in sequences:
            one = white[rows] * np.sqrt(1 - phi**2)
            one[0] = white[rows][0]
            noise[rows, k] = _followed(one, phi)
    followed = left(noise.reshape(len(residuals), -1)).reshape(noise.shape)
    moments = [_moments(followed[:, k], sequences) for k in range(len(CORRELATIONS))]
    squares, products = np.array(moments).T
    found, neighbours = _moments(residuals[:, None], sequences)
    if found == 0:
        return CorrelatedNoise(0.0, 0.0)
    simulated = np.maximum.accumulate(products / squares)
    phi = float(np.interp(neighbours / found, simulated, CORRELATIONS))
    return CorrelatedNoise(float(np.sqrt(found / np.interp(phi, CORRELATIONS, squares))), phi)


def spread_over_rows(columns: Noises, phi: float, sequences: Sequence[slice]) -> Noises:
    """V times columns, V the covariance of AR(1) noise of unit variance: V_ij = phi^|i - j|."""
    spread = np.empty_like(columns)
    for rows in sequences:
        one = columns[rows]
        spread[rows] = _followed(one, phi) + _followed(one[::-1], phi)[::-1] - one
    return spread


def _followed(x: Noises, phi: float) -> Noises:
    """e_i = phi e_(i-1) + x_i of each column; scipy.signal has it too, and takes half a second to load."""
    band = np.stack([np.ones(len(x)), np.full(len(x), -phi)])
    return scipy.linalg.solve_banded((1, 0), band, x, check_finite=False)


def _moments(series: Noises, sequences: Sequence[slice]) -> tuple[float, float]:
    """Mean square, and mean product of neighbours."""
    products = sum(float((series[rows][1:] * series[rows][:-1]).sum()) for rows in sequences)
    return float(np.mean(series**2)), products / series.size


class Left(NamedTuple):
    """What is left of a linearised model under one noise, all through the filter that makes it white.

    - `x` (rows,): innovations, of unit variance where the noise is the right one.
    - `W` (directions, parameters): the model's directions. `shapes` (rows, shapes): those of a misfit.
    - `information`: of a row of unit variance.
    """

    x: Float[Array | np.ndarray, " rows"]
    W: Float[Array | np.ndarray, "directions parameters"]
    shapes: Float[Array | np.ndarray, "rows shapes"]
    information: Float[Array | np.ndarray, ""]

    def root(self, precision: Float[np.ndarray, "parameters parameters"]) -> np.ndarray:
        """Rows with root'root = the information about the parameters, that of the prior below."""
        values, vectors = np.linalg.eigh(precision)
        of_prior = vectors.T * np.sqrt(np.maximum(values, 0.0))[:, None]
        return np.concatenate([np.asarray(self.W) * np.sqrt(self.information), of_prior])


def believed(left: Left, place: Float[Array | np.ndarray, " rows"], spent: int) -> float:
    """The smaller of two chances: of white innovations to be as coloured, and of noise to look as much like
    a function of the input. `place` as in `Rows`; `spent`: how many of phi and theta there are."""
    x, W, shapes = (np.asarray(a) for a in left[:3])
    return min(_white(x, np.asarray(place), spent), _shapeless(x, W, shapes))


def nothing_speaks_against(left: Left, rows: Rows, spent: int = 0) -> bool:
    """Whether Gaussian noise of one size can be believed without trying other kinds.

    Color, shapes, tails (Jarque and Bera's kurtosis) and growth (Breusch and Pagan's correlation of squares
    with the squared reading) are each as strong by chance in one of twenty cases at least. `spent` as for
    `believed`.
    """
    x, reading = np.asarray(left.x), np.asarray(rows.output) ** 2
    counted = np.asarray(rows.counted)
    squares, reading = x[counted] ** 2, reading[counted]
    count = len(squares)
    if count < FEW or not squares.any():
        return False
    tails = abs(np.mean(squares**2) / np.mean(squares) ** 2 - 3) * np.sqrt(count / 24)
    spread = np.std(squares) * np.std(reading)
    growth = np.cov(squares, reading)[0, 1] / spread * np.sqrt(count) if spread > 0 else 0.0
    chance = 2 * scipy.special.ndtr(-max(tails, abs(growth)))
    return bool(min(chance, believed(left, rows.place, spent)) > 0.05)


def _white(x: np.ndarray, place: np.ndarray, spent: int) -> float:
    """Ljung and Box: rows (rows + 2) sum over lags of rho_k^2 / (rows - k) is chi-square with as many
    degrees of freedom as lags, less those spent. Outliers count as four deviations."""
    x = np.clip(x, -4.0, 4.0)
    count = int(np.count_nonzero(x))
    lags = np.arange(1, min(int(10 * np.log10(max(count, 1))), count // 4) + 1)
    if len(lags) <= spent:
        return 1.0
    rho = np.array([np.sum((x[k:] * x[:-k])[place[k:] >= k]) for k in lags]) / (x @ x)
    Q = count * (count + 2) * np.sum(rho**2 / (count - lags))
    return float(scipy.special.chdtrc(len(lags) - spent, Q))


def _shapeless(x: np.ndarray, W: np.ndarray, shapes: np.ndarray) -> float:
    """|P x|^2 is chi-square, P the projection onto what the shapes add to the model's own directions."""
    if not shapes.shape[1]:
        return 1.0
    own, rank = _explained(x, W)
    whole, ranks = _explained(x, W, shapes)
    return float(scipy.special.chdtrc(max(ranks - rank, 1), max(whole - own, 0.0)))


def _explained(x: np.ndarray, *columns: np.ndarray) -> tuple[float, int]:
    """|Q'x|^2, Q an orthonormal basis of the columns, and how many these are."""
    width = sum(A.shape[1] for A in columns)
    square, along = np.zeros((width, width)), np.zeros(width)
    for rows in pieces(len(x)):
        A = np.hstack([part[rows] for part in columns])
        square += A.T @ A
        along += A.T @ x[rows]
    size = np.sqrt(np.diagonal(square))
    size = size + (size == 0)
    values, vectors = np.linalg.eigh(square / np.outer(size, size))
    seen = values > 1e-9
    along = vectors[:, seen].T @ (along / size)
    return float(np.sum(along**2 / values[seen])), int(seen.sum())
