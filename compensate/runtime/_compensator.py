"""`load`, and the compensator that it returns."""

from math import inf, isfinite, nan
from pathlib import Path
from typing import Any, NamedTuple, NotRequired, TypedDict

from hysteresis.laws._tree import Tree, around, step_of
from hysteresis.laws._types import check

from ._file import LONGEST, READING_MISSING, FileError, number, replayed
from ._status import Status

# What a compensator's document holds, as types.


class Quantity(TypedDict):
    """A name and a unit."""

    name: str
    unit: str


class Condition(Quantity):
    """A condition and its known range."""

    low: float
    high: float


class Origin(TypedDict):
    """The verdict on the fit, the codes of its reasons, the date of the data."""

    verdict: str | None
    codes: list[str]
    date: str | None


class Lasting(TypedDict):
    """The part of the error's variance that lasts, and the time in which it decays."""

    share: float | None
    time: float | None


class Band(TypedDict):
    """A guaranteed band."""

    factor: float
    guarantee: float
    runs: NotRequired[int]
    by_deviation: bool


class Operations(TypedDict):
    """How many operations a step takes, and over how many readings that was counted."""

    mean: float
    most: float
    readings: float


class Golden(TypedDict):
    """Readings and the estimates they give; null where there is none."""

    dt: list[float]
    reading: list[float]
    condition: NotRequired[list[float]]
    value: list[float | None]
    tolerance: float


class Document(TypedDict):
    """A compensator's file; what is not required was not written by earlier versions."""

    title: str
    reading: Quantity
    estimate: Quantity
    limits: list[float]
    rates: bool
    longest: NotRequired[float | None]
    inputs: NotRequired[list[float]]
    start: float | None
    tree: dict[str, Any]
    error: dict[str, Any] | None
    guard: NotRequired[dict[str, Any] | None]
    starts: NotRequired[list[list[dict[str, Any]]]]
    origin: NotRequired[Origin | None]
    condition: NotRequired[Condition | None]
    coverage: NotRequired[float | None]
    lasting: NotRequired[Lasting | None]
    band: NotRequired[Band | None]
    operations: NotRequired[Operations | None]
    golden: Golden


KIND = "hysid compensator"
SWEPT = 33
"""Readings over all that are known, with which a file is tried."""

_STATUSES = tuple(Status)
_MADE = ("_states", "_step", "_own", "_learner")
"""What `reset` makes of the file's trees: closures, which can be neither copied nor pickled."""


class Estimate(NamedTuple):
    """The input behind a reading, what it is worth, and its standard deviation: NaN where none is known."""

    value: float
    status: Status
    deviation: float


