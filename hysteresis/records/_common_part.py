"""What several input channels have in common, before any map of them is known."""

import numpy as np
from jaxtyping import Float


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
