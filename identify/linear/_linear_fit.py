"""A model that is linear in its unknowns, fitted: the minimum, and the posterior about it."""

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from jaxtyping import Float

from hysteresis import AbstractModel

from ..noise._residual_statistics import Noise
from ._composition import CompositionUnknowns
from ._conditioned_unknowns import ConditionedUnknowns
from ._preisach_unknowns import GridUnknowns
from ._projected_draws import Tell, projected_draws, variance_of_unknowns

Unknowns = TypeVar("Unknowns", GridUnknowns, CompositionUnknowns, ConditionedUnknowns)
"""What the unknowns of a linear model stand for.

`model` makes the model of them, `minimum` finds them among the possible models, `scale` is their unit of
the output, and the rows of `totals` sum them up to what `total_names` names.
"""


@dataclass(frozen=True, eq=False)
class LinearFit(Generic[Unknowns]):
    """A linear model fitted, and what its posterior needs.

    - `unknowns`: those at the minimum, `meaning` what they stand for.
    - `H`, `b`: the minimised x'Hx/2 - b'x over `rows` rows, prior included.
    - `strength`: of the prior; `dropped`: whether the fit leaves out the conditioning cycle.
    - `blocks`: held-out mean squared errors, over scale^2, at that choice.
    """

    unknowns: Float[np.ndarray, " unknowns"]
    meaning: Unknowns
    H: Float[np.ndarray, "unknowns unknowns"]
    b: Float[np.ndarray, " unknowns"]
    rows: int
    strength: float
    blocks: Float[np.ndarray, " blocks"]
    dropped: bool = False

    @property
    def model(self) -> AbstractModel:
        """The model of the unknowns."""
        return self.meaning.model(self.unknowns)

    @property
    def held_out(self) -> float:
        """The mean squared held-out error, in the output's unit squared."""
        return float(self.blocks.mean()) * self.meaning.scale**2

    def draws(
        self,
        noise: Noise,
        count: int,
        random: np.random.Generator,
        tell: Tell = lambda done: None,
    ) -> Float[np.ndarray, "count unknowns"]:
        """Draws from the projected Gaussian posterior, see `projected_draws`."""

        def project(moved: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " unknowns"]:
            return self.meaning.minimum(self.H, moved, self.unknowns != 0)

        variance = variance_of_unknowns(noise, self.meaning.scale, self.rows)
        return projected_draws(self.H, self.b, project, variance, count, random, tell)

    def totals(
        self, noise: Noise, count: int, random: np.random.Generator
    ) -> tuple[Float[np.ndarray, " sums"], Float[np.ndarray, "sums sums"]]:
        """The sums that tell what each part of the model does, in the output's unit, and their covariance.

        The covariance is that of projected draws about the fit, not about their mean: where the data leave
        much open the signs push the draws to one side, and the error has to reach there.
        """
        sums, scale = self.meaning.totals, self.meaning.scale
        values = scale * sums @ self.unknowns
        deviations = scale * self.draws(noise, count, random) @ sums.T - values
        return values, deviations.T @ deviations / count
