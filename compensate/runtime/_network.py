"""Force from the readings of a soft sensor: a trained network, sample by sample, in plain Python."""

from collections.abc import Callable, Sequence
from math import exp, inf, isfinite
from pathlib import Path
from types import FunctionType
from typing import Any

from ._compensator import Estimate
from ._file import LONGEST, replayed
from ._status import Status
from ._tree import node_of

KIND = "hysid force estimator"

_OK, _EXTRAPOLATED, _SATURATED = Status.OK, Status.EXTRAPOLATED, Status.SATURATED

TERMS = 50
"""Of a sum, in one statement: Python's compiler goes as deep as the sum is long."""


MOST = 200_000
"""Weights of a network; compiling that many takes seconds."""


class ForceEstimator:
    """Force from readings, as `compensate.microchannel.ForceEstimator`, reading by reading, without JAX.

    - `title`; `channels`: name and unit of every reading, {"name", "unit"}; `estimate`: of the force.
    - `limits`: (low, high) of every channel in the training; readings beyond them are EXTRAPOLATED.
    - `high`: the largest force; a larger estimate is cut to it and SATURATED. `deviation`: of the force.
    - `rates`: whether `step` needs the time since the last reading; `longest`: of it. A longer one is taken
      for that, EXTRAPOLATED.

    The JAX estimator that was exported gives the same to 1e-9 of the largest force.

    **Example:**

        >>> y = model.simulate(t, u)
        >>> file = compensate.microchannel.export_force(estimator, folder / "force.json", y)
        >>> compensate.runtime.load_force(file).step(100.0).status.name
        'SATURATED'
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
            self._move = _Network(model).move
        elif model["kind"] == "tree":
            node = node_of(model["tree"])
            follow = {"move": node.move, "find": node.find}[model["way"]]
            self._move = lambda dt, u: follow(dt, u[0])
        else:
            raise ValueError(f"no model {model['kind']!r}")
        self._value, self._waited, self._begun = 0.0, 0.0, False

    def step(self, reading: float | Sequence[float], dt: float | None = None) -> Estimate:
        """One reading in, a number for one channel, one for each for several; one force out.

        `dt`: time since the last call, s; the first one's does not matter. A reading of which a channel is
        NaN or infinite is INVALID: the last force is held, and nothing else changes.

        Raises `TypeError` where the model depends on the rate and `dt` is left out, `ValueError` for
        another number of channels.
        """
        if dt is None:
            if self.rates:
                raise TypeError("this estimator depends on the rate: step(reading, dt)")
        elif dt > 0.0:
            self._waited = min(self._waited + dt, self.longest)
        readings: Any = reading if hasattr(reading, "__len__") else (reading,)
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


class _Network:
    """A network as `hysteresis.networks.StaircaseNetwork` is, its scales put into the layers, with a memory
    of its own: the plays and the delayed readings of every channel."""

    def __init__(self, model: dict[str, Any]):
        self._step = _written_out(model)
        self._times: list[float] = model["times"]
        each = len(model["thresholds"]) + len(model["times"])
        self._held = [float(rest) for rest in model["rest"] for _ in range(each)]
        self._dt, self._kept = -1.0, []

    def move(self, dt: float, readings: Sequence[float]) -> float:
        """The next output."""
        if dt != self._dt:
            kept = [exp(-dt / tau) for tau in self._times]
            self._dt, self._kept = dt, [part for k in kept for part in (k, 1.0 - k)]
        value, self._held = self._step(self._held, self._kept, readings)
        return value


def _written_out(model: dict[str, Any]) -> Callable[..., Any]:
    """Memory and layers as one Python function without loops, in a third of the time that loops take:
    (memory, parts kept and taken, readings) -> output, memory.

    What is compiled is made of counts alone, and nothing of a file is in it: its numbers are the values of
    arguments c0, c1, and so on. Weights of 0 are left out: networks side by side are one with blocks on the
    diagonal.

    Raises `ValueError` for a number that is not finite.
    """
    numbers: list[float] = []

    def named(number: Any) -> str:
        number = float(number)
        if not isfinite(number):
            raise ValueError("a weight is not finite")
        numbers.append(number)
        if len(numbers) > MOST:
            raise ValueError(f"a network has more than {MOST:,} weights")
        return f"c{len(numbers) - 1}"

    thresholds, lags = model["thresholds"], range(len(model["times"]))
    inputs, held, moves = [], [], []
    for c, scale in enumerate(model["scale"]):
        plays, delayed = [f"z{c}_{k}" for k in range(len(thresholds))], [f"q{c}_{k}" for k in lags]
        for z, r in zip(plays, thresholds, strict=True):
            half = named(scale * r)
            moves.append(f"a = u{c} - {half}; b = u{c} + {half}")
            moves.append(f"{z} = a if {z} < a else b if {z} > b else {z}")
        moves += [f"{q} = k{k} * {q} + m{k} * u{c}" for k, q in enumerate(delayed)]
        held += [*plays, *delayed]
        inputs += [f"u{c}", *plays, *delayed]
    given = {"u": [f"u{c}" for c in range(len(model["scale"]))], "held": held}
    given["kept"] = [f"{part}{k}" for k in lags for part in "km"]
    lines = [f"{', '.join(names)}, = {name}" for name, names in given.items() if names]
    lines += moves
    seen, layers = inputs, list(zip(model["matrices"], model["biases"], strict=True))
    for layer, (matrix, bias) in enumerate(layers):
        found = []
        for k, (row, b) in enumerate(zip(matrix, bias, strict=True)):
            terms = [f"{named(w)}*{name}" for w, name in zip(row, seen, strict=True) if w]
            sums = [terms[n : n + TERMS] for n in range(0, len(terms), TERMS)]
            lines.append(f"v = {named(b)}")
            lines += [f"v = v + {' + '.join(part)}" for part in sums]
            found.append(f"h{layer}_{k}")
            if layer < len(layers) - 1:
                lines.append(f"{found[-1]} = v if v > 0.0 else 0.0")
        seen = found
    lines.append(f"return v, ({', '.join(held)}{',' if held else ''})")
    takes = ["held", "kept", "u", *(f"c{k}" for k in range(len(numbers)))]
    names: dict[str, Any] = {}
    exec("\n    ".join([f"def step({', '.join(takes)}):", *lines]), names)
    step: FunctionType = names["step"]
    step.__defaults__ = tuple(numbers)
    return step


def load_force(path: str | Path) -> ForceEstimator:
    """Load a force estimator from a file that `compensate.microchannel.export_force` wrote, and verify it.

    The estimator first replays the readings that the file contains, and must find their forces again.

    **Raises:** `FileError` where the file is missing, damaged, changed or of another format, or where the
    replay gives other forces.

    **Example:**

        >>> y = model.simulate(t, u)
        >>> file = compensate.microchannel.export_force(estimator, folder / "force.json", y)
        >>> runtime = compensate.runtime.load_force(file)
        >>> [round(runtime.step(float(reading)).value, 6) for reading in y[:4]]
        [0.0, 1.0, 2.0, 3.0]
    """
    return replayed(path, KIND, "readings give forces {:.3g} off", _replay)


def _replay(document: dict[str, Any]) -> tuple[ForceEstimator, float]:
    """How far off; infinitely where a status differs."""
    estimator, golden, worst = ForceEstimator(document), document["golden"], 0.0
    rows = zip(golden["reading"], golden["dt"], golden["value"], golden["status"], strict=True)
    for reading, dt, value, status in rows:
        found = estimator.step(reading, dt)
        worst = max(worst, abs(found.value - value) if found.status == status else inf)
    return estimator, worst
