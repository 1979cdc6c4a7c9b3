"""Numbers in sentences and on a terminal: a value with its unit, and data that JSON can hold."""

import math
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np


def quantity(x: float, unit: str, digits: int = 4) -> str:
    """A value with its unit, which is left away where it is "1"."""
    return f"{x:.{digits}g}" if unit == "1" else f"{x:.{digits}g} {unit}"


def ends(low: float, high: float, unit: str = "1", digits: int = 4) -> str:
    """A range; of a narrow one far from 0 as many digits as tell all but one of its width.

    (1e6, 1000020) -> "1000000 to 1000020"
    """
    width, far = 10.0 ** (3 - digits) * (high - low), max(low, high, key=abs)
    digits = max(digits, digits_of(far, width, digits))
    return f"{low:.{digits}g} to {quantity(high, unit, digits)}"


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


# Words of columns and units, and what may be written as a unit: without JAX, as reading needs none.

SAID = tomllib.loads(Path(__file__).with_name("quantities.toml").read_text("utf-8"))
"""How columns and units are written, and what they mean: the one table of such words."""
LONGEST, LARGEST_POWER = 64, 12
"""Characters of a unit, and its largest exponent."""

LIMITS = (
    f"a unit is names with exponents up to {LARGEST_POWER}, such as N/mm or m/s^2, of at most {LONGEST}"
    " characters."
)

_POWER = re.compile(
    r"(?:\*\*|\^)\s*(?:[+-]?(?P<bare>\d+(?:\.\d+)?)(?![\w.])"
    r"|\(\s*[+-]?(?P<top>\d+(?:\.\d+)?)\s*(?:/\s*[1-9]\d?\s*)?\))(?!\s*(?:\*\*|\^))"
)
_ODD = re.compile(r"\*\*|\^|[^\w\s*/·⋅()°%‰Ω℧″′µμ]|(?<![\w.])(?!1(?![\w.]))\d")
"""What a unit does not hold beside small powers: another power, another sign, a number but 1."""


def is_within_grammar(unit: str) -> bool:
    """Whether a text is names, known or not, with small exponents, multiplied and divided.

    Units come from files, so this is asked before anything calculates with them.
    """
    small = lambda one: "" if float(one["bare"] or one["top"]) <= LARGEST_POWER else "^"  # noqa: E731
    bare = _POWER.sub(small, unit)
    return bool(unit.strip()) and len(unit) <= LONGEST and _ODD.search(bare) is None
