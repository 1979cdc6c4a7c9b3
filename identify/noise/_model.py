"""The one noise model: what residuals are expected to be, for least squares and for the posterior."""

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from hysteresis import Record, Scalar, parameter
from hysteresis._parameter import array_module

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
