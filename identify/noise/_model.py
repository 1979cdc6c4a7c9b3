"""The one noise model: what residuals are expected to be, for least squares and for the posterior."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import gammaln
from jaxtyping import Array, Bool, Float

from hysteresis import Record, Scalar, linear_recurrence, parameter


class Rows(NamedTuple):
    """What of a record the noise depends on, (rows,), and what would show a misfit.

    - `counted`: whether a row counts. `place`: rows since its stretch began; a stretch is a run of counted
      rows of one sequence, and independent of the others.
    - `output`: the predicted output, for noise that grows with the reading.
    - `slope`: d output / d input along the path, for errors in the input.
    - `shapes` (rows, shapes): smooth functions of the input, alike on rising and falling branches or of
      opposite sign: noise looks like none of them.
    """

    counted: Bool[Array | np.ndarray, " rows"]
    place: Float[Array | np.ndarray, " rows"]
    output: Float[Array | np.ndarray, " rows"]
    slope: Float[Array | np.ndarray, " rows"]
    shapes: Float[Array | np.ndarray, "rows shapes"]


class NoiseModel(eqx.Module):
    """Residuals r_i = s_i e_i of scale s_i, correlated from row to row, with tails as long as need be:

        s_i^2 = sigma^2 + (growth y_i)^2 + (input_sigma dy/du_i)^2
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

    def scale(self, rows: Rows) -> Float[Array, " rows"]:
        """s_i."""
        squares = jnp.ones_like(rows.output) * self.sigma**2
        if self.growth is not None:
            squares = squares + (self.growth * rows.output) ** 2
        if self.input_sigma is not None:
            squares = squares + (self.input_sigma * rows.slope) ** 2
        return jnp.sqrt(squares)

    def whitened(self, r: Float[Array, " rows"], rows: Rows) -> Float[Array, " rows"]:
        """One-step-ahead errors over their deviations: independent, of unit variance; linear in r."""
        e = jnp.where(rows.counted, r, 0.0) / self.scale(rows)
        if self.phi is None:
            return e
        inside = rows.place > 0
        before = jnp.where(inside, _before(e), 0.0)
        v, rho = e - self.phi * before, self._rho(rows)
        if self.theta is not None:
            a = jnp.where(inside, -self.theta / _before(rho, 1.0), 0.0)
            v = linear_recurrence((a,), (v,))[0]
        return jnp.where(rows.counted, v, 0.0) / jnp.sqrt(rho * self._innovation)

    def pointwise(self, r: Float[Array, " rows"], rows: Rows) -> Float[Array, " rows"]:
        """log p(r_i | those before), 0 where a row does not count."""
        deviation = self.scale(rows)
        if self.phi is not None:
            deviation = deviation * jnp.sqrt(self._rho(rows) * self._innovation)
        term = self.log_density(self.whitened(r, rows)) - jnp.log(deviation)
        return jnp.where(rows.counted, term, 0.0)

    def log_likelihood(self, r: Float[Array, " rows"], rows: Rows) -> Float[Array, ""]:
        """log p(r), whatever the misfit."""
        if self.misfit is None:
            return jnp.sum(self.pointwise(r, rows))
        A, L = self._misfit_root(rows)
        x = self.whitened(r, rows)
        c = jax.scipy.linalg.cho_solve((L, True), A.T @ x)
        # A sum of squares, not a difference of large ones.
        squares = jnp.sum((x - A @ c) ** 2) + c @ c
        constant = jnp.sum(self.pointwise(jnp.zeros_like(r), rows))
        return constant - squares / 2 - jnp.sum(jnp.log(jnp.diagonal(L)))

    def information_of(
        self, columns: Float[Array, "rows parameters"], rows: Rows
    ) -> Float[Array, "parameters parameters"]:
        """Expected -d2 log p / d p2 of parameters p that move the residuals along the columns."""
        W = self.whitened_columns(columns, rows)
        if self.misfit is not None:
            A, L = self._misfit_root(rows)
            hidden = jax.scipy.linalg.solve_triangular(L, A.T @ W, lower=True)
            return W.T @ W - hidden.T @ hidden
        return self.information * W.T @ W

    def without_misfit(self, x: Float[Array, " rows"], rows: Rows) -> Float[Array, " rows"]:
        """Whitened residuals less what the misfit is expected to be of them."""
        if self.misfit is None:
            return x
        A, L = self._misfit_root(rows)
        return x - A @ jax.scipy.linalg.cho_solve((L, True), A.T @ x)

    def whitened_columns(
        self, columns: Float[Array, "rows columns"], rows: Rows
    ) -> Float[Array, "rows columns"]:
        """Every column through the same filter."""
        return jax.vmap(lambda c: self.whitened(c, rows), in_axes=1, out_axes=1)(columns)

    def _misfit_root(self, rows: Rows) -> tuple[Array, Array]:
        """A, and L with LL' = I + A'A."""
        orders = 1 + jnp.arange(rows.shapes.shape[1]) // 2
        deviations = jnp.asarray(self.misfit) / orders.astype(rows.shapes.dtype)
        A = self.whitened_columns(rows.shapes, rows) * deviations[None]
        return A, jnp.linalg.cholesky(jnp.eye(A.shape[1]) + A.T @ A)

    def log_density(self, x: Float[Array, " rows"]) -> Float[Array, " rows"]:
        """Of a residual in units of its scale."""
        if self.tail is None:
            return -0.5 * (x**2 + jnp.log(2 * jnp.pi))
        nu = 1 / self.tail
        constant = gammaln((nu + 1) / 2) - gammaln(nu / 2) - 0.5 * jnp.log(jnp.pi * nu)
        return constant - (nu + 1) / 2 * jnp.log1p(x**2 * self.tail)

    @property
    def information(self) -> Float[Array, ""]:
        """E[(d log density / dx)^2]: 1, of Student's t (nu + 1) / (nu + 3)."""
        if self.tail is None:
            return jnp.ones(())
        tail = jnp.asarray(self.tail)
        return (1 + tail) / (1 + 3 * tail)

    @property
    def correlation_time(self) -> Float[Array, ""]:
        """1 + 2 sum of the autocorrelations, in rows."""
        phi, theta = self._arma
        return ((1 + theta) / (1 - phi)) ** 2 * self._innovation

    @property
    def _arma(self) -> tuple[Array, Array]:
        phi, theta = (jnp.asarray(0.0 if x is None else x) for x in (self.phi, self.theta))
        return phi, theta

    @property
    def _innovation(self) -> Float[Array, ""]:
        """Variance of w: 1 / gamma."""
        phi, theta = self._arma
        return (1 - phi**2) / (1 + 2 * phi * theta + theta**2)

    def _rho(self, rows: Rows) -> Float[Array, " rows"]:
        """Variance of v_i in units of w's."""
        phi, theta = self._arma
        q = (phi + theta) ** 2 / (1 - phi**2)
        # JAX's forward derivative of 0^0 is not a number.
        power = jnp.where(rows.place > 0, (theta**2) ** jnp.maximum(rows.place, 1.0), 1.0)
        return 1 + q * power / (1 + q * (1 - power) / (1 - theta**2))


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
    arrays = (np.where(used, place, 0.0).astype(predicted.dtype), predicted, slope)
    return Rows(jnp.asarray(used), *(jnp.asarray(a) for a in (*arrays, shapes_of(record, used))))


def shapes_of(
    record: Record, used: Bool[np.ndarray, " rows"], most: int = 4
) -> Float[np.ndarray, "rows shapes"]:
    """Chebyshev's polynomials T_k(x), k = 1 ... most, x from -1 to 1 over the used inputs; before each of
    them T_(k - 1)(x) times the input's direction."""
    u = record.input
    low, high = u[used].min(initial=np.inf), u[used].max(initial=-np.inf)
    x = np.clip(2 * (u - low) / max(high - low, 1e-300) - 1, -1.0, 1.0)
    waves = np.cos(np.arange(most + 1) * np.arccos(x)[:, None])
    step = np.diff(u, prepend=u[:1])
    step[record.starts] = 0.0
    both = np.stack([np.sign(step)[:, None] * waves[:, :-1], waves[:, 1:]], axis=2)
    return both.reshape(len(u), -1).astype(u.dtype)


def _before(x: Array, first: float = 0.0) -> Array:
    return jnp.concatenate([jnp.full_like(x[:1], first), x[:-1]])
