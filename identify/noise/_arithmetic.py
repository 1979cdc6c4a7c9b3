"""The likelihood of a noise model: one arithmetic, NumPy's where all is known, JAX's where it is traced."""

from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np
import scipy.linalg
import scipy.special
from jax.scipy.special import gammaln
from jaxtyping import Array, Bool, Float
from scipy.linalg.lapack import dtbtrs  # pyright: ignore[reportAttributeAccessIssue]

from hysteresis._parameter import array_module
from hysteresis.numerics._recurrence import linear_recurrence

if TYPE_CHECKING:
    Known = Any  # the operators of the two libraries have no type in common
else:
    Known = Array | np.ndarray | np.generic | float
"""An array, of NumPy where all that it is made of is known."""


class Rows(NamedTuple):
    """What of a record the noise depends on, (rows,), and what would show a misfit.

    - `counted`: whether a row counts. `place`: rows since its stretch began; a stretch is a run of counted
      rows of one sequence, and independent of the others.
    - `output`: the predicted output, for noise that grows with the reading.
    - `slope`: d output / d input along the path, for errors in the input.
    - `shapes` (rows, shapes): smooth functions of the input, alike on rising and falling branches or of
      opposite sign: noise looks like none of them.
    - `weight`: what the deviation of a row is divided by, see `Record.weights`.
    """

    counted: Bool[Known, " rows"]
    place: Float[Known, " rows"]
    output: Float[Known, " rows"]
    slope: Float[Known, " rows"]
    shapes: Float[Known, "rows shapes"]
    weight: Float[Known, " rows"]


