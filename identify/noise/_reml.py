"""Restricted maximum likelihood (REML) of a noise model of one kind, together with the model's parameters.

The problem is small and its shapes are many, so NumPy and SciPy solve it: nothing is compiled.
"""

from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import OptimizeResult, minimize

from hysteresis import InputError

from .._levels import NOTHING, STILL
from ._arithmetic import Arithmetic, Rows

PARTS = ("sigma", "growth", "input_sigma", "misfit", "phi", "theta", "tail")
"""The parts a noise model may have, in the order of their unconstrained parameters."""

WITHIN = -float(np.log(NOTHING))
"""The search stays between minus this and this, unconstrained: phi up to 0.999998."""


class Linearised(NamedTuple):
    """A model linearised about z, and the rows it predicts:

    residuals r(z + d) = residuals + jacobian d,     -log prior(z + d) = pull'd + d'precision d / 2.
    """

    residuals: Float[Array | np.ndarray, " rows"]
    jacobian: Float[Array | np.ndarray, "rows parameters"]
    rows: Rows
    pull: Float[Array | np.ndarray, " parameters"]
    precision: Float[Array | np.ndarray, "parameters parameters"]


class NoiseFit(NamedTuple):
    """The restricted maximum likelihood of one kind of noise.

    - `free`: the noise's parameters in unconstrained space, in the order of `PARTS`; -inf for parts of
      other kinds.
    - `away`: the change d of the model's parameters that goes with it.
    - `cost`: -log of the restricted likelihood.
    """

    free: Float[np.ndarray, " parts"]
    away: Float[np.ndarray, " parameters"]
    cost: float


def kinds(noise: str) -> tuple[tuple[str, ...], ...]:
    """The parts of every kind of noise to try, the simplest first.

    `noise`: "auto", or any of gaussian, student-t, ar1, arma11, growing, input and misfit, joined by +.

    Raises `InputError` for another word, and for a misfit with Student's t, which has no closed form.
    """
    if noise == "auto":
        correlated = ((), ("phi",), ("phi", "theta"))
        choices = product(correlated, ((), ("tail",)), ((), ("growth",)))
        found = [("sigma", *c, *t, *g) for c, t, g in choices]
        return tuple(sorted(found, key=len))
    meaning = {
        "gaussian": (), "student-t": ("tail",), "ar1": ("phi",), "arma11": ("phi", "theta"),
        "growing": ("growth",), "input": ("input_sigma",), "misfit": ("misfit",),
    }  # fmt: skip
    words = [word.strip() for word in noise.split("+")]
    if odd := [word for word in words if word not in meaning]:
        raise InputError(
            "bad-option",
            f"no noise {odd[0]!r}; have auto, or {', '.join(meaning)} with + between.",
        )
    if {"misfit", "student-t"} <= set(words):
        raise InputError(
            "bad-option", "a misfit goes with Gaussian noise only.", fix="leave out student-t."
        )
    return (("sigma", *dict.fromkeys(part for word in words for part in meaning[word])),)


def of_free(
    free: Float[np.ndarray, " parts"],
    kind: tuple[str, ...],
    sizes: Float[np.ndarray, " parts"] | float = 1.0,
) -> Arithmetic:
    """The noise of one kind from unconstrained parameters, as in `Transform`; `sizes` multiply the positive
    ones."""
    positive = (sizes * np.exp(free))[:4]
    values = [*positive, *np.tanh(free[4:6] / 2), 0.5 / (1 + np.exp(-free[6]))]
    return Arithmetic(
        **{part: float(x) for part, x in zip(PARTS, values, strict=True) if part in kind}
    )


