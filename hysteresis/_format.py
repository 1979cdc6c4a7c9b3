"""Numbers in sentences and on a terminal: a value with its unit, and data that JSON can hold."""

import math
from typing import Any

import numpy as np


def quantity(x: float, unit: str, digits: int = 4) -> str:
    """A value with its unit, which is left away where it is "1"."""
    return f"{x:.{digits}g}" if unit == "1" else f"{x:.{digits}g} {unit}"


def rms_error(figures: dict[str, Any], unit: str) -> str:
    """An rms error, and its part of the range where there is one."""
    part, rms = figures["nrmse_percent"], quantity(figures["rmse"], unit)
    has_range = part is not None and math.isfinite(part)
    return f"{rms} rms, {part:.3g} % of the range" if has_range else f"{rms} rms"


def with_error(x: float, error: float) -> str:
    """A value with its error in two digits, rounded where that ends."""
    nothing = not x or abs(x) < error / 200 < math.inf
    value = "0" if nothing else f"{x:#.{digits_of(x, error, 4)}g}".replace(".e", "e").rstrip(".")
    return f"{value} ± {error:.2g}"


def digits_of(x: float, error: float | None, usual: int) -> int:
    """How many digits of a value leave two of its error, 1 to 8; the `usual` ones without an error."""
    if error is None or not (x and 0 < error < math.inf):
        return usual
    return min(max(1, 2 + math.floor(math.log10(abs(x))) - math.floor(math.log10(error))), 8)


def number_of(n: int, what: str) -> str:
    """So many of something: 1 loop, 2 loops."""
    return f"{n} {what}{'s' * (n != 1)}"


def duration(x: float, unit: str) -> str:
    """A time with its unit: in milliseconds where it is below one second."""
    return f"{1000 * x:.3g} ms" if unit == "s" and x < 1 else quantity(x, unit)


def plain(value: Any) -> Any:
    """Data that JSON can hold: NumPy becomes Python, numbers that are not finite become None.

    **Example:**

        >>> identify.internal.plain({"rms": np.float64(0.5), "ends": (1.0, np.nan)})
        {'rms': 0.5, 'ends': [1.0, None]}
    """
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.generic | np.ndarray):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
