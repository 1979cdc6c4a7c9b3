"""What an input leaves behind: stop operators, and what is left of it less its exponential averages.

    stop_k = u_k - play_k,  play_k = max(u_k - r, min(u_k + r, play_(k-1))),  play_0 = u_1
    slow' = u' - slow / time,  slow at the first row = 0, exact for an input that jumps at the rows

Source: Brokate and Sprekels, Hysteresis and Phase Transitions (1996), section 2.1.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from ._blocked_recurrences import relaxed


def stops(
    u: Float[np.ndarray, " rows"],
    radii: Float[np.ndarray, " stops"],
    out: Float[np.ndarray, "rows stops"] | None = None,
) -> Float[np.ndarray, "rows stops"]:
    """Stop operators of these radii, which begin at rest."""
    found = np.empty((len(u), len(radii))) if out is None else out
    play = np.repeat(u[:1, None], len(radii), axis=1)
    for run in _monotone(u):
        # On a monotone run the play of each row follows from the one before the run.
        at = u[run, None]
        reached = np.minimum(np.maximum(play, at - radii), at + radii)
        found[run] = at - reached
        play = reached[-1:]
    return found


def slow_states(
    u: Float[np.ndarray, " rows"],
    t: Float[np.ndarray, " rows"],
    times: Float[np.ndarray, " states"],
    out: Float[np.ndarray, "rows states"] | None = None,
) -> Float[np.ndarray, "rows states"]:
    """The input less its exponential averages over these times, which begin at the first input."""
    found = np.empty((len(u), len(times))) if out is None else out
    step, rise = np.diff(t, prepend=t[0]), np.diff(u, prepend=u[0])
    for k, time in enumerate(times):  # one after the other: each takes six columns of memory
        keep = np.exp(-step / time)[:, None]
        # What is left over of each rise of the input.
        drive = (keep[:, 0] * rise)[:, None, None]
        found[:, k] = relaxed(keep, drive, np.zeros((1, 1)))[:, 0, 0]
    return found


def _monotone(u: Float[np.ndarray, " rows"]) -> Iterator[slice]:
    """Runs in which an input goes one way; each begins behind the end of the one before."""
    step = np.sign(np.diff(u))
    moves = np.flatnonzero(step)
    turns = moves[1:][step[moves[1:]] != step[moves[:-1]]] if len(moves) else moves
    edges = [0, *(turns + 1).tolist(), len(u)]
    for begin, end in pairwise(edges):
        if end > begin:
            yield slice(begin, end)
