"""Units of columns: from a header, a row of units, or the caller."""

import re
import unicodedata

from .._errors import InputError
from .._note import Note
from .._unit_words import LIMITS, LONGEST, SAID, is_within_grammar

UNITS = {quantity: units.split() for quantity, units in SAID["units"].items()}
RIG_UNITS, _QUALIFIERS = (SAID["other"][name].split() for name in ("written", "qualifiers"))
MASSES: dict[str, str] = SAID["masses"]
_SPELLING, _IN_WORDS = (
    {word: unit for unit, words in SAID[name].items() for word in words.split()}
    for name in ("spellings", "in_words")
)
_WIDE = str.maketrans("（）［］｛｝", "()[]{}")
_BRACKET = re.compile(
    r"^(?P<name>.*?)\s*(\((?P<a>[^()\[\]]*)\)|\[(?P<b>[^()\[\]]*)\]|\{(?P<c>[^{}]*)\}|<(?P<d>[^<>]*)>)$"
)
# "Kraft in kN", "Load, N", "Force / N", "P1 uC_per_cm2", "v_mm/s" and "F/N", as norms and labs write them.
_BEHIND = (
    re.compile(r"^(?P<name>.+?)\s+in\s+(?P<unit>\S+)$"),
    re.compile(r"^(?P<name>.+?),\s*(?P<unit>[^\s,]+)$"),
    re.compile(r"^(?P<name>.+?)\s+/\s*(?P<unit>\S+)$"),
    re.compile(r"^(?P<name>.+?)[\s_]+(?P<unit>[^\W_]+_per_[^\W_]+|(?<=_)[^\W_]+/[^\W_]+)$"),
    re.compile(r"^(?P<name>[^\s/]+)/(?P<unit>[^\s/]+)$"),
)


def bare_unit(cell: str) -> str:
    """A cell without blanks and brackets around its unit; those of (N/mm)/s are part of it."""
    bare = cell.strip().strip("[]()").strip()
    return cell.strip() if set(bare) & set("[]()") else bare


def spelled(unit: str) -> str:
    """A unit as this package spells it: "Sec" is s, "Volts" is V, "-" is 1, "s-¹" is 1/s."""
    bare = bare_unit(unit)
    if bare.endswith(".") and bare[:-1].isalpha():  # sec., in., lb.
        bare = bare[:-1]
    bare = bare.replace("_per_", "/").replace("・", "*")
    # ℃, ㎜ and ％ are characters of their own; a superscript is not one of these.
    bare = "".join(unicodedata.normalize("NFKC", c) if c >= "℀" else c for c in bare)
    if set(re.split(r"[./*]", bare)) <= {*RIG_UNITS}:
        bare = bare.replace(".", "*")  # N.m
    bare = _IN_WORDS.get(bare.lower().replace(" ", ""), _SPELLING.get(bare, bare or "1"))
    bare = re.sub(r"(?<=[A-Za-zµ])([23])(?=$|[/*])", r"^\1", bare)  # m/s2, uC/cm2
    if re.fullmatch(r"[A-Za-zµ]+-[A-Za-z]+", bare):  # N-m
        bare = bare.replace("-", "*")
    return f"1/{bare[:-2]}" if re.fullmatch(r"[A-Za-z]+(-¹|⁻¹|-1)", bare) else bare


def is_unit(text: str) -> bool:
    """Whether this is a unit, in the spelling of rigs or of pint."""
    text = spelled(text)
    if not re.search(r"[^\W_]|[%°'\"]", text):  # a line below a header
        return False
    number = text[:1].isdigit() and not text.startswith("1/")
    # A name and its unit: pint, which takes a second to load, knows none.
    if re.search(r"\w\s+[(\[]", text):
        return False
    return text == "1" or _is_of_rigs(text) or (not number and _known(text))


def are_units(cells: list[str]) -> bool:
    """No number among them, and at least two units that rigs use: a sample may be called A."""
    bare = [bare_unit(c) for c in cells]
    return sum(spelled(c) in RIG_UNITS for c in bare) > 1 and not any(
        re.match("[+-]?[.,]?[0-9]", c) for c in bare
    )


