"""The step of an oscillator in plain Python: the displacement of a mass on a hysteretic spring."""

from math import floor, nan
from pathlib import Path
from typing import Any

from ._file import replayed

KIND = "hysid oscillator"
TURNS = 4
CLOSE = 1e-12


class OscillatorStep:
    """Force in, displacement out, sample by sample on a fixed clock.

    - `dt`: time between two samples.

    **Example:**

        >>> spring = hysteresis.BoucWenForce(alpha=5e4, beta_gamma=800.0)
        >>> plant = hysteresis.Oscillator(2.0, 10.0, 5e4, spring)
        >>> file = compensate.export_oscillator(plant, folder / "mount.json", 1 / 750, np.ones(64))
        >>> mount = compensate.runtime.load_oscillator(file)
        >>> mount.step(40.0)
        0.0
    """

    def __init__(self, document: dict[str, Any]):
        self.dt: float = float(document["dt"])
        self._substeps = int(document["substeps"])
        self._plant = tuple(float(document[key]) for key in ("mass", "damping", "stiffness"))
        self._rate = [[float(x) for x in side] for side in document["rate"]]
        self._limit = float(document["limit"])
        self._z_per = (len(self._rate[0]) - 1) / (2 * self._limit)
        self._plays, first = [], 0
        for r, reach, count in zip(
            document["radii"], document["reach"], document["counts"], strict=True
        ):
            heights = [float(x) for x in document["heights"][first : first + count]]
            first += count
            self._plays.append((float(r), -float(reach), (count - 1) / (2 * float(reach)), heights))
        self.reset()

    def reset(self) -> None:
        """At rest, before the first sample."""
        self._y = self._v = self._a = self._z = 0.0
        self._at = [0.0] * len(self._plays)
        self._force = nan

    def step(self, force: float) -> float:
        """The displacement at the sample whose force this is."""
        m, c, k = self._plant
        if self._force != self._force:
            total = sum(self._curve(j, 0.0)[0] for j in range(len(self._plays)))
            self._a, self._force = (force - total) / m, force
            return self._y
        count = self._substeps
        h = self.dt / count
        rise = (force - self._force) / count
        for i in range(1, count + 1):
            self._fine(force if i == count else self._force + rise * i, h, m, c, k)
        self._force = force
        return self._y

    def _fine(self, push: float, h: float, m: float, c: float, k: float) -> None:
        y, v, a, z = self._y, self._v, self._a, self._z
        half, quarter = 0.5 * h, 0.25 * h * h
        knots = len(self._rate[0])
        z1, z0 = z, z + half * v * self._f(z, v)[0] if knots else z
        a1, at = a, self._at
        for _ in range(TURNS):
            y1, v1 = y + h * v + quarter * (a + a1), v + half * (a + a1)
            follow = 0.0
            if knots:
                for _ in range(2):
                    f, df = self._f(z1, v1)
                    damp = 1 / (1 - half * v1 * df)
                    off = (z1 - z0 - half * v1 * f) * damp
                    z1 -= off
                    follow = damp * half * (f - off * df)
            total, stretch, at = z1, 0.0, []
            for j, play in enumerate(self._plays):
                p = min(max(self._at[j], y1 - play[0]), y1 + play[0])
                value, slope = self._curve(j, p)
                total += value
                if p != self._at[j] or play[0] == 0:
                    stretch += slope
                at.append(p)
            change = (m * a1 + c * v1 + k * y1 + total - push) / (
                m + half * (c + follow) + quarter * (k + stretch)
            )
            a1 -= change
            if abs(change) < CLOSE * abs(a1):
                break
        self._y, self._v = y + h * v + quarter * (a + a1), v + half * (a + a1)
        self._a, self._z, self._at = a1, z1, at

    def _f(self, z: float, v: float) -> tuple[float, float]:
        values = self._rate[1 if v < 0 else 0]
        place = (z + self._limit) * self._z_per
        cell = min(max(floor(place), 0), len(values) - 2)
        rise = values[cell + 1] - values[cell]
        return values[cell] + rise * (place - cell), rise * self._z_per

    def _curve(self, j: int, p: float) -> tuple[float, float]:
        _, low, per, heights = self._plays[j]
        place = (p - low) * per
        cell = min(max(floor(place), 0), len(heights) - 2)
        rise = heights[cell + 1] - heights[cell]
        return heights[cell] + rise * (place - cell), rise * per


def load_oscillator(path: str | Path) -> OscillatorStep:
    """The oscillator of a file, once it has moved as the golden pair in it says.

    Raises `FileError` where the file cannot be used.

    **Example:**

        >>> plant = hysteresis.Oscillator(2.0, 10.0, 5e4, hysteresis.BoucWenForce(5e4, 800.0))
        >>> file = compensate.export_oscillator(plant, folder / "mount.json", 1 / 750, np.ones(64))
        >>> compensate.runtime.load_oscillator(file).step(40.0)
        0.0
    """

    def replay(document: dict[str, Any]) -> tuple[OscillatorStep, float]:
        made, golden = OscillatorStep(document), document["golden"]
        off = [
            abs(made.step(u) - y)
            for u, y in zip(golden["force"], golden["displacement"], strict=True)
        ]
        return made, max(off, default=0.0)

    return replayed(path, KIND, "golden displacements are {:.3g} off", replay)
