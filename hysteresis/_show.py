"""How models print: one line at a prompt, and a table of parameters with units and meanings."""

from collections.abc import Collection, Sequence
from dataclasses import fields
from typing import Any

import equinox as eqx
import numpy as np

from ._parameter import is_concrete, parameters

MOST_LINES = 30
"""Of what `print` shows of one object."""
FEW = 4
"""Numbers of an array that are written out."""


def one_line(module: eqx.Module) -> str:
    """A module as the call that makes it: numbers to six digits, long arrays by their shape."""
    given = [f for f in fields(module) if f.init and hasattr(module, f.name)]
    given = [f for f in given if not (f.kw_only and getattr(module, f.name) is None)]
    said = [f"{f.name}={_argument(getattr(module, f.name))}" for f in given]
    return f"{type(module).__name__}({', '.join(said)})"


def table(module: eqx.Module) -> str:
    """What a module is, and each of its parameters with value, unit and meaning; at most 30 lines."""
    said = (type(module).__doc__ or "").split("\n")[0]
    rows = [
        (f"  {name}", value_text(value), "" if info.unit == "1" else info.unit,
         " ".join(filter(None, (info.meaning, "(fixed)" * info.fixed))))
        for name, info, value in parameters(module) if value is not None
    ]  # fmt: skip
    head = f"{type(module).__name__}: {said}" if said else type(module).__name__
    return "\n".join(at_most([head, *aligned(rows)]))


def value_text(value: Any) -> str:
    """A parameter's value: the numbers where there are few, else their shape and range."""
    if not is_concrete(value):
        return "traced"
    x = np.asarray(value)
    if x.size <= FEW or not np.issubdtype(x.dtype, np.number):
        return _argument(x)
    return f"{' x '.join(map(str, x.shape))} numbers, {np.min(x):.4g} to {np.max(x):.4g}"


def aligned(rows: Sequence[Sequence[str]], right: Collection[int] = ()) -> list[str]:
    """Rows of cells as lines whose columns begin below each other; those `right` end so."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            f"{cell:{'>' if k in right else '<'}{width}}"
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def at_most(lines: Sequence[str], most: int = MOST_LINES) -> list[str]:
    """The first lines, and how many more there are."""
    if len(lines) <= most:
        return list(lines)
    return [*lines[: most - 1], f"... and {len(lines) - most + 1} more lines"]


def _argument(value: Any) -> str:
    if isinstance(value, eqx.Module):
        return one_line(value)
    if isinstance(value, tuple | list):
        if len(value) > 2 * FEW:
            return f"({len(value)} parts)"
        return f"({', '.join(map(_argument, value))})"
    if isinstance(value, np.ndarray | np.generic) or eqx.is_array(value):
        if not is_concrete(value):
            return "traced"
        x = np.asarray(value)
        if x.ndim == 0:
            return f"{x.item():.6g}" if np.issubdtype(x.dtype, np.floating) else str(x.item())
        if x.ndim == 1 and x.size <= FEW:
            return f"[{', '.join(map(_argument, x))}]"
        return f"array({' x '.join(map(str, x.shape))})"
    if value is None or isinstance(value, str | bool | int | float):
        return repr(value)
    return getattr(value, "__name__", None) or type(value).__name__
