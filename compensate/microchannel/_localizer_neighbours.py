"""Localisation by k nearest neighbours, as in the paper."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from hysteresis import InputError, register


@register
@dataclass(frozen=True)
class Neighbours:
    """k nearest neighbours among the training presses, by the readings' Euclidean distance.

    Places with more training presses have more neighbours: the counts act as priors.

    Source: Kim and Park (2018), section III.B; their k is not printed.
    """

    readings: Float[np.ndarray, "presses channels"]
    place: Int[np.ndarray, " presses"]
    neighbours: int

    def probabilities(
        self, readings: Float[np.ndarray, "presses channels"]
    ) -> Float[np.ndarray, "presses places"]:
        """The part of the neighbours at each place."""
        return self._voters.predict_proba(readings)

    @cached_property
    def _voters(self) -> Any:
        try:
            from sklearn.neighbors import KNeighborsClassifier
        except ImportError as error:
            raise InputError(
                "missing-extra", "nearest neighbours need scikit-learn, which is not installed.",
                fix="pip install 'hysid[microchannel]', or method=\"gaussian\".",
            ) from error  # fmt: skip
        return KNeighborsClassifier(self.neighbours).fit(self.readings, self.place)
