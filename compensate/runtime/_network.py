"""Force from the readings of a soft sensor: a trained network, sample by sample, in plain Python."""

from collections.abc import Sequence
from math import exp, inf, isfinite
from operator import mul
from typing import Any

from hysteresis.laws._tree import node_of

from ._compensator import Estimate
from ._file import LONGEST, READING_MISSING, Written
from ._status import Status

KIND = "hysid force estimator"

_OK, _EXTRAPOLATED, _SATURATED = Status.OK, Status.EXTRAPOLATED, Status.SATURATED

MOST = 200_000
"""Weights of a network."""

_Rows = tuple[tuple[float, ...], ...]
_Memory = tuple[_Rows, _Rows, bool]
_Layer = list[tuple[slice, list[tuple[list[float], float]]]]


class ForceEstimator:
    """Force from readings, as `compensate.internal.ForceEstimator`, reading by reading, without JAX.

    - `title`; `channels`: name and unit of every reading, {"name", "unit"}; `estimate`: of the force.
    - `limits`: (low, high) of every channel in the training; readings beyond them are EXTRAPOLATED.
    - `high`: the largest force; a larger estimate is cut to it and SATURATED. `deviation`: of the force.
    - `rates`: whether the model depends on the rate; `step` ignores the time where it does not. `longest`:
      of it. A longer one is taken for that, EXTRAPOLATED.

    The JAX estimator that was exported gives the same to 1e-9 of the largest force.
    """

    def __init__(self, document: dict[str, Any]):
        self.title: str = document["title"]
        self.channels: list[dict[str, str]] = document["channels"]
        self.estimate: dict[str, str] = document["estimate"]
        self.limits: list[tuple[float, float]] = [
            (-inf if low is None else float(low), inf if high is None else float(high))
            for low, high in document["limits"]
        ]
        self.high: float = float(document["high"])
        self._scale = float(document.get("scale", 1.0))  # earlier files have none
        self.deviation: float = float(document["deviation"])
        self.rates: bool = document["rates"]
        self.longest: float = document.get("longest") or LONGEST
        self._model = document["model"]
        self.reset()

    def reset(self) -> None:
        """The state before the first reading."""
        model = self._model
        if model["kind"] == "network":
            network = Network(model)
            held = network.virgin

            def move(dt: float, readings: Sequence[float]) -> float:
                nonlocal held
                held = network.follow(held, dt, readings)
                return network.output(held, readings)

            self._move = move
        elif model["kind"] == "tree":
            node = node_of(model["tree"])
            follow = {"move": node.move, "find": node.find}[model["way"]]
            self._move = lambda dt, u: follow(dt, u[0])
        else:
            raise ValueError(f"no model {model['kind']!r}")
        self._value, self._waited, self._begun = 0.0, 0.0, False

    def step(self, dt: float, reading: float | Sequence[float] | None = None) -> Estimate:
        """One reading in, a number for one channel, one for each for several; one force out.

        `dt`: time since the last call, s; the first one's does not matter. A reading of which a channel is
        NaN or infinite is INVALID: the last force is held, and nothing else changes.

        Raises `TypeError` where `reading` is left out, `ValueError` for another number of channels.
        """
        if reading is None:
            raise TypeError(READING_MISSING)
        if self.rates and dt > 0.0:
            self._waited = min(self._waited + float(dt), self.longest)
        several: Any = reading if hasattr(reading, "__len__") else (reading,)
        readings = [*map(float, several)]  # a number of NumPy would stay in the state
        if len(readings) != len(self.limits):
            raise ValueError(f"{len(readings)} readings for {len(self.limits)} channels")
        if not isfinite(sum(readings)) and not all(map(isfinite, readings)):
            return Estimate(self._value, Status.INVALID, self.deviation)
        dt = self._waited if self._begun else 0.0
        found = self._scale * self._move(dt, readings)
        self._waited, self._begun = 0.0, True
        status = _OK if dt < self.longest else _EXTRAPOLATED
        if found > self.high:
            status = _SATURATED
        for now, (low, high) in zip(readings, self.limits, strict=True):
            if not low <= now <= high:
                status = _EXTRAPOLATED
        self._value = value = min(max(found, 0.0), self.high)
        return Estimate(value, status, self.deviation)


