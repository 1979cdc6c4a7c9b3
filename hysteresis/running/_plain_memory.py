"""The same as `_memory.py` without numba: m, n and the table of tangents are NumPy's."""

from typing import Any

import numpy as np

from ._memory_sizes import MOST


def get(m: Any, i: int) -> float:
    return float(m[i])


def whole(n: Any, i: int) -> int:
    return int(n[i])


def put(m: Any, i: int, x: float) -> None:
    m[i] = x


def _mark(t: Any, x: int, *given: Any) -> None:
    others = list(given[::2])
    t[x] = np.asarray(given[1::2]) @ t[others] if others else 0.0


def _spot(t: Any, x: int, a: int, d: float) -> None:
    t[x] += d * t[a]


MARKS = {"spot": _spot} | dict.fromkeys((f"mark{count}" for count in range(MOST + 1)), _mark)
