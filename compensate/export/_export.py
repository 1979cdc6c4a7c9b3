"""Compensators as files that run without JAX: JSON for `compensate.runtime`, a header for C99."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError

from .._invert import invert
from ..runtime._compensator import KIND
from ..runtime._file import SCHEMA, write
from ..runtime._tree import node_of
from ..uncertainty._calibrated import CalibratedCompensator
from ._c99_header import header
from ._element_tree import error_tree, program_of

GOLDEN, GOLDEN_SEARCHED = 200, 40
"""Samples that a file is checked with when it is loaded; fewer where each is a search."""

DEEP = 4096


class Quantity(NamedTuple):
    """Name and unit of what goes in, or comes out."""

    name: str
    unit: str = "1"


OUTPUT, INPUT = Quantity("output"), Quantity("input")


class Exported(NamedTuple):
    """A file, and what to mind, in sentences."""

    path: Path
    notes: tuple[str, ...]


def export_runtime(
    model: AbstractModel, path: str | Path, readings: ArrayLike, **options: Any
) -> Exported:
    """Write the inverse of a model as JSON for `compensate.runtime.load`.

    **Arguments:**

    - `model`: fitted, of one set of parameters.
    - `readings`: (samples,) outputs that it was fitted to: their range is what the compensator is good for,
      the first of them its golden pair.

    **Other arguments:**

    - `times`: (samples,) of the readings, for models that depend on the rate.
    - `reading`, `estimate`: name and unit of the model's output and input.
    - `title`: in a line.
    - `error`: `calibrated(invert(model), record)`, for the deviation beside every estimate.
    - `limits`: readings beyond are taken for the nearer limit; by default half the readings' span on
      either side.
    - `depth`: reversals that a Preisach model remembers, 64 by default.

    Raises `InputError` where the model has no inverse, cannot be exported, or needs times.
    """
    document, notes = _document(model, readings, np.float64, **options)
    return Exported(write(path, document), notes)


def export_c(
    model: AbstractModel,
    path: str | Path,
    readings: ArrayLike,
    *,
    real: str = "double",
    **options: Any,
) -> Exported:
    """Write the inverse of a model, and the model, as one C99 header; arguments as of `export_runtime`.

    `real`: "double" or "float". All names begin with the file's.

    Raises `InputError` as `export_runtime`, and where the file's name is no name in C.
    """
    path = Path(path)
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", path.stem):
        raise InputError(
            "bad-name", f"{path.stem!r} is no name in C.",
            fix="letters, digits and _, a letter first.",
        )  # fmt: skip
    if real not in ("double", "float"):
        raise InputError("bad-option", f"no numbers {real!r}.", fix="double or float.")
    precision = np.float32 if real == "float" else np.float64
    document, notes = _document(model, readings, precision, **options)
    path.write_text(header(document, path.stem, single=real == "float"), "utf-8")
    return Exported(path, notes)


def _document(
    model: AbstractModel, readings: Any, precision: type, *, times: Any = None,
    reading: Quantity = OUTPUT, estimate: Quantity = INPUT, title: str = "",
    limits: tuple[float, float] | None = None, depth: int = 64,
    error: CalibratedCompensator | None = None,
) -> tuple[dict[str, Any], tuple[str, ...]]:  # fmt: skip
    tree = program_of(model, precision, depth)
    y = np.asarray(readings, float)
    t = None if times is None else np.asarray(times, float)
    finite = np.isfinite(y)
    if finite.sum() < 2:
        raise InputError("no-rows", "there are no readings to export for.")
    y, t = y[finite], None if t is None else t[finite]
    low, high = limits or _wider(y)
    rates, kinds = any(map(_has_rates, _nodes(tree))), {node["kind"] for node in _nodes(tree)}
    if rates and t is None:
        raise InputError(
            "no-time", "this model depends on the rate, and no times were given.",
            fix="give the times of the readings.",
        )  # fmt: skip
    n = GOLDEN_SEARCHED if "sum" in kinds else GOLDEN
    y, t = np.clip(y, low, high), np.zeros_like(y) if t is None else t
    compensator = invert(model)
    value = np.asarray(compensator.simulate(t[:n], y[:n]).value)
    start = compensator.simulate(t[:1], jnp.full(1, jnp.nan)).value[0]
    document = {
        "schema": SCHEMA, "kind": KIND, "title": title or type(model).__name__,
        "reading": reading._asdict(), "estimate": estimate._asdict(),
        "limits": [float(low), float(high)], "rates": rates, "start": float(start), "tree": tree,
        "error": error and error_tree(error),
        "golden": {
            "dt": np.diff(t[:n], prepend=t[0]).tolist(), "reading": y[:n].tolist(),
            "value": value.tolist(), "tolerance": 1e-9 * max(float(np.ptp(value)), 1e-300),
        },
    }  # fmt: skip
    return document, _notes(model, precision, y, t, depth) if "preisach" in kinds else ()


def _wider(y: np.ndarray) -> tuple[float, float]:
    low, high = float(y.min()), float(y.max())
    return low - (high - low) / 2, high + (high - low) / 2


def _nodes(tree: dict[str, Any]) -> Iterator[dict[str, Any]]:
    yield tree
    for part in tree.get("parts", ()):
        yield from _nodes(part)


def _has_rates(node: dict[str, Any]) -> bool:
    p = node.get("parameters", {})
    return (
        node["kind"] in ("chain", "maxwell") or bool(p.get("forgetting")) or any(p.get("rates", ()))
    )


def _notes(
    model: AbstractModel, precision: type, y: np.ndarray, t: np.ndarray, depth: int
) -> tuple[str, ...]:
    """Whether the stack is deep enough for the readings."""
    deep = program_of(model, precision, DEEP)
    needed = _deepest(deep, np.diff(t, prepend=t[0]).tolist(), y.tolist())
    if needed <= depth:
        return ()
    return (
        f"these readings open up to {needed} reversals, and the stack holds {depth}: the smallest loops are"
        f" forgotten. A depth of {needed} holds all.",
    )


def _deepest(tree: dict[str, Any], dt: Sequence[float], y: Sequence[float]) -> int:
    states: list[Any] = []
    node = node_of(tree, states)
    stacks = [s for s in states if hasattr(s, "forgotten")]
    most = 0
    for step, reading in zip(dt, y, strict=True):
        node.find(step, reading)
        most = max(most, *(s.depth for s in stacks))
    return most