class Arithmetic(NamedTuple):
    """The parts of a `NoiseModel`, whose docstrings have the equations, and the module that computes.

    Plain tuples, whose arrays have no checks of shapes: a search evaluates them thousands of times.
    """

    sigma: Any
    growth: Any = None
    input_sigma: Any = None
    phi: Any = None
    theta: Any = None
    tail: Any = None
    misfit: Any = None
    xp: Any = np

    def scale(self, rows: Rows) -> Known:
        xp = self.xp
        squares = xp.ones_like(rows.output) * self.sigma**2
        if self.growth is not None:
            squares = squares + (self.growth * rows.output) ** 2
        if self.input_sigma is not None:
            squares = squares + (self.input_sigma * rows.slope) ** 2
        return xp.sqrt(squares) / xp.where(rows.counted, rows.weight, 1.0)

    def whitened(self, r: Known, rows: Rows) -> Known:
        xp = self.xp
        over = xp.where(rows.counted, 1.0, 0.0) / self.scale(rows)
        across = (slice(None), *[None] * (np.ndim(r) - 1))
        e = r * over[across]
        if self.phi is None:
            return e
        inside = rows.place > 0
        rho, part = self._rho(rows), xp.where(inside, self.phi, 0.0)
        v = e - part[across] * _before(e)
        if self.theta is not None:
            a = xp.where(inside, -self.theta / _before(rho, 1.0), 0.0)
            v = _recurrence(a, v)
        return v * (xp.where(rows.counted, 1.0, 0.0) / xp.sqrt(rho * self._innovation))[across]

    def pointwise(self, r: Known, rows: Rows) -> Known:
        xp = self.xp
        term = self.log_density(self.whitened(r, rows)) - xp.log(self._deviations(rows))
        return xp.where(rows.counted, term, 0.0)

    def log_likelihood(self, r: Known, rows: Rows) -> Known:
        xp = self.xp
        if self.misfit is None:
            return xp.sum(self.pointwise(r, rows))
        A, L = self._misfit_root(rows)
        x = self.whitened(r, rows)
        c = self._linalg.cho_solve((L, True), A.T @ x)
        # A sum of squares, not a difference of large ones.
        squares = xp.sum((x - A @ c) ** 2) + c @ c
        return self.log_constant(rows) - squares / 2

    def log_constant(self, rows: Rows) -> Known:
        """log p of residuals that are all 0."""
        xp = self.xp
        term = self.log_density(xp.zeros(())) - xp.log(self._deviations(rows))
        constant = xp.sum(xp.where(rows.counted, term, 0.0))
        if self.misfit is None:
            return constant
        return constant - xp.sum(xp.log(xp.diagonal(self._misfit_root(rows)[1])))

    def information_of(self, columns: Known, rows: Rows) -> Known:
        """Expected -d2 log p / d p2 of parameters p that move the residuals along the columns."""
        return self.information * self.products(self.whitened(columns, rows), rows)

    def products(self, W: Known, rows: Rows) -> Known:
        """Products of whitened columns; with a misfit, of what is left where it is integrated over."""
        if self.misfit is None:
            return W.T @ W
        A, L = self._misfit_root(rows)
        hidden = self._linalg.solve_triangular(L, A.T @ W, lower=True)
        return W.T @ W - hidden.T @ hidden

    def without_misfit(self, x: Known, rows: Rows) -> Known:
        """Whitened residuals less what the misfit is expected to be of them."""
        if self.misfit is None:
            return x
        A, L = self._misfit_root(rows)
        return x - A @ self._linalg.cho_solve((L, True), A.T @ x)

    def _misfit_root(self, rows: Rows) -> tuple[Any, Any]:
        """A, and L with LL' = I + A'A."""
        xp = self.xp
        orders = 1.0 + np.arange(rows.shapes.shape[1]) // 2
        A = self.whitened(rows.shapes, rows) * (self.misfit / orders)
        return A, xp.linalg.cholesky(xp.eye(A.shape[1]) + A.T @ A)

    def log_density(self, x: Known) -> Known:
        """Of a residual in units of its scale."""
        xp = self.xp
        if self.tail is None:
            return -0.5 * (x**2 + np.log(2 * np.pi))
        tail, log_gamma = self.tail, scipy.special.gammaln if xp is np else gammaln
        nu = 1 / tail
        constant = log_gamma((nu + 1) / 2) - log_gamma(nu / 2) - 0.5 * xp.log(np.pi * nu)
        return constant - (nu + 1) / 2 * xp.log1p(x**2 * tail)

    @property
    def information(self) -> Known:
        tail = 0.0 if self.tail is None else self.tail
        return (1 + tail) / (1 + 3 * tail)

    @property
    def correlation_time(self) -> Known:
        phi, theta = self._arma
        return ((1 + theta) / (1 - phi)) ** 2 * self._innovation

    @property
    def _arma(self) -> tuple[Any, Any]:
        return 0.0 if self.phi is None else self.phi, 0.0 if self.theta is None else self.theta

    @property
    def _innovation(self) -> Known:
        """Variance of w: 1 / gamma."""
        phi, theta = self._arma
        return (1 - phi**2) / (1 + 2 * phi * theta + theta**2)

    def _deviations(self, rows: Rows) -> Known:
        """Standard deviations of the one-step-ahead errors."""
        if self.phi is None:
            return self.scale(rows)
        xp = self.xp
        return self.scale(rows) * xp.sqrt(self._rho(rows) * self._innovation)

    def _rho(self, rows: Rows) -> Known:
        """Variance of v_i in units of w's."""
        xp = self.xp
        phi, theta = self._arma
        q = (phi + theta) ** 2 / (1 - phi**2)
        if self.theta is None:
            return xp.where(rows.place > 0, 1.0, 1 + q)
        if xp is np:
            # Powers are slow, those too small for a float most of all.
            power = np.exp(np.maximum(rows.place * np.log(max(theta**2, 1e-300)), -700.0))
        else:
            # JAX's forward derivative of 0^0 is not a number.
            power = xp.where(rows.place > 0, (theta**2) ** xp.maximum(rows.place, 1.0), 1.0)
        return 1 + q * power / (1 + q * (1 - power) / (1 - theta**2))

    @property
    def _linalg(self) -> Any:
        return scipy.linalg if self.xp is np else jax.scipy.linalg


def _before(x: Known, first: float = 0.0) -> Known:
    xp = array_module(x)
    return xp.concatenate([xp.full_like(x[:1], first), x[:-1]])


def _recurrence(a: Known, b: Known) -> Known:
    """z_k = a_k z_(k-1) + b_k of every column."""
    if array_module(a, b) is np:
        bands = np.stack([np.ones(len(a)), np.append(-a[1:], 0.0)])
        table = np.asfortranarray(np.reshape(b, (len(a), -1)), dtype=float)
        return dtbtrs(bands, table, uplo="L", overwrite_b=True)[0].reshape(b.shape)
    if b.ndim == 1:
        return linear_recurrence((a,), (b,))[0]
    return jax.vmap(lambda column: _recurrence(a, column), in_axes=1, out_axes=1)(b)
