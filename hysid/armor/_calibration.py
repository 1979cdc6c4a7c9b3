"""Calibration of an armor from presses at known points: `compensate.armor` gives the residuals."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from compensate.armor import Armor, Bumps, Presses
from compensate.armor._armor import UncertainArmor
from compensate.armor._calibration import PressResiduals, missed_of, with_slip, without_each
from hysteresis import InputError
from hysteresis.numerics._functions import NORMAL_95
from identify.calibration._calibrate import Calibration, Prior
from identify.calibration._excitation_design import Choice
from identify.internal import calibrate, choose

QUIET = 1e-3
"""Of the greatest reading of a channel: the noise from which a calibration starts."""

CROSSTALK, SHEET, FRAME = 0.03, 0.2, 3e-4
"""How far off, as deviations: an entry of the matrix; the cover's factor; the frame's compliance, m/N."""

DRAWS = 200


class CalibratedArmor(NamedTuple):
    """A calibrated armor.

    - `armor`: with what was found; `uncertain`: the same with draws, and with the errors that armors
      calibrated without one press each make in that press, as its noise and scatter.
    - `calibration`: every number with its deviation.
    - `noise` (6,), N and N m; `scatter`, m, of the cover from place to place; `reading`, m: what is left
      of the presses themselves.
    """

    armor: Armor
    uncertain: UncertainArmor
    calibration: Calibration[Armor]
    noise: np.ndarray
    scatter: float
    reading: float


def doubts(armor: Armor) -> dict[str, Any]:
    """The values of an armor that are usually uncertain, each with its standard deviation.

    These are the wrench matrix; the plays of `sensor.hysteresis`, uncertain by half of their values; the
    factor of the cover, and the bumps of the frame's compliance. A full matrix includes the effect of the
    pose and the offset of the sensor. To estimate these instead, leave out the matrix and give
    "sensor.turn" and "sensor.offset". See `identify.internal.calibrate`.
    """
    # Crosstalk between forces and moments is compared at the lever of half the shell.
    arm = float(armor.solver.shape.longest()) / 2
    scale = np.kron([[1, 1 / arm], [arm, 1]], np.ones((3, 3)))
    found: dict[str, Any] = {"sensor.matrix": CROSSTALK * scale}
    for k, model in enumerate(armor.sensor.hysteresis or ()):
        for name in ("weights", "thresholds"):
            found[f"sensor.hysteresis.{k}.{name}"] = np.asarray(getattr(model, name)) / 2
    cover = armor.solver.cover
    if not cover.is_rigid:
        found["solver.cover.factor." + _level(cover.factor)] = SHEET
        if isinstance(cover.compliance, Bumps):
            found["solver.cover.compliance.amplitude"] = FRAME
            found["solver.cover.compliance.width"] = 0.5 * float(cover.compliance.width)
    return found


def calibrate_armor(
    armor: Armor,
    presses: Presses,
    deviations: Mapping[str, Any] | None = None,
    noise: Any = None,
    scatter: float = 1e-3,
    reading: float = 2e-4,
    rounds: int = 2,
    seed: int = 0,
    full_scale: ArrayLike | None = None,
) -> CalibratedArmor:
    """Calibrate an armor with presses at known points.

    **Arguments:**

    - `armor`: with the values that are assumed before the calibration.
    - `presses`: forces in N, points in m, and what the wrist sensor read.
    - `deviations`: which values are free, and the standard deviation of each; `doubts` by default.
    - `noise` (6,), N and N m, `scatter` and `reading`, m: first guesses for `PressResiduals`. The noise of
      a data sheet is one; unless given, it is a thousandth of the greatest reading of each channel.
    - `rounds`: each after the first starts from the residuals of the one before, so that the resulting
      standard deviations are those of this sensor and cover.
    - `seed`: of the draws in `CalibratedArmor.uncertain`.
    - `full_scale` (6,), N and N m: ratings of a sensor whose joints slip; how they do is then found
      first. None: the armor's sensor as it is.

    **Returns:** a `CalibratedArmor`.

    **Raises:** `InputError` as `identify.internal.calibrate` does, and where no press is felt.

    **Example:**

        >>> free = {"solver.cover.factor.value": 0.2}
        >>> found = hysid.calibrate_armor(armor, planned, free, rounds=1)
        >>> round(float(found.armor.solver.cover.factor.value), 3)
        1.0
    """
    threshold = float(armor.solver.threshold)
    if not (np.asarray(presses.force) >= threshold).any():
        raise InputError(
            "bad-presses", f"the gauge never reads a push of {threshold:g} N.", place="Presses",
            cause="a gauge that counts pushes as negative, or forces in another unit.",
            fix="turn the sign of force, or name its unit: force (N).",
        )  # fmt: skip
    starts: list[Armor] = []
    if full_scale is not None:
        starts = without_each(armor, presses, full_scale)
        armor = with_slip(armor, presses, full_scale)
    free = doubts(armor) if deviations is None else deviations
    noise = quiet(presses) if noise is None else jnp.asarray(noise, float)
    residuals = PressResiduals(presses, noise, scatter=scatter, reading=reading)
    found = calibrate(armor, residuals, free)
    for _ in range(rounds - 1):
        residuals = residuals.with_noise_left(found.system)
        found = calibrate(armor, residuals, free, begin=found.point)
    told = residuals.with_noise_left(found.system)
    unseen = spread_of_unseen(found, residuals, starts)
    depth = jnp.hypot(told.scatter, told.reading) if unseen.depth is None else unseen.depth
    draws, noise = found.draws(DRAWS, seed), jnp.asarray(unseen.noise)
    uncertain = UncertainArmor(found.system, draws, noise, depth, seed)
    left = np.asarray(told.noise), float(told.scatter), float(told.reading)
    return CalibratedArmor(found.system, uncertain, found, *left)


def choose_presses(
    armor: Armor,
    candidates: Presses,
    goals: Presses,
    count: int = 20,
    deviations: Mapping[str, Any] | None = None,
) -> Choice:
    """Choose the presses that most reduce the variance of the contacts that you care about.

    **Arguments:**

    - `candidates`: presses that could be made, from `compensate.armor.planned_presses`; nothing needs to be
      measured yet.
    - `goals`: presses whose contact points, at their last sample, shall be known well.
    - `count`: how many presses to choose.
    - `deviations`: which values of the armor are free, see `calibrate_armor`.

    **Returns:** a `Choice`: the chosen presses, and the variance that each leaves.

    **Raises:** `InputError` as `identify.internal.choose` does.

    **Example:**

        >>> free = {"solver.cover.factor.value": 0.2}
        >>> choice = hysid.choose_presses(armor, planned, planned, count=2, deviations=free)
        >>> len(choice.chosen)
        2
    """
    residuals = PressResiduals(candidates, quiet(candidates))

    def ends(armor: Armor) -> jax.Array:
        return jax.vmap(armor.simulate)(goals.time, goals.readings).point[:, -1]

    free = doubts(armor) if deviations is None else deviations
    return choose(armor, residuals, ends, free, count)


def quiet(presses: Presses) -> jax.Array:
    """A first guess of the noise (6,) of readings, N and N m."""
    greatest = jnp.abs(presses.readings).max(axis=(0, 1))
    # A channel without any load, such as a torque about the axis of the shell, is as noisy as its like.
    return QUIET * jnp.repeat(jnp.stack([greatest[:3].max(), greatest[3:].max()]), 3)


def _level(field: Any) -> str:
    """Name of the value far from a bump, or of all of them."""
    return next(name for name in ("value", "base", "values") if hasattr(field, name))


class Spread(NamedTuple):
    """Errors of unseen presses as deviations: `noise` (6,), N and N m; `depth`, m, None if not measured."""

    noise: Float[np.ndarray, "6"]
    depth: float | None


def spread_of_unseen(
    found: Calibration[Armor], residuals: PressResiduals, starts: Sequence[Armor]
) -> Spread:
    """What the armors that are calibrated without one press each miss of that press.

    From the mode z of all presses, one step of Gauss-Newton with its Jacobian J leads to that without one:

        z_k = z - (1 + J_-k' J_-k)^-1 (J_-k' r_-k + z)

    **Arguments:** `found` by `residuals`; `starts`: for each press the armor that its calibration began
    with, where that was made from presses too, as by `without_each`; none where it was not.

    **Returns:** root mean squares over presses, times Student's quantile over the normal one, because few
    presses do not tell a deviation well.
    """
    presses, z = residuals.presses, jnp.asarray(found.point)
    count = len(presses.surface)
    J = found.jacobian.reshape(count, -1, len(z))
    squares = np.einsum("pri,prj->pij", J, J)
    whole = squares.sum(0) + np.eye(len(z))
    wrench, depth = [], []
    for k in range(count):
        prior = replace(found.prior, system=starts[k]) if starts else found.prior
        r = np.asarray(_at(prior, z, residuals))
        rest = np.arange(count) != k
        slope = np.einsum("pri,pr->i", J[rest], r[rest]) + np.asarray(z)
        step = np.linalg.solve(whole - squares[k], slope)
        press = jax.tree.map(lambda x, k=k: x[k], presses)
        missed = _at(prior, z - jnp.asarray(step), missed_of, press)
        wrench.append(np.mean(np.asarray(missed.wrench) ** 2, axis=0))
        if missed.depth is not None:
            told = np.asarray(missed.told)
            depth.append(np.mean(np.asarray(missed.depth)[told] ** 2) if told.any() else 0.0)
    few = float(scipy.special.stdtrit(count, 0.95)) / NORMAL_95
    of_depth = few * float(np.sqrt(np.mean(depth))) if depth else None
    return Spread(few * np.sqrt(np.mean(wrench, axis=0)), of_depth)


@eqx.filter_jit
def _at(prior: Prior, z: Array, function: Callable[..., Any], *given: Any) -> Any:
    """A function of the armor that has the unknowns z."""
    return function(prior.at(z), *given)