def name_and_unit(header: str) -> tuple[str, str | None]:
    """What a header names, and the unit that stands behind it as the file writes it; None without any.

    Units stand in brackets, behind an underscore, or behind a slash, a comma or "in" where it is one that
    rigs use.
    """
    if bracket := _BRACKET.match(header.translate(_WIDE)):
        unit = next(part for part in bracket.group("a", "b", "c", "d") if part is not None).strip()
        return bracket["name"], None if unit.lower() in _QUALIFIERS else unit
    name, _, suffix = header.rpartition("_")
    if name and suffix and (suffix in RIG_UNITS or suffix in _SPELLING):
        return name, suffix
    for form in _BEHIND:
        found = form.match(header)
        if found and _is_of_rigs(found["unit"]):
            ratio = form is _BEHIND[-1] and _is_of_rigs(found["name"])  # mV/V is a unit alone
            return (header, None) if ratio else (found["name"], found["unit"])
    return header, None


def _is_of_rigs(text: str) -> bool:
    """Whether this is a unit that rigs use, or a product or quotient of such."""
    parts = re.split(r"[/*·.]", re.sub("[µμ]", "u", spelled(text)).removeprefix("1/"))
    return all(re.sub(r"\^?[23²³]$", "", part) in RIG_UNITS for part in parts)


def written_unit(name: str, in_row: str | None) -> str | None:
    """The unit of a column as the file writes it, without brackets; None without any.

    It comes from the row of units (`in_row`, "" where that row has none for the column), or the header.
    """
    if in_row is not None:
        return bare_unit(in_row) or None
    return name_and_unit(name)[1]


def named_unit(name: str, given: str | None, in_row: str | None) -> str | None:
    """The unit of a column in our spelling, whether or not there is one like it; None without any.

    It comes from the caller (`given`), the row of units (`in_row`) or the header (`name`), in that order.
    """
    unit = written_unit(name, in_row) if given is None else given
    return None if unit is None else spelled(unit)


def column_unit(
    name: str, role: str, given: str | None, in_row: str | None, path: str
) -> tuple[str, list[Note]]:
    """The unit of a column, see `named_unit`, and what is to be noted about it.

    Raises `unknown-unit`, `wrong-unit`; the message names `path` and the option of the `role`.
    """
    unit, notes = named_unit(name, given, in_row), []
    if unit is None:
        unit, notes = "1", [Note("no-unit", f"Column {name!r} names no unit: taken as 1.")]
    place, option = f"{path}, column {name!r}", f"{role}_unit= (--{role}-unit UNIT)"
    if unit != "1" and not _is_of_rigs(unit) and not _known(unit):
        mend = f"{option}: 'count', '1', or a unit to which the values are scaled."
        shown = unit if len(unit) <= LONGEST else f"{unit[:LONGEST]}..."
        cause = "" if is_within_grammar(unit) else LIMITS
        raise InputError(
            "unknown-unit", f"Unit {shown!r} is unknown.", place=place, cause=cause, fix=mend
        )
    of_force = role != "condition" and re.match(r"force|load|f[xyz]?\b", name, re.IGNORECASE)
    if unit in MASSES and of_force:
        problem = f"{unit} is mass, not force."
        mend = f"{option} with {MASSES[unit]} (1 gf is 0.00981 N)."
        raise InputError("wrong-unit", problem, place=place, fix=mend)
    return unit, notes


def _known(unit: str) -> bool:
    if not is_within_grammar(unit):
        return False
    import pint

    # pint reads a.u. as the atomic mass unit times a year; rigs mean arbitrary units.
    if unit.lower().strip(".") in ("a.u", "au", "arb", "arb.unit", "arb. unit"):
        return False
    try:
        pint.get_application_registry().parse_units(unit)
    except Exception:  # pint raises its own, tokenizer's and arithmetic errors for odd text
        return False
    return True
