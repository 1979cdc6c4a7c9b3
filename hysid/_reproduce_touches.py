"""A record to look at: the 45 points of one virtual rig, pressed and let go one after another."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from compensate.armor import Box, Contact, ContactSolver
from hysteresis.rigs import ForceSensor, force_path

from ._armor_touches import save_touches, shell_of
from ._reproduce_armor import Rig

STEP, SECONDS = 1.5, 0.1
"""N and s from sample to sample."""


def write_touches(rig: Rig, folder: Path) -> dict[str, Any]:
    """Write touches.json by condition (b), with the covariance that the sensor's data sheet implies."""
    points, surface = rig.soft.points_of_the_body()
    presses = rig.soft.press(
        points, surface, force_path((0.0, 15.0, 0.0), STEP), dt=SECONDS, session=2
    )
    wrench = presses.wrench.reshape(-1, 6)
    line = rig.lines["2"]
    solver = ContactSolver(Box(*rig.soft.size), line)
    contact = solver.solve(wrench[:, :3], wrench[:, 3:])
    scatter = 1e-3 * _misfit(rig)
    covariance = np.asarray(
        _covariance(solver, jnp.asarray(wrench), rig.soft.sensor, contact, scatter)
    )
    save_touches(
        folder, shell_of(solver.shape), SECONDS * np.arange(1, len(wrench) + 1),
        wrench[:, :3], wrench[:, 3:], contact, covariance=covariance,
        truth=presses.contact.reshape(-1, 3),
        title="Haptic armour: 45 presses of 15 N, approximation 2",
    )  # fmt: skip
    return {"presses": len(points), "rows": len(wrench), "rig": rig.seed}


def _misfit(rig: Rig) -> float:
    """mm, by which the foam's record leaves approximation 2."""
    cycles, line = rig.fresh, rig.lines["2"]
    used = cycles.force >= 2
    return float(np.std((line.K * cycles.force + line.b - cycles.displacement)[used]))


def _covariance(
    solver: ContactSolver,
    wrench: Float[Array, "times 6"],
    sensor: ForceSensor,
    contact: Contact,
    scatter: float,
) -> Float[Array, "times 3 3"]:
    """J C J' + s^2 u u': C of the wrench by noise and crosstalk, J = dP/dw, s of d_n, u = F/F_n.

    To first order; crosstalk with entries of standard deviation g_ij adds the variance
    sum_j (g_ij w_j)^2 to channel i.
    """
    arm = sensor.crosstalk_arm_m
    scale = sensor.crosstalk * np.kron([[1, 1 / arm], [arm, 1]], np.ones((3, 3)))
    noise = np.repeat([sensor.noise_n, sensor.noise_nm], 3)

    def point(w: Array) -> Array:
        return solver.solve(w[:3], w[3:]).point

    def one(w: Array, normal_force: Array) -> Array:
        J = jax.jacfwd(point)(w)
        variance = noise**2 + jnp.sum((scale * w[None, :]) ** 2, axis=1)
        u = w[:3] / jnp.maximum(normal_force, 1e-3)
        return (J * variance[None, :]) @ J.T + scatter**2 * jnp.outer(u, u)

    return jax.jit(jax.vmap(one))(wrench, contact.normal_force)