def noise_fit(
    at: Linearised,
    kind: tuple[str, ...],
    near: Float[np.ndarray, " parts"] | None = None,
) -> NoiseFit:
    """Estimate the noise of one kind and the change d of the model by restricted maximum likelihood.

    It minimises -log p(r + J d | noise) - log prior + log det(J'J + precision, whitened) / 2. The last term
    accounts for the degrees of freedom that the model's parameters use. For Gaussian noise the result is
    the marginal likelihood of the noise, integrated over d, and d follows from the noise in closed form.
    For Student's t both are sought together. `near`: unconstrained parameters to start from.

    Source: Patterson, Thompson, Recovery of inter-block information when block sizes are unequal,
    Biometrika 58 (1971).
    """
    counted = np.where(at.rows.counted, 1.0, 0.0)
    weight = counted * np.asarray(at.rows.weight)
    size = float(np.sqrt(np.sum((weight * at.residuals) ** 2) / counted.sum())) or 1.0
    J, residuals, pull = map(np.asarray, (at.jacobian, at.residuals, at.pull))
    basis, seen = _basis(J * weight[:, None], size)
    # Of the positive parts: residuals, the largest output, the largest slope, residuals.
    largest = [np.max(np.abs(counted * x)) for x in (at.rows.output, at.rows.slope)]
    positive = np.array([1.0, *(x if x > 0 else 1.0 for x in largest), 1.0])
    sizes = np.append(size / positive, np.ones(3))
    seek = _Sought(
        residuals * counted, J @ basis, at.rows, pull @ basis,
        basis.T @ at.precision @ basis, np.diag(np.where(seen, 0.0, counted.sum())),
        float(counted.sum()), kind, sizes,
    )  # fmt: skip
    begin = np.zeros(len(PARTS)) if near is None else near - np.log(sizes)
    # A part that the estimate near by did not have, or that went to its bound, starts anew, at 0: as large
    # as the residuals, not correlated, with four degrees of freedom.
    begin = np.where(begin > 1 - WITHIN, begin, 0.0)
    start = seek.free_of(begin[seek.moves])[seek.moves]
    if "tail" in kind:
        start = np.append(start, np.zeros(len(at.pull)))
    student = "tail" in kind
    found = minimize(
        seek.by_student if student else seek.by_gaussian,
        start, jac=True, method="BFGS", callback=_Stands(), options={"gtol": 1e-7, "maxiter": 100},
    )  # fmt: skip
    free = seek.free_of(found.x[: len(seek.moves)])
    cost, d = seek.student(free, found.x[len(seek.moves) :]) if student else seek.gaussian(free)
    return NoiseFit(free + np.log(sizes), basis @ d, cost)


class _Stands:
    """Ends a search where the cost a row stands still: a part of the noise that is not there goes to 0 for
    ever."""

    def __init__(self) -> None:
        self.last = np.inf

    def __call__(self, intermediate_result: OptimizeResult) -> None:
        now = float(intermediate_result.fun)
        if now > self.last - STILL:
            raise StopIteration
        self.last = now


