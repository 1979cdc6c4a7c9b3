"""What may be written as a unit: names with exponents, multiplied and divided, within limits.

Units come from files, so they are read by this grammar before anything calculates with them:

    unit   = factor { ["*" | "·" | "/" | " "] factor }
    factor = ( name | "1" | "(" unit ")" ) [ ("**" | "^") power ]
    power  = ["+" | "-"] number | "(" ["+" | "-"] number ["/" number] ")"
"""

import re

LONGEST, MOST_FACTORS, DEEPEST, LARGEST_POWER = 64, 16, 4, 12
"""Characters, factors and parentheses of a unit, and the largest exponent."""

LIMITS = (
    f"a unit is names with exponents up to {LARGEST_POWER}, such as N/mm or m/s^2, with at most"
    f" {MOST_FACTORS} factors and {LONGEST} characters."
)

_TOKEN = re.compile(
    r"\s*(?:(?P<raised>\*\*|\^)|(?P<times>//|[*/·⋅])|(?P<open>\()|(?P<close>\))"
    r"|(?P<name>[^\W\d]\w*|[°%‰Ω℧″′]\w*|[µμ]\w*)|(?P<number>[+-]?[0-9]+(?:\.[0-9]+)?(?![\w.])))"
)
_POWER = re.compile(
    r"\s*(?:(?P<bare>[+-]?[0-9]+(?:\.[0-9]+)?)(?![\w.])"
    r"|\(\s*(?P<top>[+-]?[0-9]+(?:\.[0-9]+)?)\s*(?:/\s*(?P<below>[1-9][0-9]?)\s*)?\))"
)


def is_within_grammar(unit: str) -> bool:
    """Whether a text is a unit by the grammar above, its names known or not, and within the limits."""
    if len(unit) > LONGEST:
        return False
    at, depth, factors, wants = 0, 0, 0, True  # wants: a factor has to come
    unit = unit.rstrip()
    while at < len(unit):
        if (found := _TOKEN.match(unit, at)) is None:
            return False
        at, kind = found.end(), found.lastgroup
        if kind == "raised":
            power = _POWER.match(unit, at)
            if wants or power is None or not _is_small(power):
                return False
            # Of a power of a power the size would not be limited.
            at = power.end()
            if (after := _TOKEN.match(unit, at)) and after.lastgroup in ("raised", "number"):
                return False
        elif kind == "times":
            if wants:
                return False
            wants = True
        elif kind == "close":
            if wants or depth == 0:
                return False
            depth -= 1
        elif kind == "number" and found["number"] != "1":
            return False
        else:
            wants = kind == "open"
            depth, factors = depth + wants, factors + 1
            if depth > DEEPEST or factors > MOST_FACTORS:
                return False
    return not wants and depth == 0


def _is_small(power: re.Match[str]) -> bool:
    return abs(float(power["bare"] or power["top"])) <= LARGEST_POWER
