"""What an input leaves behind: stop operators, and what is left of it less its exponential averages.

    stop_k = u_k - play_k,  play_k = max(u_k - r, min(u_k + r, play_(k-1))),  play_0 = u_1
    slow' = u' - slow / time,  slow at the first row = 0, exact for an input that jumps at the rows

Source: Brokate and Sprekels, Hysteresis and Phase Transitions (1996), section 2.1.
"""

import numpy as np
from jaxtyping import Float

from ._blocked_recurrences import clamped, relaxed


def stops(
    u: Float[np.ndarray, " rows"], radii: Float[np.ndarray, " stops"]
) -> Float[np.ndarray, "rows stops"]:
    """Stop operators of these radii, which begin at rest."""
    u = u[:, None]
    return u - clamped(u - radii, u + radii, np.repeat(u[0], len(radii)))


def slow_states(
    u: Float[np.ndarray, " rows"],
    t: Float[np.ndarray, " rows"],
    times: Float[np.ndarray, " states"],
) -> Float[np.ndarray, "rows states"]:
    """The input less its exponential averages over these times, which begin at the first input."""
    keep = np.exp(-np.diff(t, prepend=t[0])[:, None] / times)
    drive = keep * np.diff(u, prepend=u[0])[:, None]
    return relaxed(keep, drive[..., None], np.zeros((len(times), 1)))[..., 0]
