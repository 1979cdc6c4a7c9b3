"""Compensators as files that run without JAX: JSON for `compensate.runtime`, a header for C99."""

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError
from hysteresis._files import write_whole
from hysteresis._quantities import conversion
from hysteresis.laws import announced
from hysteresis.models._conditioned import condition_of
from hysteresis.records._branch_rows import STILL
from hysteresis.running._law import law
from hysteresis.trees import Tree, plain

from .._contract import AbstractCompensator
from .._invert import invert
from ..guards._guarded import GuardedCompensator
from ..guards._guarded import longest_step as longest_step
from ..inverses._law import goes_back_only, stable_step
from ..recalibration._adaptive import AdaptiveCompensator
from ..runtime._compensator import KIND
from ..runtime._file import COMPENSATOR_SCHEMA, number
from ..uncertainty._calibrated import CalibratedCompensator
from ..uncertainty._guaranteed import Guaranteed
from ._c99_header import STANDARD, banded, header
from ._document import LONGEST as LONGEST_MOTION
from ._document import (
    Model,
    Motion,
    Moved,
    guard_tree,
    nodes_of,
    require_double,
    require_one_input,
    starts_in,
    states_over,
    tree_of,
    with_grids,
    write,
)
from ._operation_count import Operations, measured

FAR = 1000.0
"""Spans of the estimates that an input may be beyond."""

GOLDEN, GOLDEN_SEARCHED = 200, 40
"""Samples that a file is checked with when it is loaded; fewer where each is a search."""

COUNTED = 2000
"""Readings over which the operations of a step are counted, evenly."""

DEPTH, DEEP = 64, 4096
"""Reversals that an export stores at least by default, and so many that none is dropped."""


class Quantity(NamedTuple):
    """Name and unit of what goes in, or comes out."""

    name: str
    unit: str = "1"


OUTPUT, INPUT = Quantity("output"), Quantity("input")


def _named(given: Quantity, carried: str) -> Quantity:
    """A quantity with the unit that the model carries. Raises `InputError` `wrong-unit` for another one."""
    if given.unit == "1" or carried == "1":
        return given._replace(unit=carried if given.unit == "1" else given.unit)
    if conversion(given.unit, carried) != 1.0:
        raise InputError(
            "wrong-unit",
            f"{given.name!r} is given in {given.unit}, and the model has it in {carried}.",
            fix="leave the unit out, or fit a record in the wanted unit.",
        )
    return given


class Origin(NamedTuple):
    """What a file says about the fit it comes from.

    - `verdict`: its level, "PASS", "CAUTION" or "FAIL"; `codes`: of the verdict's reasons.
    - `date`: of the data, ISO 8601 ("2024-05-03"); `sha256`: checksum of their file. Each is "" or () where
      it is not known.
    """

    verdict: str = ""
    codes: tuple[str, ...] = ()
    date: str = ""
    sha256: str = ""


class Exported(NamedTuple):
    """A file, and what to mind, in sentences."""

    path: Path
    notes: tuple[str, ...]


def export_runtime(model: Model, path: str | Path, readings: ArrayLike, **options: Any) -> Exported:
    """Write the inverse of a model as JSON for `compensate.runtime.load`.

    **Arguments:**

    - `model`: fitted, of one set of parameters.
    - `readings`: (samples,) outputs that it was fitted to, or (samples, 2) outputs and conditions where the
      model depends on one: their range is what the compensator is good for, the first of them its golden
      pair.

    **Other arguments:**

    - `times`: (samples,) of the readings, for models that depend on the rate.
    - `reading`, `estimate`: name and unit of the model's output and input; the units that the model
      carries by default.
    - `title`: in a line.
    - `error`: `calibrated(invert(model), record)`, for the deviation beside every estimate.
    - `limits`: readings beyond are taken for the nearer limit; by default half the readings' span on
      either side.
    - `depth`: reversals that a Preisach model remembers; by default 64, or what the readings need.
    - `trained`: (low, high), the least and the greatest input of the training rows; `beyond`, `start`,
      `past` (by default what the readings tell), `deviation` and `seen` as of `invert`. The file gives the
      values and statuses of what that returns, with `readings=limits`. None: no guard.
    - `adaptive`: `adaptive(model, record)`, for a compensator that recalibrates itself.
    - `band`: `guaranteed(...)` of this compensator, for the band beside every estimate. Its shape is
      constant, or the deviation of the same `error`.
    - `origin`: the verdict on the fit, the date and the checksum of its data, for the file's readers.
    - `time_unit`: of `times`; targets that have a clock convert its seconds.

    Raises `InputError` where the model has no inverse, cannot be exported, or needs times, where it carries
    another unit than is given, and where JAX runs in single precision.

    **Example:**

        >>> done = compensate.export_runtime(model, folder / "sensor.json", model.simulate(t, u))
        >>> round(compensate.runtime.load(done.path).step(0.01, float(model.simulate(t, u)[0])).value, 6)
        0.0
    """
    return Program(model, readings, **options).write_runtime(path)


