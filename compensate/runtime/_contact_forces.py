"""Forces of several contacts from the readings of a soft sensor, reading by reading, in plain Python."""

from collections.abc import Sequence
from math import exp, expm1, inf, isfinite, log, sqrt
from pathlib import Path
from typing import Any, NamedTuple

from ._file import LONGEST, READING_MISSING, replayed
from ._status import Status

KIND = "hysid contact forces"

ITERATIONS, LOST, PATIENCE, SOUGHT = 2, 25.0, 3, 128
"""As in `compensate.microchannel._motion`."""

Matrix = list[list[float]]


class ContactForces(NamedTuple):
    """Forces of all contacts in N, the `Status` of the reading, and their standard deviations."""

    value: tuple[float, ...]
    status: Status
    deviation: tuple[float, ...]


class MultiContactEstimator:
    """Forces of several contacts, as `compensate.microchannel.MultiContactEstimator`, without JAX.

    - `title`; `channels`: name and unit of every reading; `contacts`: name and unit of every force.
    - `longest`, s: the longest time between two readings that the export saw; longer ones are taken for it.

    Its forces are those at once; those some readings late are JAX's alone. A step of two contacts takes
    some milliseconds.

    **Example:**

        >>> runtime = compensate.runtime.load_contacts(contacts_file)
        >>> runtime.step(0.05, (0.0, 0.0)).value
        (0.0, 0.0)
    """

    def __init__(self, document: dict[str, Any]):
        self.title: str = document["title"]
        self.channels: list[dict[str, str]] = document["channels"]
        self.contacts: list[dict[str, str]] = document["contacts"]
        self.longest: float = document.get("longest") or LONGEST
        self._networks = [_Network(model) for model in document["models"]]
        self._gains: Matrix = document["gains"]
        self._zero: list[float] = document["zero"]
        self._noise = [float(sigma) ** 2 for sigma in document["reading_sigma"]]
        motion = document["motion"]
        self._high, self._gap, self._ways = motion["high"], motion["gap_s"], motion["ways"]
        self._acceleration, self._turn, self._turns = (
            float(motion[name]) for name in ("acceleration", "turn", "turns")
        )
        numbers = [*self._noise, *self._zero, *(gain for row in self._gains for gain in row)]
        if not all(map(isfinite, numbers)):
            raise ValueError("a number is not finite")
        self.reset()

    def reset(self) -> None:
        """The state before the first reading."""
        count = len(self._networks)
        virgin = tuple(network.virgin for network in self._networks)
        none: Matrix = [[0.0] * (2 * count) for _ in range(2 * count)]
        # Of every way: forces and rates, covariance, log weight, memories of the networks.
        self._now: list[tuple[list[float], Matrix, float, Any]] = [
            ([0.0] * (2 * count), none, -inf if k else 0.0, virgin) for k in range(self._ways)
        ]
        self._begun, self._waited, self._lost = False, 0.0, 0
        self._last = (0.0,) * count, (0.0,) * count

    def step(self, dt: float, reading: Sequence[float] | None = None) -> ContactForces:
        """One reading in, a number for each channel; the forces of all contacts out.

        `dt`: time since the last call, s; the first one's does not matter. A reading of which a channel is
        NaN or infinite is INVALID: the last forces are held, and nothing else changes.

        Raises `TypeError` where `reading` is left out, `ValueError` for another number of channels.
        """
        if reading is None:
            raise TypeError(READING_MISSING)
        if len(reading) != len(self._zero):
            raise ValueError(f"{len(reading)} readings for {len(self._zero)} channels")
        if dt > 0.0:
            self._waited = min(self._waited + dt, self.longest)
        if not all(map(isfinite, reading)):
            return ContactForces(self._last[0], Status.INVALID, self._last[1])
        z = [x - rest for x, rest in zip(reading, self._zero, strict=True)]
        passed = self._waited if self._begun else 0.0
        if self._lost >= PATIENCE:
            self._find_again(z, passed)
        surprise = self._update(z, passed)
        self._waited, self._begun = 0.0, True
        self._lost = self._lost + 1 if surprise > LOST else 0
        value, deviation = self._last = self._mean()
        status = Status.SATURATED if max(value) >= self._high else Status.OK
        return ContactForces(value, Status.EXTRAPOLATED if surprise > LOST else status, deviation)

    def _update(self, z: list[float], passed: float) -> float:
        """All ways after one reading; the least squared surprise of a way, per channel."""
        dt = min(passed, self._gap) if self._begun else self._gap
        gap = dt >= self._gap
        weights = [way[2] for way in self._now]
        best, least = weights.index(max(weights)), weights.index(min(weights))
        chance = -expm1(-self._turns * dt)
        after, surprises = [], []
        for k in range(self._ways):
            x, P, weight, memory = self._now[best if k == least else k]
            weight = (log(chance) if chance else -inf) if k == least else weight - self._turns * dt
            x, P = self._ahead(x, P, k == least or gap, dt)
            looks = [
                network.prepared(held, passed)
                for network, held in zip(self._networks, memory, strict=True)
            ]
            x, P, likelihood, surprise = self._corrected(x, P, z, looks)
            moved = tuple(look.follow(F) for look, F in zip(looks, x, strict=False))
            after.append((x, P, weight + likelihood, moved))
            surprises.append(surprise)
        top = max(way[2] for way in after)
        whole = top + log(sum(exp(way[2] - top) for way in after))
        self._now = [(x, P, weight - whole, memory) for x, P, weight, memory in after]
        return min(surprises) / len(z)

    def _ahead(
        self, x: list[float], P: Matrix, turned: bool, dt: float
    ) -> tuple[list[float], Matrix]:
        """Forces and rates a time dt ahead: x <- A x, P <- A P A' + Q, with blocks of every contact."""
        n = len(x) // 2
        a, b, c = (1.0, 0.5 * dt, 0.0) if turned else (1.0, dt, 1.0)
        if turned:
            size, q = self._turn**2, (dt**2 / 3, dt / 2, 1.0)
        else:
            size, q = self._acceleration**2, (dt**3 / 3, dt**2 / 2, dt)
        moved = [min(max(a * x[k] + b * x[n + k], 0.0), self._high) for k in range(n)]
        moved += [c * x[n + k] for k in range(n)]
        left = [[a * u + b * v for u, v in zip(P[k], P[n + k], strict=True)] for k in range(n)]
        left += [[c * v for v in P[n + k]] for k in range(n)]
        new = [
            [a * row[k] + b * row[n + k] for k in range(n)] + [c * row[n + k] for k in range(n)]
            for row in left
        ]
        for k in range(n):
            new[k][k] += size * q[0] + (x[n + k] ** 2 * dt**2 / 12 if turned else 0.0)
            new[k][n + k] += size * q[1]
            new[n + k][k] += size * q[1]
            new[n + k][n + k] += size * q[2]
        return moved, new

    def _corrected(
        self, x: list[float], P: Matrix, z: list[float], looks: "list[_Look]"
    ) -> tuple[list[float], Matrix, float, float]:
        """One way after the reading, with the log-likelihood of the reading and its squared surprise."""
        n, high = len(looks), self._high
        force, likelihood, surprise = x[:n], 0.0, 0.0
        after, left = x, P
        for turn in range(ITERATIONS):
            seen = [look.at(F) for look, F in zip(looks, force, strict=True)]
            after, left = list(x), [list(row) for row in P]
            for channel, gains in enumerate(self._gains):
                h = [gain * slope for gain, (_, slope) in zip(gains, seen, strict=True)]
                y = sum(gain * value for gain, (value, _) in zip(gains, seen, strict=True))
                off = z[channel] - y
                off -= sum(hk * (ak - fk) for hk, ak, fk in zip(h, after, force, strict=False))
                column = [sum(hk * pk for hk, pk in zip(h, row, strict=False)) for row in left]
                variance = self._noise[channel]
                variance += sum(hk * ck for hk, ck in zip(h, column, strict=False))
                for j, cj in enumerate(column):
                    after[j] += cj * (off / variance)
                    left[j] = [
                        p - cj * ck / variance for p, ck in zip(left[j], column, strict=True)
                    ]
                if not turn:
                    likelihood -= 0.5 * (off**2 / variance + log(variance))
                    surprise += off**2 / variance
            force = [min(max(F, 0.0), high) for F in after[:n]]
        rates = [0.0 if F <= 0.0 and r < 0.0 else r for F, r in zip(force, after[n:], strict=True)]
        return force + rates, left, likelihood, surprise

    def _mean(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Mean and deviation of the forces over all ways."""
        n = len(self._networks)
        share = [exp(weight) for _, _, weight, _ in self._now]
        value, deviation = [], []
        for k in range(n):
            mean = sum(s * x[k] for s, (x, *_) in zip(share, self._now, strict=True))
            spread = sum(
                s * (P[k][k] + (x[k] - mean) ** 2)
                for s, (x, P, *_) in zip(share, self._now, strict=True)
            )
            value.append(mean)
            deviation.append(sqrt(max(spread, 0.0)))
        return tuple(value), tuple(deviation)

    def _find_again(self, z: list[float], passed: float) -> None:
        """The least likely way begins anew, at the forces that best explain the reading."""
        n, weights = len(self._networks), [way[2] for way in self._now]
        best, least = weights.index(max(weights)), weights.index(min(weights))
        each = max(3, round(SOUGHT ** (1 / n)))
        ends = [self._high * k / (each - 1) for k in range(each)]
        virgin = tuple(network.virgin for network in self._networks)
        found: tuple[float, list[float], Any] = (inf, [0.0] * n, virgin)
        for memory in (self._now[best][3], virgin):
            looks = [
                network.prepared(held, passed)
                for network, held in zip(self._networks, memory, strict=True)
            ]
            values = [[look.at(F)[0] for F in ends] for look in looks]
            for number in range(each**n):
                place = [number // each ** (n - 1 - k) % each for k in range(n)]
                y = [value[p] for value, p in zip(values, place, strict=True)]
                off = 0.0
                for seen, gains, noise in zip(z, self._gains, self._noise, strict=True):
                    off += (seen - sum(g * v for g, v in zip(gains, y, strict=True))) ** 2 / noise
                if off < found[0]:
                    found = off, [ends[p] for p in place], memory
        spread = [ends[1] ** 2] * n + [self._turn**2] * n
        P = [[s if j == k else 0.0 for k in range(2 * n)] for j, s in enumerate(spread)]
        even = -log(2.0 * self._ways)
        self._now = [(x, old, even, memory) for x, old, _, memory in self._now]
        self._now[least] = ([*found[1], *[0.0] * n], P, log(0.5), found[2])


class _Network:
    """A network of one contact as `hysteresis.networks.StaircaseNetwork` is, with its derivative."""

    def __init__(self, model: dict[str, Any]):
        self.layers: list[tuple[Matrix, list[float]]] = [
            (matrix, bias) for matrix, bias in zip(model["matrices"], model["biases"], strict=True)
        ]
        ((rest,), (scale,)) = model["rest"], model["scale"]
        self.half = [scale * r for r in model["thresholds"]]
        self.times: list[float] = model["times"]
        # Plays and delays at rest, and whether a sample has come.
        self.virgin = (
            (float(rest),) * len(self.half),
            (float(rest),) * len(self.times),
            False,
        )

    def prepared(self, held: Any, passed: float) -> "_Look":
        """What is the same for all forces that are tried at one reading."""
        return _Look(self, held, passed)


class _Look:
    """The next output of a network as a function of the force."""

    def __init__(self, network: _Network, held: Any, passed: float):
        self._network = network
        self._plays, self._delayed, begun = held
        dt = passed if begun else 0.0
        self._kept = [exp(-dt / tau) for tau in network.times]

    def follow(self, force: float) -> Any:
        """The memory after this force."""
        half, kept = self._network.half, self._kept
        return (
            tuple(
                min(max(z, force - r), force + r) for z, r in zip(self._plays, half, strict=True)
            ),
            tuple(k * q + (1 - k) * force for k, q in zip(kept, self._delayed, strict=True)),
            True,
        )

    def at(self, force: float) -> tuple[float, float]:
        """The output, and its derivative."""
        plays, delayed, _ = self.follow(force)
        values = [force, *plays, *delayed]
        slopes = [1.0]
        for z, old, r in zip(plays, self._plays, self._network.half, strict=True):
            # Where a play just touches, at a force of exactly 0 say, JAX takes the mean of both slopes.
            touches = old in (force - r, force + r)
            slopes.append(1.0 if z != old else 0.5 if touches else 0.0)
        slopes += [1.0 - k for k in self._kept]
        layers = self._network.layers
        for number, (matrix, bias) in enumerate(layers):
            new_values, new_slopes = [], []
            for row, b in zip(matrix, bias, strict=True):
                v = b + sum(w * u for w, u in zip(row, values, strict=True))
                if v <= 0.0 and number < len(layers) - 1:
                    new_values.append(0.0)
                    new_slopes.append(0.0)
                    continue
                new_values.append(v)
                new_slopes.append(sum(w * s for w, s in zip(row, slopes, strict=True)))
            values, slopes = new_values, new_slopes
        return values[0], slopes[0]


def load_contacts(path: str | Path) -> MultiContactEstimator:
    """Load an estimator from a file that `compensate.microchannel.export_contacts` wrote, and verify it.

    The estimator first replays the readings that the file contains, and must find their forces again.

    **Raises:** `FileError` where the file is missing, damaged, changed or of another format, or where the
    replay gives other forces.

    **Example:**

        >>> runtime = compensate.runtime.load_contacts(contacts_file)
        >>> [contact["name"] for contact in runtime.contacts]
        ['B', 'D']
    """
    return replayed(path, KIND, "readings give forces {:.3g} off", _replay)


def _replay(document: dict[str, Any]) -> tuple[MultiContactEstimator, float]:
    """How far off; infinitely where a status differs."""
    estimator, golden, worst = MultiContactEstimator(document), document["golden"], 0.0
    rows = zip(
        golden["reading"], golden["dt"], golden["value"], golden["deviation"], golden["status"],
        strict=True,
    )  # fmt: skip
    for reading, dt, value, deviation, status in rows:
        found = estimator.step(dt, reading)
        pairs = zip((*found.value, *found.deviation), (*value, *deviation), strict=True)
        off = max(abs(a - b) for a, b in pairs)
        worst = max(worst, off if found.status == status else inf)
    return estimator, worst