class Compensator:
    """The input of a model behind its output, reading by reading.

    - `title`; `reading`, `estimate`: names and units, {"name", "unit"}.
    - `limits`: of readings that are known; beyond, the nearer limit is taken, EXTRAPOLATED.
    - `rates`: whether the model, or its deviation, depends on the rate; `step` ignores the time where
      neither does.
    - `longest`: time between two readings; a longer one is taken for it, EXTRAPOLATED.
    - `condition`: name, unit and known range of the condition that `step` needs beside the reading,
      {"name", "unit", "low", "high"}; None where the model depends on none.
    - `trained`: inputs of the training rows, None where the file does not know them; `beyond`: "limit",
      "nan" or "free", what becomes of estimates beyond. Their status is EXTRAPOLATED.
    - `lasting`: {"share", "time"}: the part of the error's variance that lasts, and the time in which that
      decays to 1/e, in the unit of `dt` (in readings where the record had no times), for filters in which
      the error is a state; None where the file does not know it.
    - `coverage`: the part of held-out rows that estimate +- 1.645 deviations held, where 0.9 is meant; None
      where the file does not know it.
    - `band`: of the last estimate; it holds whole runs with a guaranteed probability.
    - `advice` and `lost`: of a compensator that recalibrates itself.
    - `origin`: {"verdict", "codes", "date"}: the verdict on the fit, the codes of its reasons, and the date
      of the data, ISO 8601; None where they are not known.

    The JAX compensator that was exported gives the same to 1e-9 of the range.
    """

    def __init__(self, document: dict[str, Any]):
        check(document, Document)
        self.title: str = document["title"]
        self.reading: dict[str, str] = document["reading"]
        self.estimate: dict[str, str] = document["estimate"]
        self.limits: tuple[float, float] = tuple(document["limits"])
        self.rates: bool = document["rates"]
        self.longest: float = document.get("longest") or LONGEST
        self._band: Tree | None = document.get("band")
        self.lasting: dict[str, float] | None = document.get("lasting")
        self.coverage: float | None = document.get("coverage")
        self._checksum = document.get("checksum")
        # Files of format 1 have neither guard nor origin.
        self.origin: dict[str, Any] | None = document.get("origin")
        guard = document.get("guard")
        if guard and "within" not in guard["parameters"]:
            # A file of format 2 does not say where else it may have begun: it says RUN_IN for ever.
            own = guard["parameters"]
            own |= {"slack": own["rounding"], "decides": 0, "least": inf, "most": -inf}
            own["within"] = -1.0 if own["unknown"] else inf
        self.trained: tuple[float, float] | None = None
        if guard:
            self.trained = guard["parameters"]["low"], guard["parameters"]["high"]
        self.beyond: str = guard["beyond"] if guard else "free"
        self.condition: dict[str, Any] | None = document.get("condition")
        self._tree = around(document)
        self.reset()

    def reset(self) -> None:
        """The state before the first reading."""
        self._states: list[Any] = []
        self._step, self._own, self._learner = step_of(self._tree, self._states)

    def step(
        self,
        dt: float,
        reading: float | None = None,
        condition: float | None = None,
        *,
        reference: float | None = None,
    ) -> Estimate:
        """One reading in, one estimate out.

        `dt`: time since the last call, at most `longest`; the first one's does not matter, and one that is
        negative or not a number is none. It is ignored where `rates` is False. `condition`: at
        this reading, where the model depends on one; beyond its known range the nearer end is taken,
        EXTRAPOLATED. A reading or a condition that is NaN or infinite is INVALID: the last estimate is
        held, and nothing else changes.
        `reference`: the true input, where it is known and the compensator recalibrates itself; the estimate
        is made before it is looked at.

        Raises `TypeError` without a `reading`, without a `condition` where the model depends on one, and
        for a reference that it cannot learn from.
        """
        if reading is None:
            raise TypeError(READING_MISSING)
        if reference is not None:
            if self._learner is None:
                raise TypeError("this compensator does not learn: export it with adaptive=...")
            if isfinite(reference):
                self._learner[2].reference, self._learner[2].known = reference, 1
                try:
                    return self.step(dt, reading, condition)
                finally:
                    self._learner[2].known = 0
        if self.condition is None:
            condition = 0.0
        elif condition is None:
            name = self.condition["name"]
            raise TypeError(f"this compensator depends on {name}: step(dt, reading, condition)")
        # A number of NumPy would stay in the state: of single precision, or an array.
        since = float(dt) if self.rates else 0.0
        value, own = self._step(since, float(reading), float(condition)), self._own
        return Estimate(value, _STATUSES[own.status], own.deviation)

    @property
    def advice(self) -> int:
        """Why a calibration is needed now, see `adaptive`; 0 where none is, or it does not learn."""
        return 0 if self._learner is None else self._learner[0].advice(*self._learner[1:])

    @property
    def lost(self) -> float:
        """The rms error that estimates have beyond that of the fit; 0 where it does not learn."""
        return 0.0 if self._learner is None else self._learner[0].lost(*self._learner[1:])

    @property
    def band(self) -> tuple[float, float] | None:
        """The ends of the guaranteed band of the last estimate; None where the file has none."""
        if self._band is None:
            return None
        half = self._band["factor"] * (self._own.deviation if self._band["by_deviation"] else 1.0)
        return self._own.value - half, self._own.value + half

    def state(self) -> Tree:
        """All that changes, as plain data for JSON: `restore` goes on from there.

        **Example:**

            >>> file = compensate.export_runtime(model, folder / "sensor.json", model.simulate(t, u)).path
            >>> sensor = compensate.runtime.load(file)
            >>> before = sensor.state()
            >>> _ = sensor.step(0.01, 1.0)
            >>> sensor.restore(before)
            >>> sensor.state() == before
            True
        """
        own = self._own
        return {
            "checksum": self._checksum, "begun": bool(own.begun), "_value": number(own.value),
            "_waited": own.waited, "_deviation": number(own.deviation),
            "nodes": [_copied(vars(one)) for one in self._states[:-1]],
        }  # fmt: skip

    def restore(self, state: Tree) -> None:
        """Go on from a `state` of this file.

        Raises `FileError` where it belongs to another file.
        """
        nodes, own = state.get("nodes", ()), self._own
        if state.get("checksum") != self._checksum or len(nodes) != len(self._states) - 1:
            raise FileError("This state belongs to another file.")
        for one, values in zip(self._states, nodes, strict=False):
            vars(one).update(_copied(values))
        for name in ("value", "waited", "deviation"):
            kept = state.get(f"_{name}", getattr(own, name))
            setattr(own, name, nan if kept is None else kept)
        own.begun = int(state["begun"])

    def __getstate__(self) -> dict[str, Any]:
        rest = {name: value for name, value in vars(self).items() if name not in _MADE}
        return {**rest, "state": self.state()}

    def __setstate__(self, kept: dict[str, Any]) -> None:
        vars(self).update({name: value for name, value in kept.items() if name != "state"})
        self.reset()
        self.restore(kept["state"])


def _copied(values: dict[str, Any]) -> dict[str, Any]:
    return {key: list(v) if isinstance(v, list) else v for key, v in values.items()}


def load(path: str | Path) -> Compensator:
    """The compensator of a file, once it has replayed the golden pair in it.

    Raises `FileError` where the file cannot be used: not one, of another format, changed, or replayed
    otherwise.
    """
    return replayed(path, {KIND: ("readings give estimates {:.3g} off", replay)})


def replay(document: dict[str, Any]) -> tuple[Compensator, float]:
    """How far off; infinitely where one is NaN alone."""
    compensator, golden = Compensator(document), document["golden"]
    held = golden.get("condition") or [None] * len(golden["dt"])
    rows = zip(golden["reading"], golden["dt"], held, golden["value"], strict=True)
    worst = max(_apart(compensator.step(dt, y, c).value, value) for y, dt, c, value in rows)
    # Where lists are too short, readings find out that the golden ones do not reach.
    low, high = compensator.limits
    known = compensator.condition
    for k in range(SWEPT):
        share = k % 11 / 10
        c = None if known is None else known[("low", "high")[k % 2]]
        compensator.step(golden["dt"][-1], low + (high - low) * share, c)
    return compensator, worst


def _apart(found: float, wanted: float | None) -> float:
    """How far off an estimate is; None stands for NaN, which JSON does not have."""
    if wanted is None or found != found:
        return 0.0 if wanted is None and found != found else inf
    return abs(found - wanted)