def export_c(
    model: Model,
    path: str | Path,
    readings: ArrayLike,
    *,
    real: str = "double",
    **options: Any,
) -> Exported:
    """Write the inverse of a model, and the model, as one C99 header; arguments as of `export_runtime`.

    `real`: "double" or "float". All names begin with the file's.

    Raises `InputError` as `export_runtime`, and where the file's name is no name in C.

    **Example:**

        >>> done = compensate.export_c(model, folder / "sensor.h", model.simulate(t, u))
        >>> done.path.name, done.notes
        ('sensor.h', ())
    """
    return Program(model, readings, **options).write_c(path, real)


class Program:
    """A compensator with all that its files hold, made once for any number of them.

    Arguments as of `export_runtime`.
    """

    def __init__(
        self,
        model: Model,
        readings: ArrayLike,
        *,
        times: ArrayLike | None = None,
        reading: Quantity = OUTPUT,
        estimate: Quantity = INPUT,
        title: str = "",
        limits: tuple[float, float] | None = None,
        depth: int | None = None,
        error: CalibratedCompensator | None = None,
        trained: tuple[float, float] | None = None,
        beyond: str = "limit",
        start: str = "known",
        past: tuple[ArrayLike | None, ArrayLike] | None = None,
        deviation: float = 0.0,
        seen: tuple[float, float] | None = None,
        origin: Origin | None = None,
        time_unit: str = "s",
        adaptive: AdaptiveCompensator | None = None,
        band: Guaranteed | None = None,
    ):
        require_double()
        if (units := getattr(model, "units", None)) is not None:
            back, forth = units.output, units.input
            if isinstance(model, Moved):
                back, forth = forth, back
            reading, estimate = _named(reading, back), _named(estimate, forth)
        original, model = model, with_grids(model) if isinstance(model, AbstractModel) else model
        compensator: AbstractCompensator | Motion
        if isinstance(model, Moved):
            compensator = Motion(model)
        else:
            if past is None and start == "unknown" and times is not None:
                known = invert(model).simulate(np.asarray(times, float), np.asarray(readings))
                past = (times, known.value)
            compensator = invert(
                model, trained=trained, beyond=beyond, start=start, past=past, deviation=deviation,
                seen=seen,
            )  # fmt: skip
        if adaptive is not None:
            if start == "unknown":
                raise InputError(
                    "bad-option",
                    "A compensator that recalibrates itself begins in a known state.",
                    fix='give start="known".',
                )
            guarded = isinstance(compensator, GuardedCompensator)
            compensator = replace(compensator, inner=adaptive) if guarded else adaptive
        self._adaptive, self.model, self.depth = adaptive, model, DEEP
        nodes = list(nodes_of(self._tree(np.float64)))
        y, conditioned = np.asarray(readings, float), condition_of(model)
        if y.ndim != 1 + (conditioned is not None):
            raise InputError(
                "wrong-shape",
                f"readings of shape {y.shape} for a {type(model).__name__}.",
                fix="give (samples,) outputs, or (samples, 2) outputs and conditions where it needs them.",
            )
        c = y[:, 1] if conditioned else np.zeros(len(y))
        y = y[:, 0] if conditioned else y
        finite = np.isfinite(y) & np.isfinite(c)
        if finite.sum() < 2:
            raise InputError("no-rows", "There are fewer than two finite readings to export for.")
        y, c = y[finite], c[finite]
        t = None if times is None else np.asarray(times, float)[finite]
        rates, kinds = any(map(has_rates, nodes)), {node["kind"] for node in nodes}
        # The error may depend on the speed where the model does not.
        counts_time = rates or (t is not None and error is not None and error.knows_speeds)
        if rates and t is None:
            raise InputError(
                "no-time", "This model depends on the rate, and no times were given.",
                fix="give the times of the readings.",
            )  # fmt: skip
        low, high = limits or wider(y)
        if not -np.inf < low <= high < np.inf:
            raise InputError(
                "bad-option", f"Readings cannot be limited from {low:g} to {high:g}.",
                fix="Give the lower limit, then the upper one (--limits LOW HIGH).",
            )  # fmt: skip
        self.guard = compensator if isinstance(compensator, GuardedCompensator) else None
        y, t = np.clip(y, low, high), np.zeros_like(y) if t is None else t
        given = np.column_stack([y, c]) if conditioned else y
        dt, self._needed = np.diff(t, prepend=t[0]), 0
        if "preisach" in kinds:
            deep = tree_of(model, depth=DEEP)
            self._needed = deepest(deep, "find", dt.tolist(), given.tolist())
        self.depth = depth or max(DEPTH, self._needed)
        tree = self._tree(np.float64)
        n = GOLDEN_SEARCHED if kinds & {"sum", "adaptive", "degrading_bouc_wen"} else GOLDEN
        golden = _told_apart(compensator, t[:n], given[:n])
        value = np.asarray(compensator.simulate(t[:n], golden).value)
        begin = compensator.simulate(t[:1], jnp.full(given[:1].shape, jnp.nan)).value[0]
        self.time_unit = time_unit
        known = None
        if conditioned is not None:
            ends = np.asarray(conditioned.knots, float)[[0, -1]]
            margin = STILL * float(np.ptp(ends))
            known = {
                "name": conditioned.condition, "unit": conditioned.unit,
                "low": float(ends[0]) - margin, "high": float(ends[1]) + margin,
            }  # fmt: skip
        if isinstance(model, Moved):
            longest = LONGEST_MOTION * float(np.median(np.diff(t)))
        else:
            longest = min(longest_step(t), stable_step(model))
        reached = [*value[np.isfinite(value)], *(trained or ())] or [0.0]
        span = float(np.ptp(reached))  # the first readings alone may rest at one end
        away = FAR * max(span, 1e-3 * float(np.abs(reached).max()), 1e-30)
        self._samples = np.column_stack([dt, given])[:COUNTED].tolist()
        self._trees: dict[type, Tree] = {np.float64: tree}
        starts, self._tabulated = self.guard.starts if self.guard else (), 0.0
        if original is not model and isinstance(original, AbstractModel):
            u = np.nan_to_num(value)
            driven = np.column_stack([u, c[:n]]) if conditioned else u
            self._tabulated = _apart(original, model, t[:n], driven)
        self._rest = {
            "schema": COMPENSATOR_SCHEMA, "kind": KIND, "title": title or type(model).__name__,
            "reading": reading._asdict(), "estimate": estimate._asdict(),
            "limits": [float(low), float(high)], "rates": counts_time,
            "longest": longest if counts_time else None,
            "inputs": [float(min(reached)) - away, float(max(reached)) + away], "start": number(begin),
            "origin": origin and {**origin._asdict(), "codes": list(origin.codes)},
            "error": error and plain(error.law()), "condition": known,
            "starts": starts_in(tree, model, starts),
            "coverage": error and number(error.coverage),
            "lasting": error and {"share": error.share, "time": error.lasts},
            "band": band and banded(band, error),
            "golden": {
                "dt": dt[:n].tolist(),
                "reading": (golden[:, 0] if conditioned else golden).tolist(),
                **({} if known is None else {"condition": c[:n].tolist()}),
                "value": [number(v) for v in value], "tolerance": 1e-9 * max(span, 1e-300),
            },
        }  # fmt: skip
        require_one_input(self._whole(), self._deep_enough())

    def document(self, precision: type = np.float64) -> dict[str, Any]:
        """What `compensate.runtime` loads, for numbers of a precision."""
        return self._whole(precision, operations=self.operations._asdict())

    def _whole(self, precision: type = np.float64, **more: Any) -> dict[str, Any]:
        if precision not in self._trees:
            self._trees[precision] = self._tree(precision)
        guard = self.guard and guard_tree(self.guard, precision)
        return {**self._rest, **more, "tree": self._trees[precision], "guard": guard}

    def _tree(self, precision: type) -> Tree:
        tree = tree_of(self.model, precision, self.depth)
        if self._adaptive is None:
            return tree
        return self._adaptive.tree(tree, float(np.finfo(precision).eps), self.depth)

    @cached_property
    def operations(self) -> Operations:
        """Of a step over the first of the readings, see `Operations`."""
        return measured(self._whole(), self._samples)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Whether the stack is deep enough for the readings, and what a tabulated density costs."""
        tabulated = (
            "The density was tabulated on a grid: on these readings outputs differ by at most"
            f" {100 * self._tabulated:.2g} per cent of their range."
        )
        return (*self._deep_enough(), *[tabulated] * bool(self._tabulated))

    @property
    def stacks(self) -> bool:
        """Whether it stores reversals, at most `depth` of them."""
        return any(node["kind"] == "preisach" for node in nodes_of(self._tree(np.float64)))

    def _deep_enough(self) -> tuple[str, ...]:
        if self._needed <= self.depth:
            return ()
        return (
            f"These readings need {self._needed} stored reversals but the export keeps {self.depth}, so"
            f" the smallest loops are dropped. Use a depth of {self._needed} to keep all.",
        )

    @property
    def predicts(self) -> bool:
        """Whether the header has the model itself too; of an oscillator it has not."""
        return not goes_back_only(self._trees[np.float64])

    def write_runtime(self, path: str | Path) -> Exported:
        """`export_runtime` of what was prepared."""
        return Exported(write(path, self.document()), self.notes)

    def write_c(self, path: str | Path, real: str = "double") -> Exported:
        """`export_c` of what was prepared."""
        path = Path(path)
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", path.stem) or path.stem.lower() in STANDARD:
            raise InputError(
                "bad-name", f"{path.stem!r} cannot be the name of a header.",
                fix="letters, digits and _, a letter first, and not the name of a header of C itself.",
            )  # fmt: skip
        if real not in ("double", "float"):
            raise InputError("bad-option", f"real={real!r} is unknown.", fix="double or float.")
        document = self.document(np.float32 if real == "float" else np.float64)
        write_whole(path, header(document, path.stem, single=real == "float"))
        return Exported(path, self.notes)


def _told_apart(
    compensator: AbstractCompensator | Motion, t: np.ndarray, given: np.ndarray
) -> np.ndarray:
    """Readings, of none of which rounding decides between two estimates, as at the end of a flat place.

    Those whose estimates jump where all readings rise by a rounding are moved a thousandth inwards.
    """
    given = np.array(given)
    y = given.reshape(len(given), -1)[:, 0]  # the others are conditions
    middle, span = (y.min() + y.max()) / 2, float(np.ptp(y))
    rounding = 1e-12 * max(span, float(np.abs(y).max()))
    for _ in range(5):
        found = []
        for by in (-rounding, rounding):
            near = given.copy()
            near.reshape(len(near), -1)[:, 0] += by
            found.append(np.asarray(compensator.simulate(t, near).value))
        jump = np.nan_to_num(np.abs(found[1] - found[0]))
        jumps = jump > 1e-3 * float(np.ptp(np.nan_to_num(found[0])))
        y[jumps] += 1e-3 * span * np.sign(middle - y[jumps])
        if not jumps.any():
            break
    return given


def _apart(given: AbstractModel, tabulated: Any, t: np.ndarray, u: np.ndarray) -> float:
    """The largest difference of two models' outputs at some inputs, in parts of their range."""
    one, other = (np.asarray(model.simulate(t, u)) for model in (given, tabulated))
    return float(np.abs(one - other).max() / max(float(np.ptp(one)), 1e-300))


def wider(y: np.ndarray) -> tuple[float, float]:
    """The limits of an export by default: half the readings' span beyond them on either side."""
    low, high = float(y.min()), float(y.max())
    return low - (high - low) / 2, high + (high - low) / 2


def has_rates(node: Tree) -> bool:
    """Whether time changes anything: its law takes it, and the numbers beside it are not all 0."""
    kind, p = node["kind"], node.get("parameters", {})
    if kind in ("series", "adaptive"):
        return bool(p) and p["spread"][1] > 0  # the zero drifts
    beside = () if kind in announced() else {"rates", "drives", "forgetting"} & p.keys()
    takes = any(law(kind).takes_time(x) for x in ("move", "find") if x in law(kind).functions)
    return takes and (not beside or any(np.any(p[x]) for x in beside))


def deepest(tree: Tree, way: str, dt: Sequence[float], y: Sequence[Any]) -> int:
    """Reversals that are open at once, at most, where a tree is run one way over some readings."""
    every = (s for states in states_over(tree, way, dt, y) for s in states)
    return max((s.depth for s in every if hasattr(s, "forgotten")), default=0)
