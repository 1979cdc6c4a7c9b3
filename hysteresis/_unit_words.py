"""Words of columns and units, and what may be written as a unit: without JAX, as reading needs none."""

import re
import tomllib
from pathlib import Path

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
