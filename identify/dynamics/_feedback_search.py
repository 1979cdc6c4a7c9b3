"""Gauss-Newton for a `Feedback` model: simulated steady states against measured spectra.

The sum of |Y - Y^|^2 over lines, outputs and realisations, each output over its own size at its level, or
over thirty times its noise where that is more, is decreased by steps damped in each unknown's own size
(Levenberg, Marquardt). A pass takes every `thin`th line, another set each time, because a Jacobian costs
more than the states do.
"""

from typing import Any, NamedTuple

import numpy as np

from hysteresis import Feedback
from hysteresis.dynamics._feedback import Lines, Steady, steady_state

from .._levels import HELD
from ._feedback_unknowns import (
    Point,
    Unknowns,
    around,
    changes,
    equivalent_gains,
    jacobian,
    numbers_by_unknowns,
    refined,
)
from ._output_error import TRIES
from ._vector_fitting import real

STRONG, PROBED = 0.5, 10
"""Part by which equivalent gains may be wrong around the loop, as so many of the unknowns show: by that
part a step of Gauss-Newton then falls short. While it is less than half, each step leaves less than half of
the way, and the exact tangents cost more than the steps that they save."""

HEARD = 30.0
"""How many times its noise an output counts for at least: one of noise alone would hide what others say."""


class Spectra(NamedTuple):
    """Periodic records in their lines: inputs U (realisations, lines, inputs), outputs Y, which level each
    realisation has, and what errors of outputs count in parts of (realisations, outputs): the root mean
    square of the level's outputs, more where noise is `weighed`."""

    lines: Lines
    U: Any
    Y: Any
    level: np.ndarray
    size: np.ndarray

    def part(self, which: Any) -> "Spectra":
        return self._replace(
            U=self.U[which], Y=self.Y[which], level=self.level[which], size=self.size[which]
        )

    def finer(self, finer: int) -> "Spectra":
        return self._replace(lines=self.lines._replace(finer=finer))

    def weighed(self, noise: np.ndarray) -> "Spectra":
        """With sizes in which noise counts, too: its root mean square is (realisations, outputs)."""
        return self._replace(size=np.hypot(self.size, HEARD * noise))

    def left(self, Y: Any) -> Any:
        """What outputs leave, over their sizes; without the constant one."""
        rest = (self.Y - Y) / self.size[:, None, :]
        rest[:, 0] = 0.0
        return rest

    def error(self, model: Feedback) -> float:
        """Root mean square of what outputs leave, over their sizes: the mean over levels, realisations and
        outputs."""
        left = self.left(simulated(model, self).output)[:, 1:]
        e = np.sqrt((np.abs(left) ** 2).mean(1)).mean(1)
        return float(np.mean([e[self.level == k].mean() for k in np.unique(self.level)]))

    def errors(self, model: Feedback) -> dict[int, float]:
        """Of each level: root mean square error over that of the output, the mean over realisations and
        outputs."""
        Y = simulated(model, self).output
        own = np.sqrt((np.abs(self.Y[:, 1:]) ** 2).sum(1))
        e = np.sqrt((np.abs((self.Y - Y)[:, 1:]) ** 2).sum(1)) / own
        return {int(k): float(e[self.level == k].mean()) for k in np.unique(self.level)}


class Found(NamedTuple):
    """A model, its steady states on the records, and the sum of squares."""

    model: Feedback
    states: list[Steady]
    cost: float

    @property
    def output(self) -> np.ndarray:
        return np.stack([state.output for state in self.states])


def simulated(model: Feedback, data: Spectra, starts: list[Steady] | None = None) -> Found:
    """The steady states of all realisations."""
    G = model.response(data.lines.s)
    states = [
        steady_state(model, data.lines, u, None if starts is None else starts[r].drives, G)
        for r, u in enumerate(data.U)
    ]
    found = Found(model, states, np.inf)
    cost = float((np.abs(data.left(found.output)) ** 2).sum())
    settled = max(state.left for state in states) < HELD and np.isfinite(cost)
    return found._replace(cost=cost) if settled else found


def gauss_newton(
    model: Feedback,
    data: Spectra,
    unknowns: Unknowns,
    *,
    steps: int = 10,
    damping: float = 1e-3,
    thin: int = 1,
    gain: float = 1e-3,
    until: Any = lambda: False,
) -> Found:
    """Steps until one gains less than the part `gain`, or time is up."""
    here = simulated(model, data)
    for turn in range(steps):
        normal, right = _normal(here, data, unknowns, turn, thin)
        size = np.sqrt(np.maximum(np.diag(normal), 1e-12 * np.diag(normal).max()))
        scaled, q = normal / np.outer(size, size), unknowns.vector(here.model)
        there = here
        for _ in range(TRIES):
            step = np.linalg.solve(scaled + damping * np.eye(len(q)), right / size) / size
            there = simulated(unknowns.moved(here.model, q + step), data, here.states)
            if there.cost < here.cost:
                break
            damping *= 8
        if not there.cost < here.cost:
            break
        gained = 1 - there.cost / here.cost
        here, damping = there, max(damping / 4, 1e-7)
        if gained < gain or until():
            break
    return here


def _normal(
    here: Found, data: Spectra, unknowns: Unknowns, turn: int, thin: int
) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations of the lines of this turn."""
    model, lines, ny = here.model, data.lines, here.model.outputs
    G = model.response(lines.s)
    gains = {}
    for level in np.unique(data.level):
        own = [s for s, k in zip(here.states, data.level, strict=True) if k == level]
        gains[level] = equivalent_gains(
            np.stack([s.drives for s in own]), np.stack([s.reactions for s in own])
        )
    reactions = [numbers_by_unknowns(channel) for channel in model.channels]
    points = [
        Point(model, lines, data.U[r], state, G, gains[data.level[r]], reactions)
        for r, state in enumerate(here.states)
    ]
    strong = bool(reactions) and _is_strong(points[int(np.argmax(data.level))], unknowns)
    left = data.left(here.output)
    normal, right = 0.0, 0.0
    for r, point in enumerate(points):
        kept, of = slice(1 + (turn + r) % thin, None, thin), changes(point, unknowns)
        J = (
            refined(point, of)[0][kept, :ny]
            if strong
            else jacobian(around(point, kept)[:, :ny], of, kept)
        )
        J = (J / data.size[r][:, None].astype(np.float32)).reshape(-1, J.shape[2])
        J, e = real(J), real(left[r, kept].ravel()).astype(np.float32)
        normal = normal + (J.T @ J).astype(float)
        right = right + (J.T @ e).astype(float)
    return np.asarray(normal), np.asarray(right)


def _is_strong(point: Point, unknowns: Unknowns) -> bool:
    """Whether the channels are too strong for their equivalent gains."""
    # More of a drive changes the reaction at once.
    every = changes(point, unknowns._replace(driven=False))
    each = [
        (change, r, c)
        for change in every
        for r in range(change[0][0].shape[2])
        for c in range(change[0][1].shape[1])
    ]
    few = [each[k] for k in np.linspace(0, len(each) - 1, PROBED).astype(int)]
    alone = [tuple((to[:, :, [r]], by[:, [c]]) for to, by in change) for change, r, c in few]
    return refined(point, alone, 1)[1] > STRONG
