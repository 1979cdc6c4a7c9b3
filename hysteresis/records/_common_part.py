"""What several input channels have in common, before any map of them is known."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int

STILL = 0.02
"""Part of its range over all sequences within which a condition stays in each."""


def common_part(
    channels: Float[np.ndarray, "samples channels"], output: Float[np.ndarray, " samples"]
) -> Float[np.ndarray, " samples"]:
    """What the channels have in common, in standard deviations: their first principal component.

    It tells where cycles begin before anything is fitted. Each channel counts by its standard deviation,
    and the sign is the one with which it rises with the output; NaN where a channel is.
    """
    whole = np.isfinite(channels).all(1)
    known = channels[whole] if whole.any() else np.zeros((1, channels.shape[1]))
    spread = known.std(0)
    x = (channels - known.mean(0)) / np.where(spread > 0, spread, np.inf)
    direction = np.linalg.eigh(x[whole].T @ x[whole])[1][:, -1]
    s = x @ direction
    both = whole & np.isfinite(output)
    return -s if both.sum() > 1 and np.cov(s[both], output[both])[0, 1] < 0 else s


def constant_within(
    channels: Mapping[str, Float[np.ndarray, " samples"]], starts: Int[np.ndarray, " sequences"]
) -> str | None:
    """The one channel that stays in every sequence and differs between them; None without one."""
    found = []
    for name, x in channels.items():
        if len(x) and np.isfinite(x).all():
            within = np.maximum.reduceat(x, starts) - np.minimum.reduceat(x, starts)
            if np.ptp(x) > 0 and within.max() <= STILL * np.ptp(x):
                found.append(name)
    return found[0] if len(found) == 1 else None
