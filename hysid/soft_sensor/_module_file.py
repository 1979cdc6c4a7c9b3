"""Models, compensators and estimators of any make as plain data and arrays, and back.

What is made is put together field by field: no constructor is run, and only classes of our own packages are
known, by their names.
"""

import math
import sys
from dataclasses import fields, is_dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import InputError

PACKAGES = ("hysteresis.", "compensate.")

Arrays = dict[str, np.ndarray]


def described(value: Any, name: str, arrays: Arrays) -> Any:
    """Plain data of a value; its arrays are added to `arrays`, their names beginning with `name`.

    Raises `InputError` for what is neither ours, nor an array, nor plain.
    """
    if isinstance(value, jax.Array | np.ndarray):
        arrays[name] = np.asarray(value)
        return {"array": name, "jax": isinstance(value, jax.Array)}
    if isinstance(value, float) and not math.isfinite(value):
        return {"number": repr(value)}  # which JSON does not have
    if value is None or isinstance(value, bool | int | float | str):
        return value
    kind = type(value)
    if _is_ours(kind):
        parts = {field: getattr(value, field) for field in _fields(kind)}
        found = {k: described(part, f"{name}.{k}", arrays) for k, part in parts.items()}
        return {"class": kind.__name__, "fields": found}
    if kind in (tuple, list):
        words = [described(part, f"{name}.{k}", arrays) for k, part in enumerate(value)]
        return {"tuple": words} if kind is tuple else words
    raise InputError(
        "not-storable", f"{name} is a {kind.__name__}, which cannot be saved to a file.",
        fix="Train another kind (--kind network).",
    )  # fmt: skip


def made(words: Any, arrays: Arrays) -> Any:
    """The inverse of `described`. Raises `InputError` for a class that is not ours, `KeyError` and
    `TypeError` for words that `described` does not write."""
    if isinstance(words, list):
        return [made(part, arrays) for part in words]
    if not isinstance(words, dict):
        return words
    if "array" in words:
        array = arrays[words["array"]]
        return jnp.asarray(array) if words["jax"] else array
    if "number" in words:
        return float(words["number"])
    if "tuple" in words:
        return tuple(made(part, arrays) for part in words["tuple"])
    kind = _class(words["class"])
    parts = {name: made(part, arrays) for name, part in words["fields"].items()}
    if set(parts) != set(_fields(kind)):
        raise TypeError(f"a {kind.__name__} has the fields {', '.join(_fields(kind))}")
    if not is_dataclass(kind):
        return kind(**parts)
    new: Any = object.__new__(kind)  # type: ignore[arg-type]
    for name, part in parts.items():
        object.__setattr__(new, name, part)
    return new


def _fields(kind: Any) -> tuple[str, ...]:
    return kind._fields if hasattr(kind, "_fields") else tuple(f.name for f in fields(kind))


def _is_ours(kind: Any) -> bool:
    has_fields = is_dataclass(kind) or (issubclass(kind, tuple) and hasattr(kind, "_fields"))
    return has_fields and kind.__module__.startswith(PACKAGES)


def _class(name: str) -> Any:
    """A class of ours that is loaded already: a file loads no module."""
    for module in [m for at, m in sys.modules.items() if at.startswith(PACKAGES)]:
        kind = vars(module).get(name)
        if isinstance(kind, type) and kind.__module__ == module.__name__ and _is_ours(kind):
            return kind
    raise InputError(
        "unknown-model", f"The file names the class {name!r}, which this version does not have.",
        cause="A newer version wrote it, or it was edited.", fix="Update hysid, or train again.",
    )  # fmt: skip
