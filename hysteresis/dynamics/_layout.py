"""The parts of a hysteresis as the arrays that the compiled loop takes."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from .._model import AbstractModel
from ..models._compose import Sum
from ._generalized_plays import GeneralizedPlays
from ._rate_form import AbstractRateForm, BoucWenForce, DuhemForce


@dataclass
class Layout:
    """Knots of f+ and f-, and plays with the knots of their curves, with all heights in one array.

    - `rate`: (2, knots), of no knot where there is no part in rate form. `limit`: the outermost of them.
    - `radii`, `reach`: (plays,). `counts`: (plays,) knots of each curve. `heights`: of all curves.
    """

    rate: Float[np.ndarray, "2 knots"] = field(default_factory=lambda: np.zeros((2, 0)))
    limit: float = 1.0
    radii: Float[np.ndarray, " plays"] = field(default_factory=lambda: np.zeros(0))
    reach: Float[np.ndarray, " plays"] = field(default_factory=lambda: np.zeros(0))
    counts: Any = field(default_factory=lambda: np.zeros(0, np.int64))
    heights: Float[np.ndarray, " heights"] = field(default_factory=lambda: np.zeros(0))

    @property
    def first(self) -> np.ndarray:
        """The first height of each play, and the end."""
        return np.concatenate([[0], np.cumsum(self.counts)]).astype(np.int64)

    @property
    def parameters(self) -> int:
        """How many columns the sensitivities have."""
        from ._newmark_kernel import FIXED  # loads numba

        return FIXED + self.rate.size + len(self.heights)


def layout_of(model: AbstractModel) -> Layout | None:
    """The arrays of a hysteresis of one part in rate form at most and any plays; None of others."""
    parts = model.parts if isinstance(model, Sum) else (model,)
    found = Layout()
    for part in parts:
        if isinstance(part, AbstractRateForm):
            rate = _rate_of(part)
            if rate is None or found.rate.size:
                return None
            found.rate, found.limit = rate
        elif isinstance(part, GeneralizedPlays):
            found.radii = np.append(found.radii, np.asarray(part.radii, float))
            found.reach = np.append(found.reach, np.asarray(part.reach, float))
            found.counts = np.append(found.counts, part.knots).astype(np.int64)
            found.heights = np.append(found.heights, np.asarray(part.values, float))
        else:
            return None
    return found


def _rate_of(part: AbstractRateForm) -> tuple[np.ndarray, float] | None:
    """Values at knots and the outermost knot; None where f is not straight between knots."""
    if isinstance(part, DuhemForce):
        return np.stack([np.asarray(part.rising, float), np.asarray(part.falling, float)]), float(
            part.limit
        )
    if isinstance(part, BoucWenForce) and float(part.n) == 1.0:
        a, g, d = (float(x) for x in (part.alpha, part.beta_gamma, part.beta_delta))
        return np.array([[a + g - d, a, a - g - d], [a - g - d, a, a + g - d]]), 1.0
    return None