class Network:
    """A network as `hysteresis.internal.StaircaseNetwork` is, its scales put into the layers. What it
    remembers is given and returned: the plays and the delayed readings of every channel, and whether a
    reading has come; at first `virgin`.

    Products are summed by `sum(map(mul, ...))`, which stays in C. Compared with a function that is written
    out term by term and compiled, five networks of 64 and 32 take 1.2 times as long, one of 25 and 12 takes
    1.8 times, and nothing has to be compiled.

    Raises `ValueError` for a number that is not finite, for too many weights, and for layers of which one
    does not fit the next.
    """

    def __init__(self, model: dict[str, Any]):
        thresholds, self._times = model["thresholds"], list[float](model["times"])
        self._halves = [[_finite(scale * r) for r in thresholds] for scale in model["scale"]]
        rests = [float(rest) for rest in model["rest"]]
        plays, delayed = (
            tuple((rest,) * len(own) for rest in rests) for own in (thresholds, self._times)
        )
        self.virgin: _Memory = plays, delayed, False
        wide = len(self._halves) * (1 + len(thresholds) + len(self._times))
        self._hidden: list[_Layer] = []
        for matrix, bias in zip(model["matrices"], model["biases"], strict=True):
            if any(len(row) != wide for row in matrix):
                raise ValueError("a layer does not fit the one before")
            self._hidden.append(_layer(matrix, bias))
            wide = len(matrix)
        weights = sum(len(row) for matrix in model["matrices"] for row in matrix)
        if weights > MOST or wide != 1:
            raise ValueError(f"a network has more than {MOST:,} weights, or not one output")
        *self._hidden, self._last = self._hidden
        self._dt, self._kept = -1.0, list[tuple[float, float]]()

    def _keeps(self, dt: float) -> list[tuple[float, float]]:
        """What of the delayed readings, and of the reading, is in the next ones."""
        if dt != self._dt:
            kept = [exp(-dt / tau) for tau in self._times]
            self._dt, self._kept = dt, [(k, 1.0 - k) for k in kept]
        return self._kept

    def follow(self, held: _Memory, dt: float, readings: Sequence[float]) -> _Memory:
        """The memory after these readings."""
        plays, delayed, begun = held
        kept = self._keeps(dt if begun else 0.0)
        # The nearest place to z within h of u.
        moved = [
            tuple([
                u - h if u - z > h else u + h if z - u > h else z
                for z, h in zip(own, halves, strict=True)
            ])
            for u, own, halves in zip(readings, plays, self._halves, strict=True)
        ]  # fmt: skip
        lagging = [
            tuple([k * q + m * u for q, (k, m) in zip(own, kept, strict=True)])
            for u, own in zip(readings, delayed, strict=True)
        ]
        return tuple(moved), tuple(lagging), True

    def output(self, held: _Memory, readings: Sequence[float]) -> float:
        """Of a memory that has followed the readings."""
        seen: list[float] = []
        for u, plays, delayed in zip(readings, held[0], held[1], strict=True):
            seen += [u, *plays, *delayed]
        for layer in self._hidden:
            found: list[float] = []
            for cut, rows in layer:
                part = seen[cut]
                found += [
                    v if (v := sum(map(mul, row, part), bias)) > 0.0 else 0.0 for row, bias in rows
                ]
            seen = found
        ((cut, ((row, bias),)),) = self._last
        return sum(map(mul, row, seen[cut]), bias)

    def with_slope(self, held: _Memory, dt: float, u: float) -> tuple[float, float]:
        """The next output at a reading of one channel, and its derivative."""
        after = self.follow(held, dt, (u,))
        (before,), (plays,), (halves,) = held[0], after[0], self._halves
        seen, slopes = [u, *plays, *after[1][0]], [1.0]
        for z, old, r in zip(plays, before, halves, strict=True):
            # Where a play just touches, at a force of exactly 0 say, JAX takes the mean of both slopes.
            touches = old in (u - r, u + r)
            slopes.append(1.0 if z != old else 0.5 if touches else 0.0)
        slopes += [m for _, m in self._keeps(dt if held[2] else 0.0)]
        for layer in self._hidden:
            found: list[float] = []
            steep: list[float] = []
            for cut, rows in layer:
                for row, bias in rows:
                    rises = (v := sum(map(mul, row, seen[cut]), bias)) > 0.0
                    found.append(v if rises else 0.0)
                    steep.append(sum(map(mul, row, slopes[cut])) if rises else 0.0)
            seen, slopes = found, steep
        ((cut, ((row, bias),)),) = self._last
        return sum(map(mul, row, seen[cut]), bias), sum(map(mul, row, slopes[cut]))


def _layer(matrix: Sequence[Sequence[float]], bias: Sequence[float]) -> _Layer:
    """Neighbouring rows whose weights are of the same inputs: those inputs, weights and biases.

    Networks side by side are one with blocks on the diagonal, of which most is 0.
    """
    layer: _Layer = []
    for row, b in zip(matrix, bias, strict=True):
        row = [_finite(w) for w in row]
        used = [k for k, w in enumerate(row) if w] or [-1]
        cut = slice(used[0], used[-1] + 1) if used[0] >= 0 else slice(0)
        if not layer or layer[-1][0] != cut:
            layer.append((cut, []))
        layer[-1][1].append((row[cut], _finite(b)))
    return layer


def _finite(number: Any) -> float:
    if not isfinite(number := float(number)):
        raise ValueError("a weight is not finite")
    return number


def replay(document: Written) -> tuple[ForceEstimator, float]:
    """How far off; infinitely where a status differs."""
    estimator, golden, worst = ForceEstimator(document), document["golden"], 0.0
    rows = zip(golden["reading"], golden["dt"], golden["value"], golden["status"], strict=True)
    for reading, dt, value, status in rows:
        found = estimator.step(dt, reading)
        worst = max(worst, abs(found.value - value) if found.status == status else inf)
    return estimator, worst
