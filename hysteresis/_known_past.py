"""The past of a model from a stretch of inputs and outputs that are known: what it has been through before.

The known inputs leave in any memory what they have reached. What was there before them is a history that
nobody saw: some loops of one size, and then inputs at times that reach back ever less far,

    least  |y - y(z)|^2 / s^2 + |z - z_0|^2,      0 <= z <= 1

y(z) is the model's output behind the history z: the loops' size, how short it all was, and the inputs, in
parts of their range; z_0 is a long rest at the first input. So every state that is found is one that the
model can be in, whatever it remembers: reversals, plays, springs that relax, wear. s is the error of as
many independent rows as the residuals are worth. Gauss-Newton's steps from the best of some typical pasts,
with differences, because one run over many histories tells them all.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ._errors import InputError
from .running import numbers_of, run

LOOPS, KNOTS = 32, 12
"""Ends of the loops, and inputs after them: the known rows leave few reversals of a longer history."""

SIZE = 2 + KNOTS
"""Unknowns."""

LONG, SHORT = 100.0, 1e-5
"""The longest history, in durations of the known rows, and the shortest, in those."""

ROUNDS, STARTS = 30, 3
"""Steps from each start, and starts: the best of the typical pasts."""

DAMPING = 10.0 ** np.arange(-5, 6)
"""Tried at once in each step."""

LEAST_GAIN = 1e-3
"""Of the error, in a step; the search ends with a smaller one."""

SHORTENED, NEARLY = 8, 1.5
"""Times that a deviation is made shorter, while it raises the error by more than this times s^2."""

STEP = 1e-5
"""Of differences, in parts of the range."""

FLOOR = 1e-6
"""Of the known outputs' range: errors below are rounding."""

Outputs = Callable[[Any, np.ndarray, tuple[int, ...]], Any]


class KnownPast(NamedTuple):
    """Histories that end with the last known row: the likeliest, then others, a standard deviation from it.

    - `times`: (histories, rows), None without a clock.
    - `inputs`: (histories, rows), or (histories, rows, 2) beside a condition. Of the rows the last ones are
      known.
    - `misfit`: rms of what the first history leaves of the known outputs.
    """

    times: Float[np.ndarray, "histories rows"] | None
    inputs: np.ndarray
    misfit: float

    def followed_by(self, t: Any, u: np.ndarray) -> tuple[Any, np.ndarray, tuple[int, ...]]:
        """Times and inputs of all histories with the rows after them, and where each begins: as
        `simulate` takes them."""
        count, rows = len(self.inputs), self.inputs.shape[1] + len(u)
        after = np.broadcast_to(u, (count, *u.shape))
        inputs = np.concatenate([self.inputs, after], 1).reshape(-1, *u.shape[1:])
        times = None
        if self.times is not None:
            times = np.hstack([self.times, np.broadcast_to(t, (count, len(u)))]).ravel()
        return times, inputs, tuple(range(0, count * rows, rows))


def known_past(
    model: Any, t: Any, u: Any, y: Any, error: float = 0.0, outputs: Outputs | None = None
) -> KnownPast:
    """The histories behind known rows of a model, within the inputs that it was trained on.

    **Arguments:**

    - `t`, `u`, `y`: times, or None, inputs (rows,), or (rows, 2) beside a condition, and outputs (rows,).
      Rows whose output is not a number drive the model and say no more.
    - `error`: rms of the model where its state is known; s is no less.
    - `outputs`: what `outputs_of` gives, for many calls.

    Raises `InputError` `no-rows` without a known output.
    """
    u, y = np.asarray(u, float), np.asarray(y, float)
    own = u if u.ndim == 1 else u[:, 0]
    ends = own if model.trained is None else np.append(own, np.asarray(model.trained))
    search = _Search(
        outputs or outputs_of(model), t, u, y, float(ends.min()), float(ends.max()), error
    )
    best = min((search.descended(z) for z in search.typical()), key=search.error)
    z = np.concatenate([best[None], search.others(best)])
    misfit = float(np.sqrt(np.mean(search.residuals(z[:1]) ** 2)))
    return KnownPast(*search.histories(z), misfit)


def outputs_of(model: Any) -> Outputs:
    """The outputs of a model at (t, u, starts): by its laws, where it has a tree of them."""
    try:
        numbers = numbers_of(model.tree(depth=0))
    except InputError as error:
        if error.code != "not-exportable":
            raise
        return lambda t, u, starts: model.simulate(t, u, starts=starts)

    def outputs(t: Any, u: np.ndarray, starts: tuple[int, ...]) -> np.ndarray:
        dt = np.zeros(len(u)) if t is None else np.diff(t, prepend=t[0])
        dt[list(starts)] = np.nan
        return run(numbers, u, dt).value

    return outputs


