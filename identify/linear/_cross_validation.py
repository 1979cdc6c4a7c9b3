"""Cross-validated, regularised linear least squares: what every such fit of this folder shares.

A problem forms the normal equations of each part of the rows once. Those of any choice of parts are their
sum, so that trying a prior strength on held-out parts does not touch the rows again.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeAlias, TypeVar

import numpy as np
from jaxtyping import Bool, Float

Problem = TypeVar("Problem")


Equations: TypeAlias = tuple[Float[np.ndarray, "rows unknowns"], Float[np.ndarray, " rows"]]
"""The left and the right side of some equations."""


class NormalEquations(NamedTuple):
    """Normal equations of some rows: H = A'A, b = A'y, y'y, and how many rows."""

    H: Float[np.ndarray, "unknowns unknowns"]
    b: Float[np.ndarray, " unknowns"]
    yy: float
    rows: int

    def __add__(self, other: "NormalEquations") -> "NormalEquations":  # type: ignore[override]
        return NormalEquations(
            self.H + other.H, self.b + other.b, self.yy + other.yy, self.rows + other.rows
        )

    def squared_error(self, z: Float[np.ndarray, " unknowns"]) -> float:
        """|A z - y|^2."""
        return float(max(z @ self.H @ z - 2 * self.b @ z + self.yy, 0.0))

    @property
    def means(
        self,
    ) -> tuple[Float[np.ndarray, "unknowns unknowns"], Float[np.ndarray, " unknowns"]]:
        """H and b over the number of rows, so that a prior's strength means the same for any number."""
        return self.H / self.rows, self.b / self.rows


def normal_equations_of(
    A: Float[np.ndarray, "rows unknowns"],
    y: Float[np.ndarray, " rows"],
    parts: dict[int, Bool[np.ndarray, " rows"]],
) -> dict[int, NormalEquations]:
    """Those of each part of the rows of a dense problem A x = y."""
    # Of one array and its own transpose NumPy computes half.
    return {
        part: NormalEquations(B.T @ B, B.T @ v, float(v @ v), len(v))
        for part, rows in parts.items()
        for B, v in [(A[rows], y[rows])]
    }


def total(normal: Iterable[NormalEquations]) -> NormalEquations:
    """The normal equations of several parts together."""
    first, *rest = normal
    return sum(rest, first)


def jittered(H: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """H with what rounding may take from its eigenvalues on the diagonal, so that Cholesky's factorisation
    exists; in place."""
    H[np.diag_indices(len(H))] += np.finfo(float).eps * len(H) * np.trace(H)
    return H


def averaged(A: np.ndarray, y: np.ndarray, together: int) -> Equations:
    """The equations of so many neighbours averaged, times the root of their number."""
    if together == 1:
        return A, y
    first = np.arange(0, len(y), together)
    root = np.sqrt(np.diff(first, append=len(y)))
    return np.add.reduceat(A, first) / root[:, None], np.add.reduceat(y, first) / root


def joined(parts: list[Equations]) -> Equations:
    """Of several blocks, one after the other."""
    A, y = zip(*parts, strict=True)
    return np.concatenate(A), np.concatenate(y)


@dataclass(frozen=True, eq=False)
class Choice(Generic[Problem]):
    """A problem with a prior strength, tried on held-out parts.

    - `blocks`: mean squared errors of blocks of held-out rows, over the square of the output's range.
    - `parts`: of a composition, those it has.
    """

    problem: Problem
    strength: float
    blocks: Float[np.ndarray, " blocks"]
    parts: tuple[str, ...] = ()