class _Sought(NamedTuple):
    """The cost of one kind of noise; columns are an orthogonal `_basis` of the model's directions."""

    residuals: Float[np.ndarray, " rows"]
    columns: Float[np.ndarray, "rows parameters"]
    rows: Rows
    pull: Float[np.ndarray, " parameters"]
    precision: Float[np.ndarray, "parameters parameters"]
    unseen: Float[np.ndarray, "parameters parameters"]
    count: float
    kind: tuple[str, ...]
    sizes: Float[np.ndarray, " parts"]

    @property
    def moves(self) -> list[int]:
        """Places of the parts that the kind has."""
        return [k for k, part in enumerate(PARTS) if part in self.kind]

    def free_of(self, x: np.ndarray) -> np.ndarray:
        """All unconstrained parameters, inside the bounds of the search."""
        free = np.full(len(PARTS), -np.inf)
        free[self.moves] = np.clip(x, -WITHIN, WITHIN)
        return free

    def noise(self, free: np.ndarray) -> Arithmetic:
        return of_free(free, self.kind, self.sizes)

    def rest(self, free: np.ndarray, d: np.ndarray, information: np.ndarray) -> float:
        """The prior's and the determinant's part of the cost."""
        whole = (information + self.precision + self.unseen) / self.count
        prior = self.pull @ d + d @ self.precision @ d / 2
        prior -= float(np.sum(log_prior(free)[self.moves]))
        return float(np.linalg.slogdet(whole)[1]) / 2 + float(prior)

    def gaussian(self, free: np.ndarray) -> tuple[float, np.ndarray]:
        """Cost, and the change d of the model that is best under this noise."""
        noise = self.noise(free)
        whole = noise.whitened(np.column_stack([self.residuals, self.columns]), self.rows)
        G = noise.products(whole, self.rows)
        H = G[1:, 1:] + self.precision + self.unseen
        d = -np.linalg.solve(H, G[0, 1:] + self.pull)
        squares = G[0, 0] + 2 * G[0, 1:] @ d + d @ G[1:, 1:] @ d
        return squares / 2 - float(noise.log_constant(self.rows)) + self.rest(free, d, G[1:, 1:]), d

    def student(self, free: np.ndarray, d: np.ndarray, rounds: int = 4) -> tuple[float, np.ndarray]:
        """Cost, and the change d under this noise to full accuracy, by Newton's method from near by."""
        noise = self.noise(free)
        W = noise.whitened(self.columns, self.rows)
        for _ in range(rounds):
            x = noise.whitened(self.residuals + self.columns @ d, self.rows)
            slope = W.T @ score(noise, x) + self.pull + self.precision @ d
            heavy = noise.tail * x**2
            curved = (1 + noise.tail) * (1 - heavy) / (1 + heavy) ** 2
            H = (W * curved[:, None]).T @ W + self.precision + self.unseen
            if np.linalg.eigvalsh(H)[0] <= 0:  # far from the optimum: reweighted least squares
                H = (
                    (W * ((1 + noise.tail) / (1 + heavy))[:, None]).T @ W
                    + self.precision
                    + self.unseen
                )
            d = d - np.linalg.solve(H, slope)
        likelihood = float(noise.log_likelihood(self.residuals + self.columns @ d, self.rows))
        return self.rest(free, d, float(noise.information) * W.T @ W) - likelihood, d

    def by_gaussian(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Cost a row, and its gradient by differences."""

        def cost(x: np.ndarray) -> float:
            return self.gaussian(self.free_of(x))[0] / self.count

        return cost(x), _differences(cost, x)

    def by_student(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Cost a row of noise and d, and its gradient: by differences for the noise, exactly for d."""
        few = len(self.moves)
        d = x[few:]
        r = self.residuals + self.columns @ d

        def cost(x: np.ndarray) -> float:
            free = self.free_of(x)
            noise = self.noise(free)
            W = noise.whitened(self.columns, self.rows)
            likelihood = float(noise.log_likelihood(r, self.rows))
            information = float(noise.information) * W.T @ W
            return (self.rest(free, d, information) - likelihood) / self.count

        noise = self.noise(self.free_of(x[:few]))
        pulled = noise.whitened(np.column_stack([r, self.columns]), self.rows)
        slope = pulled[:, 1:].T @ score(noise, pulled[:, 0]) + self.pull + self.precision @ d
        return cost(x[:few]), np.append(_differences(cost, x[:few]), slope / self.count)


def score(noise: Arithmetic, x: np.ndarray) -> np.ndarray:
    """-d log density / dx of whitened residuals."""
    tail = 0.0 if noise.tail is None else float(noise.tail)
    return (1 + tail) * x / (1 + tail * x**2)


def _differences(cost: Callable[[np.ndarray], float], x: np.ndarray, h: float = 1e-5) -> np.ndarray:
    """The gradient by central differences."""
    steps = h * np.eye(len(x))
    return np.array([(cost(x + step) - cost(x - step)) / (2 * h) for step in steps])


def _basis(J: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Orthogonal changes of the parameters that each move the output by `size`, so that the search is well
    conditioned, and which of them move it at all; the others are zero."""
    gram = J.T @ J
    norm = np.sqrt(np.diagonal(gram))
    norm = np.where(norm > 0, norm, 1.0)
    values, vectors = np.linalg.eigh(gram / np.outer(norm, norm))
    seen = values > 1e-12
    width = size * np.sqrt(len(J) / np.where(seen, values, 1.0))
    return vectors / norm[:, None] * np.where(seen, width, 0.0)[None], seen


def log_prior(free: Float[np.ndarray, " parts"]) -> Float[np.ndarray, " parts"]:
    """Weak log-priors of the noise: flat, except near the bounds of phi, theta and tail.

    They are no stronger than that, because the full Jacobian of the transform pulls phi towards 0, which
    makes standard errors too small.
    """
    fence = -np.logaddexp(0.0, -free[4:]) - np.logaddexp(0.0, free[4:])
    return np.concatenate([np.zeros(4), 0.1 * fence])
