"""An oscillator as the compiled loop takes it: over samples, over fine steps, with sensitivities."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from .._parameter import is_concrete, parameters
from ._layout import Layout, layout_of

EVEN = 1e-6
"""Relative difference of time steps up to which a clock is even."""

FAR = 1e9
"""A motion this many times beyond what the force could bend the spring by has no end."""


@dataclass
class Compiled:
    """Plant and hysteresis as arrays.

    - `plant`: mass, damping, stiffness, constant force. `layout`: the hysteresis.
    """

    plant: Float[np.ndarray, "4"]
    layout: Layout

    @classmethod
    def of(cls, model: Any) -> "Compiled | None":
        """Of an `Oscillator` whose parameters are known now; None where the loop cannot run it."""
        values = [value for _, _, value in parameters(model)]
        if not all(map(is_concrete, values)) or any(np.asarray(v).dtype != float for v in values):
            return None
        if np.ndim(model.mass) or not available():
            return None
        layout = layout_of(model.hysteresis)
        plant = np.array([model.mass, model.damping, model.stiffness, 0.0], float)
        return None if layout is None else cls(plant, layout)

    def over_samples(
        self, t: np.ndarray, u: np.ndarray, starts: tuple[int, ...], substeps: int
    ) -> np.ndarray | None:
        """The displacement at the samples of sequences from rest, the force straight between them; None
        where the clock is not even."""
        from ._recorder import interpolated

        out = np.empty(len(u))
        for first, end in zip(starts, (*starts[1:], len(u)), strict=True):
            steps = np.diff(t[first:end])
            if not len(steps):
                out[first:end] = 0.0
                continue
            dt = float((t[end - 1] - t[first]) / len(steps))
            if not np.allclose(steps, dt, rtol=EVEN, atol=0):
                return None
            fine = interpolated(u[first:end], substeps, "linear")
            out[first:end] = self.run(fine, dt / substeps)[0][::substeps]
        return out

    def run(
        self,
        force: Float[np.ndarray, " fine"],
        h: float,
        *,
        warm: int = 0,
        every: int = 0,
        state: Float[np.ndarray, " state"] | None = None,
        limit: float | None = None,
    ) -> tuple[Float[np.ndarray, " fine"], Float[np.ndarray, "samples parameters"], np.ndarray]:
        """Displacements of the fine force, their sensitivities, and the state at the end.

        **Arguments:**

        - `h`: time of a fine step. `warm`: how often the force is run through before.
        - `every`: of so many steps the sensitivities of one are kept; 0 for none.
        - `state`: displacement, velocity, acceleration (NaN: found), z and plays at first; else at rest.
        - `limit`: the largest displacement; where it is passed, all outputs are NaN.
        """
        from ._newmark_kernel import newmark  # loads numba, half a second

        own, count = self.layout, len(force)
        at = self.rest() if state is None else np.array(state, float)
        columns = own.parameters if every else 0
        rows = -(-count // every) if every else 0
        outputs, sensitivities = np.empty(count), np.empty((rows, columns))
        per = (own.counts - 1) / (2 * own.reach)
        knots = own.rate.shape[1]
        failed = newmark(
            self.plant, np.ascontiguousarray(own.rate), -own.limit, (knots - 1) / (2 * own.limit),
            own.radii, own.first, -own.reach, per, own.heights,
            np.ascontiguousarray(force, float), h, count * (1 + warm), count * warm, max(every, 1),
            np.inf if limit is None else limit, at, outputs, sensitivities,
        )  # fmt: skip
        if failed:
            outputs[:] = np.nan
        return outputs, sensitivities, at

    def rest(self) -> Float[np.ndarray, " state"]:
        """The state at rest, whose acceleration the first force will give."""
        state = np.zeros(4 + len(self.layout.radii))
        state[2] = np.nan
        return state

    def changed(self, theta: Float[np.ndarray, " parameters"]) -> "Compiled":
        """With the parameters in the order of the loop's sensitivities; those of the state are skipped."""
        own, knots = self.layout, self.layout.rate.size
        rate = theta[7 : 7 + knots].reshape(own.rate.shape)
        return Compiled(
            theta[:4].copy(), replace(own, rate=rate, heights=theta[7 + knots :].copy())
        )

    @property
    def theta(self) -> Float[np.ndarray, " parameters"]:
        """The parameters in the order of the sensitivities, of a start at rest."""
        own = self.layout
        return np.concatenate([self.plant, np.zeros(3), own.rate.ravel(), own.heights])


def available() -> bool:
    """Whether the compiled loop can be had: numba is installed, and knows this NumPy."""
    try:
        from . import _newmark_kernel as _newmark_kernel  # loads numba, half a second
    except ImportError:
        return False
    return True


def plays_along(
    path: Float[np.ndarray, " fine"],
    radii: Float[np.ndarray, " plays"],
    every: int = 1,
    rounds: int = 1,
) -> Float[np.ndarray, "samples plays"]:
    """The plays of some radii at every `every`th point of a path that is run through `rounds` times."""
    from ._newmark_kernel import plays_along as compiled  # loads numba, half a second

    path, radii = np.ascontiguousarray(path, float), np.ascontiguousarray(radii, float)
    out, plays = np.empty((-(-len(path) // every), len(radii))), np.zeros(len(radii))
    for _ in range(rounds):
        compiled(path, radii, plays, out, every)
    return out