class _Search:
    def __init__(
        self, outputs: Outputs, t: Any, u: np.ndarray, y: np.ndarray,
        low: float, high: float, error: float,
    ) -> None:  # fmt: skip
        self.outputs, self.u, self.rows = outputs, u, np.flatnonzero(np.isfinite(y))
        if not len(self.rows):
            said = "no output is known from which the past could be told."
            raise InputError("no-rows", said, fix="give some rows with an output.")
        own = u if u.ndim == 1 else u[:, 0]
        self.y, self.t = y[self.rows], None if t is None else np.asarray(t, float)
        self.low, self.span = low, (high - low) or 1.0
        self.rest = np.append([0.0, 0.0], np.full(KNOTS, (own[0] - self.low) / self.span))
        self.least = max(error, FLOOR * (float(np.ptp(self.y)) or 1.0)) ** 2
        if self.t is not None:
            step = float(np.median(np.diff(self.t))) if len(u) > 1 else 1.0
            before = np.geomspace(step, LONG * (float(np.ptp(self.t)) or step), KNOTS)
            self.before = np.append(before, before[-1] + step * np.arange(1, LOOPS + 1))[::-1]

    def histories(self, z: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
        """Times and inputs, (pasts, rows)."""
        ends = np.arange(LOOPS) % 2 - self.rest[-1]
        u = self.low + self.span * np.hstack([self.rest[-1] + z[:, :1] * ends, z[:, 2:]])
        known = np.broadcast_to(self.u, (len(z), *self.u.shape))
        if self.u.ndim == 2:
            u = np.stack([u, np.full_like(u, self.u[0, 1])], -1)
        u = np.concatenate([u, known], 1)
        if self.t is None:
            return None, u
        before = SHORT ** z[:, 1:2] * self.before
        return np.hstack([self.t[0] - before, np.broadcast_to(self.t, (len(z), len(self.t)))]), u

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """Of the known rows, (pasts, rows)."""
        t, u = self.histories(z)
        rows = u.shape[1]
        t = None if t is None else t.ravel()
        y = self.outputs(t, u.reshape(-1, *u.shape[2:]), tuple(range(0, len(z) * rows, rows)))
        return np.asarray(y).reshape(len(z), rows)[:, LOOPS + KNOTS + self.rows] - self.y

    def typical(self) -> np.ndarray:
        """Those with the least errors among rests, ends reached before, fading swings and walks, some of
        them behind loops."""
        middle = np.full(KNOTS, 0.5)
        found = [self.rest[2:], 0 * middle, 2 * middle]
        found += [np.append(self.rest[3:], end) for end in (0.0, 1.0)]
        swing = (-1.0) ** np.arange(KNOTS) * np.linspace(0.5, 0.05, KNOTS)
        found += [c + s * swing for c in (self.rest[2:], middle) for s in (1, -1)]
        random = np.random.default_rng(0)
        while len(found) < 8 * SIZE:
            turns = random.random(random.integers(2, KNOTS + 1))
            places = np.linspace(0, len(turns) - 1, KNOTS)
            found.append(np.interp(places, np.arange(len(turns)), turns))
        count = np.arange(8 * SIZE)
        first = np.column_stack([np.where(count % 4, 0.0, 0.5), np.where(count % 3, 0.0, 0.5)])
        z = np.hstack([first, np.clip(found, 0, 1)])
        errors = [self.residuals(some) for some in np.split(z, 8)]  # of one length, as later ones
        return z[np.argsort((np.vstack(errors) ** 2).sum(1), kind="stable")[:STARTS]]

    def variance(self, residuals: np.ndarray) -> float:
        """Of rows that are independent: neighbours that err alike count less."""
        size, own = len(residuals), residuals - residuals.mean()
        alike = max(float(own[1:] @ own[:-1]) / max(float(own @ own), 1e-300), 0.0)
        worth = max(1.0, size * (1 - alike) / (1 + alike))
        return max(float(np.mean(residuals**2)), self.least) * size / worth

    def error(self, z: np.ndarray) -> float:
        """Of a past; of those that explain as much the nearest to rest is taken."""
        residuals, away = self.residuals(z[None])[0], z - self.rest
        return (float(residuals @ residuals) + self.least) * (1 + 1e-3 * float(away @ away))

    def curvature(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """H and the downhill direction of what is to be least, and s^2."""
        steps = np.where(z + STEP > 1, -STEP, STEP)
        found = self.residuals(np.vstack([z, z + np.diag(steps)]))
        slopes, s2 = (found[1:] - found[0]) / steps[:, None], self.variance(found[0])
        return slopes @ slopes.T / s2 + np.eye(SIZE), self.rest - z - slopes @ found[0] / s2, s2

    def descended(self, z: np.ndarray) -> np.ndarray:
        """A past at a minimum."""
        for _ in range(ROUNDS):
            H, downhill, s2 = self.curvature(z)
            free = ((z > 0) | (downhill > 0)) & ((z < 1) | (downhill < 0))
            own = H[np.ix_(free, free)]
            damped = own + DAMPING[:, None, None] * np.diag(np.diagonal(own))
            tried = np.tile(z, (1 + len(DAMPING), 1))
            tried[1:, free] += np.linalg.solve(damped, downhill[free])
            tried = np.clip(tried, 0, 1)
            sizes = (self.residuals(tried) ** 2).sum(1) / s2 + ((tried - self.rest) ** 2).sum(1)
            if sizes.min() > sizes[0] * (1 - LEAST_GAIN):
                break
            z = tried[sizes.argmin()]
        return z

    def others(self, z: np.ndarray) -> np.ndarray:
        """A standard deviation either way along each axis of what is uncertain; less where that far off the
        known outputs are missed."""
        H, _, s2 = self.curvature(z)
        sizes, axes = np.linalg.eigh(H)
        ways = (axes / np.sqrt(np.maximum(sizes, 1.0))).T
        ways = np.vstack([ways, -ways])
        least = float(np.sum(self.residuals(z[None]) ** 2))
        for _ in range(SHORTENED):
            found = np.clip(z + ways, 0, 1)
            missed = np.vstack([self.residuals(some) for some in np.split(found, 2)])
            more = np.maximum((missed**2).sum(1) - least, s2) / s2
            if more.max() <= NEARLY:
                break
            ways /= np.sqrt(more)[:, None]
        return np.clip(z + ways, 0, 1)
