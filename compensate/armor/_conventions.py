"""Which convention of signs and units a recording of wrenches was made in."""

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from ..runtime._contact_status import ContactStatus
from ._solver import ContactSolver

_OTHERS = (
    ("the moment is what the sensor reacts with", 1.0, -1.0),
    ("force and moment are what the sensor reacts with", -1.0, -1.0),
    ("the force is what the sensor reacts with", -1.0, 1.0),
    ("the moment is in N mm", 1.0, 1e-3),
    ("the moment is in N cm", 1.0, 1e-2),
)


def convention_doubt(solver: ContactSolver, force: ArrayLike, moment: ArrayLike) -> str | None:
    """Check the frame, signs and units of recorded wrenches: why so many lines of action miss the shell.

    A wrench in another frame, or with another sign, is still a valid wrench; but its line of action misses
    the shell. This function tries other interpretations of the same numbers. It reports the best one if a
    tenth or more of the lines miss the shell as given, and at most a quarter as many miss it in that
    interpretation.

    **Arguments:** `force`, `moment` (samples, 3), as for `ContactSolver.solve`: tens of contacts or more,
    on several surfaces. Samples below the threshold are ignored.

    **Returns:** a sentence, or None where most lines meet the shell or no interpretation explains the rest.

    **Example:**

        >>> force = np.tile([[0.0, 0.0, -10.0], [-10.0, 0.0, 0.0]], (20, 1))
        >>> moment = 1000 * np.cross([0.1, 0.05, 0.5], force)  # in N mm instead of N m
        >>> compensate.armor.convention_doubt(solver, force, moment)
        '0% of the lines of action meet the shell, 100% if the moment is in N mm.'
    """
    force, moment = jnp.asarray(force, float), jnp.asarray(moment, float)
    strong = jnp.linalg.norm(force, axis=-1) >= solver.threshold
    force, moment = force[strong], moment[strong]

    def hits(sign: float, scale: float) -> float:
        status = np.asarray(solver.solve(sign * force, scale * moment).status)
        return float(np.isin(status, (ContactStatus.OK, ContactStatus.AMBIGUOUS)).mean())

    if not len(force) or (plain := hits(1.0, 1.0)) > 0.9:
        return None
    best = max(_OTHERS, key=lambda other: hits(*other[1:]))
    told, share = best[0], hits(*best[1:])
    if 1 - share > (1 - plain) / 4:
        return None
    return f"{plain:.0%} of the lines of action meet the shell, {share:.0%} if {told}."
