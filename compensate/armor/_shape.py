"""The interface of a shape that the solver uses."""

import abc
from collections.abc import Callable

import equinox as eqx
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from ._faces import Faces


class AbstractShape(eqx.Module):
    """The outer surface of a robot, seen from P_o, the point that moments are taken about."""

    @abc.abstractmethod
    def faces(self, near: Int[Array, " near"] | None = None) -> Faces:
        """All its plane faces; or those of `nearby`."""

    @abc.abstractmethod
    def nearby(
        self,
        force: Array,
        moment: Array,
        most: Callable[[Array], Array],
        threshold: ArrayLike,
        tolerance: ArrayLike,
    ) -> Int[Array, "*contacts near"] | None:
        """Which faces each line of action can have met, counted from 0 and filled up with -1.

        None: every one is to be looked at.

        **Arguments:** `force`, `moment`: (..., 3); `most`: from cosines (n,) to (..., n), m, how far
        n.F = |F| cosine can press a face in at most; `threshold`, N: below which a face is not pushed;
        `tolerance`, m: how far beyond a face's edge a contact may lie.
        """

    @abc.abstractmethod
    def longest(self) -> Float[Array, ""]:
        """The longest side of the box around it, m."""
