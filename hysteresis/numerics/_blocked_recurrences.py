"""Recurrences over many rows in NumPy, compiled for no length.

The rows are cut into as many segments as each has rows. All segments run side by side, from an unknown
state; a second, short loop then hands the state from one segment to the next. A million rows take two loops
of a thousand steps instead of one of a million.
"""

from itertools import pairwise

import numpy as np
from jaxtyping import Float

Columns = Float[np.ndarray, "rows columns"]


def relaxed(
    decay: Float[np.ndarray, "rows times"],
    drive: Float[np.ndarray, "rows times columns"],
    state: Float[np.ndarray, "times columns"],
) -> Float[np.ndarray, "rows times columns"]:
    """x_k = decay_k x_(k-1) + drive_k, with x before the first row = `state`."""
    rows = len(drive)
    if not drive.size:
        return drive
    steps = _segment(rows)
    x, kept = _cut(drive, steps, 0.0), _cut(decay, steps, 1.0)[..., None]
    for k in range(1, steps):
        x[:, k] += kept[:, k] * x[:, k - 1]
        kept[:, k] *= kept[:, k - 1]
    for one, share in zip(x, kept, strict=True):
        one += share * state
        state = one[-1]
    return x.reshape(-1, *drive.shape[1:])[:rows]


def clamped(low: Columns, high: Columns, state: Float[np.ndarray, " columns"]) -> Columns:
    """z_k = clip(z_(k-1), low_k, high_k), with z before the first row = `state`.

    Two clamps one after the other are one clamp. The upper end counts where `low` is above it.
    """
    rows = len(low)
    if not low.size:
        return low
    steps = _segment(rows)
    low, high = _cut(low, steps, -np.inf), _cut(high, steps, np.inf)
    for k in range(1, steps):
        least, most = low[:, k].copy(), high[:, k].copy()
        low[:, k] = np.minimum(np.maximum(low[:, k - 1], least), most)
        high[:, k] = np.minimum(np.maximum(high[:, k - 1], least), most)
    z = np.empty_like(low)
    for one, least, most in zip(z, low, high, strict=True):
        np.minimum(np.maximum(state, least), most, out=one)
        state = one[-1]
    return z.reshape(-1, low.shape[-1])[:rows]


def running(
    extreme: np.ufunc, x: Float[np.ndarray, " rows"], first: np.ndarray, state: float
) -> Float[np.ndarray, " rows"]:
    """The extreme (np.maximum or np.minimum) so far, anew at the rows `first`; `state` before row 0."""
    found = np.concatenate([[state], x])
    edges = np.unique(np.concatenate([[0], first[first > 0] + 1, [len(found)]]))
    if (first == 0).any():
        found[0] = x[0]
    for a, b in pairwise(edges):
        extreme.accumulate(found[a:b], out=found[a:b])
    return found[1:]


def _segment(rows: int) -> int:
    return int(np.ceil(np.sqrt(rows)))


def _cut(x: np.ndarray, steps: int, fill: float) -> np.ndarray:
    """(segments, steps, ...), a copy, padded with `fill`."""
    segments = -(-len(x) // steps)
    found = np.full((segments * steps, *x.shape[1:]), fill)
    found[: len(x)] = x
    return found.reshape(segments, steps, *x.shape[1:])
