"""What a sampler hands over, whichever it was."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Progress = Callable[[int, int, str], None]
"""Called now and then with steps done, steps in all as far as they are known, and a few words."""


class Chains(NamedTuple):
    """Draws in the free space after burn-in. Chains are independent; walkers of one are not.

    - `points`, `log_probability`: (chains, steps, walkers, parameters), (chains, steps, walkers).
    - `rhat`, `ess`: of every parameter. `autocorrelation`: the longest, in steps.
    - `thin`: steps between draws worth keeping.
    - `long_enough`: whether the chains hold so many autocorrelation times that those can be believed.
    - `acceptance`: part of the proposals taken; `statistics`: more of it, (chains, ...).
    - `method`, `notes`: what was done, and what to mind, in words.
    """

    points: Float[np.ndarray, "chains steps walkers parameters"]
    log_probability: Float[np.ndarray, "chains steps walkers"]
    rhat: Float[np.ndarray, " parameters"]
    ess: Float[np.ndarray, " parameters"]
    thin: int
    autocorrelation: float
    long_enough: bool
    acceptance: float
    statistics: dict[str, np.ndarray]
    method: str
    notes: tuple[str, ...]

    @property
    def thinned(self) -> Float[np.ndarray, "chains draws parameters"]:
        """The draws worth keeping of each chain, over all its walkers."""
        chains, _, _, parameters = self.points.shape
        return self.points[:, :: self.thin].reshape(chains, -1, parameters)
