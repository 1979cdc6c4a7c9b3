"""What an input leaves behind: stop operators, and what is left of it less its exponential averages.

    stop_k = u_k - play_k,  play_k = max(u_k - r, min(u_k + r, play_(k-1))),  play_0 = u_1
    slow' = u' - slow / time,  slow at the first row = 0, exact for an input that jumps at the rows

Source: Brokate and Sprekels, Hysteresis and Phase Transitions (1996), section 2.1.
"""

import numpy as np
from jaxtyping import Float

from ._blocked_recurrences import clamped, relaxed

Rows = Float[np.ndarray, " rows"]
Columns = Float[np.ndarray, "rows columns"]


def stops(u: Rows, radii: Float[np.ndarray, " stops"], out: Columns | None = None) -> Columns:
    """Stop operators of these radii, which begin at rest."""
    found = np.empty((len(u), len(radii))) if out is None else out
    for k, r in enumerate(radii):  # one after the other: each takes six columns of memory
        found[:, k] = u - clamped(u[:, None] - r, u[:, None] + r, u[:1])[:, 0]
    return found


def slow_states(
    u: Rows, t: Rows, times: Float[np.ndarray, " states"], out: Columns | None = None
) -> Columns:
    """The input less its exponential averages over these times, which begin at the first input."""
    found = np.empty((len(u), len(times))) if out is None else out
    step, rise = np.diff(t, prepend=t[0]), np.diff(u, prepend=u[0])
    for k, time in enumerate(times):  # as above
        keep = np.exp(-step / time)[:, None]
        # What is left over of each rise of the input.
        drive = (keep[:, 0] * rise)[:, None, None]
        found[:, k] = relaxed(keep, drive, np.zeros((1, 1)))[:, 0, 0]
    return found
