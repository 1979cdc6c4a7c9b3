"""Errors of a calibrated armor in presses that it has not seen: every press is left out in turn.

What a calibration leaves of its own presses is too small a measure: matrix, slip and cover were found from
them, and errors within a press are one draw, however many samples it has.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from compensate.armor import Armor, Presses, PressResiduals
from compensate.armor._calibration import Missed, missed_of
from hysteresis.numerics._normal import NORMAL_95
from identify.calibration._calibrate import Calibration, Prior


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
        prior = found.prior
        if starts:
            prior = eqx.tree_at(lambda p: p.system, prior, starts[k])
        r = np.asarray(_residuals_at(residuals, prior, z))
        rest = np.arange(count) != k
        slope = np.einsum("pri,pr->i", J[rest], r[rest]) + np.asarray(z)
        step = np.linalg.solve(whole - squares[k], slope)
        press = jax.tree.map(lambda x, k=k: x[k], presses)
        missed = _missed_at(prior, z - jnp.asarray(step), press)
        wrench.append(np.mean(np.asarray(missed.wrench) ** 2, axis=0))
        if missed.depth is not None:
            told = np.asarray(missed.told)
            depth.append(np.mean(np.asarray(missed.depth)[told] ** 2) if told.any() else 0.0)
    few = float(scipy.special.stdtrit(count, 0.95)) / NORMAL_95
    of_depth = few * float(np.sqrt(np.mean(depth))) if depth else None
    return Spread(few * np.sqrt(np.mean(wrench, axis=0)), of_depth)


@eqx.filter_jit
def _residuals_at(
    residuals: PressResiduals, prior: Prior, z: Array
) -> Float[Array, "presses residuals"]:
    return residuals(prior.at(z))


@eqx.filter_jit
def _missed_at(prior: Prior, z: Array, press: Presses) -> Missed:
    return missed_of(prior.at(z), press)
