"""Numbers and names as a reader wants them."""

import math

from hysteresis import Record
from hysteresis._format import digits_of
from identify.results._characteristics import Characteristic
from identify.results._data_sheet import SheetRow


def number(x: float, error: float | None = None) -> str:
    """Three digits, or those that leave two of the `error`; powers of ten written out."""
    if not math.isfinite(x):
        return "not finite"
    digits = digits_of(x, error, 3)
    if x != 0 and not 1e-4 <= abs(x) < 1e5:
        mantissa, power = f"{x:.{digits - 1}e}".split("e")
        return f"{mantissa.replace('-', '−')} × {power_of_ten(int(power))}"
    text = f"{x:#.{digits}g}" if abs(x) < 10 ** (digits - 1) else f"{float(f'{x:.{digits}g}'):,.0f}"
    return (text.rstrip(".") if x else "0").replace("-", "−")


def power_of_ten(exponent: float, digits: int = 6) -> str:
    """10 with its exponent raised, without mathematical text."""
    return "10" + f"{exponent:.{digits}g}".translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def quantity(x: float, unit: str) -> str:
    """A number with its unit."""
    return number(x) if unit == "1" else f"{number(x)} {pretty(unit)}"


def measured(one: Characteristic | SheetRow) -> str:
    """A characteristic with its error and its unit, where it is told."""
    if one.value is None:
        return "not told"
    unit = pretty(one.unit).replace("percent", "%")
    error = ""
    if one.error is not None:
        plain = 1e-4 <= one.error < 100
        error = f" ± {one.error:.2g}" if plain else f" ± {number(one.error)}"
    return f"{number(one.value, one.error)}{error} {unit}".rstrip()


def pretty(unit: str) -> str:
    return "" if unit == "1" else unit.replace(" * ", "·").replace(" / ", "/")


def plain_name(name: str, unit: str) -> str:
    """A column's name without the unit in it: "force (N)" and "force_N" are force."""
    for end in (f"({unit})", f"[{unit}]", f"_{unit}"):
        if name.endswith(end) and (plain := name.removesuffix(end).strip()):
            return plain
    return name


def name_of(record: Record, role: str) -> str:
    """The name of a record's input, output or time, without the unit in it."""
    return plain_name(getattr(record, f"{role}_name"), getattr(record, f"{role}_unit"))


def label_of(record: Record, role: str) -> str:
    """The label of its axis."""
    return label(name_of(record, role), getattr(record, f"{role}_unit"))


def label(name: str, unit: str) -> str:
    """Of an axis: the name is shortened before the unit."""
    unit = pretty(unit) or "no unit"
    most = 40 - len(unit)
    return f"{name if len(name) <= most else name[: most - 1] + '…'} ({unit})"


def axes_of(record: Record) -> tuple[str, str]:
    """Labels of input and output, with their units."""
    return label_of(record, "input"), label_of(record, "output")
