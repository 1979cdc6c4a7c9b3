"""The log-posterior of an oscillator whose class has few parameters, by its law."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from hysteresis import AbstractModel, BoucWenForce, InputError, Oscillator
from hysteresis._precision import in_this_precision

from .._levels import FACTOR
from ..dynamics._classes import COARSER, duhem_family, periods_to_steady_state, unknowns_of_bouc_wen
from ..dynamics._measured_motion import measured_motion
from ..dynamics._output_error import Family, Setting
from ..noise._model import NoiseModel
from ..parameters._settings import Prior
from ..parameters._settings import Setting as Said
from ..parameters._transform import Transform, Vectors, transform, transform_for
from ..results._detail import Motion
from ..results._fit_result import FitResult
from ._log_posterior import NOISE_PRIORS

SIDE_BY_SIDE = 2
"""Threads: the compiled law lets others run."""


@dataclass(frozen=True, eq=False)
class MotionTarget:
    """log p(z | motion), z the free numbers of an oscillator, then the noise's.

        log p = -n log sigma - sum of squares of (y - y(theta)) / (2 sigma^2) + log-prior

    y is the motion, averaged over its periods where it has several, and sigma the noise of that mean; where
    the noise is coloured, residuals are whitened. Motions are simulated in steps `COARSER` times as long as
    the fit's, and what that changes at the fit is added. The initial state of a record without a period is
    integrated out, linearised at the fit.

    - `bounds`, `noise_bounds`: between z and parameters; `template`, `noise_template`: what those go into.
    - `start`: the fit; `root`: of Laplace's covariance there.
    - `setting`, `family`, `steady`, `initial`: how a motion is simulated, and from which state.
    - `correction`: what finer steps change. `of_state`: an orthonormal basis of what the state can change.
    - `periods`: how many were averaged. `log_priors`: of many points, compiled.
    """

    bounds: Transform
    noise_bounds: Transform
    template: AbstractModel
    noise_template: NoiseModel
    start: Float[np.ndarray, " parameters"]
    root: Float[np.ndarray, "parameters parameters"]
    setting: Setting
    family: Family
    steady: Float[np.ndarray, " state"] | None
    initial: Float[np.ndarray, " free"]
    correction: Float[np.ndarray, " samples"]
    of_state: Float[np.ndarray, "samples free"]
    periods: int
    log_priors: Callable[[Any], Array]
    weight: float = 1.0

    @property
    def names(self) -> tuple[str, ...]:
        """Of the numbers in z: the model's, then the noise's."""
        return (*self.bounds.names, *self.noise_bounds.names)

    def model(self, point: Float[Array, " parameters"]) -> AbstractModel:
        """The oscillator at a point."""
        z = point[: len(self.bounds.names)]
        return self.bounds.insert(self.template, self.bounds.to_values(z))

    def values(self, points: Vectors) -> Vectors:
        """The parameters in their units; sigma is the noise of one row."""
        xp: Any = np if isinstance(points, np.ndarray) else jax.numpy
        z, noise = xp.split(points, [len(self.bounds.names)], -1)
        return xp.concatenate([self.bounds.to_values(z), self.noise_bounds.to_values(noise)], -1)

    def log_probability(
        self, points: Float[np.ndarray, "points parameters"]
    ) -> Float[np.ndarray, " points"]:
        """Of many points at once; -inf where a motion has no end."""
        with ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
            values = pool.map(in_this_precision(self._log_likelihood), points)
            found = np.fromiter(values, float, len(points))
        whole = found + np.asarray(self.log_priors(points))
        return np.where(np.isfinite(whole), whole, -np.inf)

    def residuals(self, values: Float[np.ndarray, " parameters"]) -> Float[np.ndarray, " samples"]:
        """measured - simulated, whitened, without what another initial state explains."""
        q = unknowns_of_bouc_wen(self.family, values, self.initial)
        y, _ = self.setting.simulated(self.family, q, jacobian=False, state=self.steady)
        motion = self.setting.motion
        left = motion.whitened(motion.displacement - y - self.correction)
        return left - self.of_state @ (self.of_state.T @ left)

    def _log_likelihood(self, point: Float[np.ndarray, " parameters"]) -> float:
        values = self.values(point)
        left = self.residuals(values[:-1])
        if not np.isfinite(left).all():
            return -np.inf
        sigma = float(values[-1]) / np.sqrt(self.periods)
        rows = len(left) - self.of_state.shape[1]
        return -rows * float(np.log(sigma)) - float(left @ left) / (2 * sigma**2)


def motion_target(fit: FitResult) -> MotionTarget:
    """The log-posterior of an oscillator around Bouc-Wen's force.

    Raises `InputError` `no-posterior` for a class whose weights a prior holds together, and for a damping
    that is not positive.
    """
    detail, model = fit.detail, fit.model
    assert isinstance(detail, Motion)
    assert isinstance(model, Oscillator)
    if not isinstance(model.hysteresis, BoucWenForce):
        raise InputError(
            "no-posterior",
            f"the hysteresis of {fit.name} has weights that a prior holds together, not few parameters.",
            fix="mass, damping and stiffness have standard errors in the fit; Oscillator(BoucWen) can be"
            " sampled where it explains the record.",
        )
    if not float(model.damping) > 0:
        raise InputError(
            "no-posterior",
            f"the damping is {float(model.damping):g}, and a posterior holds positive ones only.",
            fix="measure longer, or with a band wider about the resonance.",
        )
    recorded = detail.recorded
    motion = measured_motion(fit.train, recorded.period)
    family = duhem_family(3, float(np.std(motion.force)), True, not motion.periodic)
    warm = periods_to_steady_state(motion, detail.linear)
    fine = Setting.of(motion, recorded.substeps, recorded.stages, warm)
    coarse = Setting.of(motion, max(1, recorded.substeps // COARSER), (), warm)
    bounds = transform_for(model, fit.train, _priors(detail, motion.displacement))
    values, initial = (
        bounds.values(model),
        np.array(recorded.initial)[: 0 if motion.periodic else 3],
    )
    q = unknowns_of_bouc_wen(family, values, initial)
    exact, _ = fine.simulated(family, q, jacobian=False)
    rough, J = coarse.simulated(family, q)
    J, left = motion.whitened(J), motion.whitened(motion.displacement - exact)
    first = family.words["first"]
    of_state = np.linalg.qr(J[:, 3:first])[0]
    columns = np.column_stack([J[:, :3], J[:, first], -J[:, first + 1 : first + 3]])
    columns = columns - of_state @ (of_state.T @ columns)
    sigma = float(np.sqrt(left @ left / (len(left) - columns.shape[1] - of_state.shape[1])))
    noise = NoiseModel(sigma * np.sqrt(motion.periods))
    sizes = float(np.ptp(fit.train.output[fit.used])), float(np.ptp(fit.train.input[fit.used]))
    noise_bounds = transform(noise, *sizes, NOISE_PRIORS)
    z = bounds.from_values(values)
    count = len(z)
    root = np.zeros((count + 1, count + 1))
    columns = columns * bounds.slope(z) / sigma
    root[:count, :count] = np.linalg.cholesky(np.linalg.inv(columns.T @ columns))
    root[count, count] = 1 / np.sqrt(2 * len(left))

    @jax.jit
    @jax.vmap
    def log_priors(point: Array) -> Array:
        return bounds.log_prior(point[:count]) + noise_bounds.log_prior(point[count:])

    return MotionTarget(
        bounds, noise_bounds, model, noise, np.concatenate([z, noise_bounds.to_free(noise)]), root,
        # What is left of a transient from the fit's steady state is small, and half as long gone.
        replace(coarse, warm=-(-coarse.warm // 2)), family,
        coarse.steady_state(family, q) if motion.periodic else None, initial, exact - rough, of_state,
        motion.periods, log_priors,
    )  # fmt: skip


def _priors(detail: Motion, displacement: Float[np.ndarray, " samples"]) -> dict[str, Said]:
    """Weak priors about the scales of the best linear approximation and of the motion."""
    linear = detail.linear
    stiffness, per_length = abs(linear.stiffness), 10 / float(np.std(displacement))

    def positive(scale: float) -> Said:
        return Said(prior=Prior("log-normal", scale, FACTOR, default=True))

    def about_zero(scale: float) -> Said:
        return Said(prior=Prior("normal", 0.0, scale, default=True))

    return {
        "mass": positive(abs(linear.mass)),
        "damping": positive(float(np.sqrt(abs(linear.mass) * stiffness))),
        "stiffness": about_zero(10 * stiffness),
        "hysteresis.alpha": positive(stiffness),
        "hysteresis.beta_gamma": about_zero(per_length),
        "hysteresis.beta_delta": about_zero(per_length),
    }
