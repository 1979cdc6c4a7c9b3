"""How the walkers of several ensembles move, side by side: emcee's interface for moves."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

INDEPENDENT, JUMPS = 0.5, 0.05
"""Parts of the steps: proposals from about the fit, and of the whole difference of two walkers, which leads
from mode to mode. The others are differential evolution's."""

LogProbability = Callable[[np.ndarray], np.ndarray]
"""Of many points at once: (points, parameters) -> (points,)."""

DEGREES = 5.0
"""Of freedom of the proposals from about the fit: their tails are longer than a normal posterior's."""


class SideBySide:
    """A move of emcee's, for several ensembles that do not see each other.

    Each ensemble is halved at random, and the walkers x of one half propose, all in the same way,

        x + g (1 + 1e-5 n) (a - b),      a and b two walkers of the other half, n normal,
        place + root t,                  t of a Student distribution in as many dimensions,

    with g = 2.38 / sqrt(2 parameters), sometimes 1. The first is emcee's `DEMove`; the second an
    independence sampler about the fit, whose draws are new ones where the posterior is near to normal.
    Autocorrelation times on Burgers and on a Gaussian Preisach density, 1,000 and 200 samples: stretch
    move 60 steps, 0.8 DE and 0.2 snooker 24, DE alone 19 and 20, these in equal parts 4 and 5; 28 and 14
    where the fit is a deviation off. All ensembles take one call of the log-probability and no loop over
    walkers.

    **Arguments:** `density`, of many points at once; `ensembles`; `place` (parameters,) and `root`
    (parameters, parameters): the posterior's top, and a root of Laplace's covariance.

    Source: ter Braak, A Markov chain Monte Carlo version of the genetic algorithm differential evolution,
    Statistics and Computing 16 (2006); Tierney, Markov chains for exploring posterior distributions, Annals
    of Statistics 22 (1994).
    """

    def __init__(
        self,
        density: LogProbability,
        ensembles: int,
        place: Float[np.ndarray, " parameters"],
        root: Float[np.ndarray, "parameters parameters"],
    ):
        self.density, self.ensembles, self.place, self.root = density, ensembles, place, root
        self.inverse = np.linalg.pinv(root)

    def propose(self, model: Any, state: Any) -> tuple[Any, np.ndarray]:
        """(emcee's model, its state) -> (the state after, which walkers moved)."""
        from emcee import State

        random, parameters = model.random, len(self.place)
        points = state.coords.reshape(self.ensembles, -1, parameters).copy()
        found = state.log_prob.reshape(self.ensembles, -1).copy()
        accepted = np.zeros(found.shape, bool)
        half, rows = points.shape[1] // 2, np.arange(self.ensembles)[:, None]
        order = np.argsort(random.random_sample(found.shape), axis=1)
        kind = random.random_sample()
        for turn in (0, 1):
            moving = order[:, :half] if turn else order[:, half:]
            resting = order[:, half:] if turn else order[:, :half]
            now, before = points[rows, moving], found[rows, moving]
            if kind < INDEPENDENT:
                proposed = self._about_the_fit(random, now.shape)
                factor = self._log_density(now) - self._log_density(proposed)
            else:
                length = 1.0 if kind > 1 - JUMPS else 2.38 / np.sqrt(2 * parameters)
                proposed = now + length * _differences(random, points[rows, resting])
                factor = 0.0
            # Not emcee's wrapper of it, which prints the walkers when it is interrupted.
            there = self.density(proposed.reshape(-1, parameters)).reshape(before.shape)
            takes = np.log1p(-random.random_sample(before.shape)) < there - before + factor
            points[rows, moving] = np.where(takes[..., None], proposed, now)
            found[rows, moving] = np.where(takes, there, before)
            accepted[rows, moving] = takes
        after = State(points.reshape(-1, parameters), log_prob=found.ravel())
        return after, accepted.ravel()

    def _about_the_fit(self, random: Any, shape: tuple[int, ...]) -> np.ndarray:
        scale = np.sqrt(random.chisquare(DEGREES, (*shape[:-1], 1)) / DEGREES)
        return self.place + random.standard_normal(shape) / scale @ self.root.T

    def _log_density(self, points: np.ndarray) -> np.ndarray:
        squares = (((points - self.place) @ self.inverse.T) ** 2).sum(-1)
        return -(DEGREES + len(self.place)) / 2 * np.log1p(squares / DEGREES)


def _differences(random: Any, walkers: np.ndarray) -> np.ndarray:
    """Between two different walkers of each ensemble (ensembles, half, parameters), stretched by a hair."""
    ensembles, half, _ = walkers.shape
    rows = np.arange(ensembles)[:, None]
    one = random.randint(half, size=(ensembles, half))
    other = (one + random.randint(1, half, size=(ensembles, half))) % half
    stretch = 1 + 1e-5 * random.standard_normal((ensembles, half, 1))
    return stretch * (walkers[rows, one] - walkers[rows, other])
