"""A record to look at: the 45 points of one virtual rig, pressed and let go one after another."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from compensate.armor import Box, ContactSolver
from hysteresis.rigs import force_path

from ..armor._touches import VIRTUAL, save_touches, shell_of
from ._armor import Rig
from ._armor_ours import covariances, followed

STEP, SECONDS = 1.5, 0.1
"""N and s from sample to sample."""


def write_touches(rig: Rig, folder: Path, with_ours: bool) -> dict[str, Any]:
    """Write touches.json by our method with covariances, or by condition (b) without any."""
    points, surface = rig.soft.points_of_the_body()
    path = force_path((0.0, 15.0, 0.0), STEP)
    presses = rig.soft.press(points, surface, path, dt=SECONDS, session=2)
    wrench = presses.wrench.reshape(-1, 6)
    force, moment = wrench[:, :3], wrench[:, 3:]
    solver = ContactSolver(Box(*rig.soft.size), rig.lines["2"])
    if with_ours:
        found = followed(
            rig.calibrated.uncertain, jnp.asarray(presses.time), jnp.asarray(presses.wrench)
        )
        covariance = np.asarray(covariances(found)).reshape(-1, 3, 3)
        contact = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), found.contact)
        title = "calibrated by twenty presses"
    else:
        contact, covariance = solver.solve(force, moment), None
        title = "approximation 2"
    save_touches(
        folder, shell_of(solver.shape), SECONDS * np.arange(1, len(wrench) + 1), force, moment,
        contact, covariance=covariance, truth=presses.contact.reshape(-1, 3),
        title=f"Haptic armour: 45 presses of 15 N, {title}{VIRTUAL}",
    )  # fmt: skip
    return {"presses": len(points), "rows": len(wrench), "rig": rig.seed}
