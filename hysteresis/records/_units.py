"""Units of columns: from a header, a row of units, or the caller."""

import re
import unicodedata
from typing import NamedTuple

from .._errors import InputError
from .._format import LIMITS, LONGEST, SAID, is_within_grammar
from .._quantities import conversion
from .._verdict import Note, warning

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
    if unit is None and role == "time" and (alone := spelled(name)) in UNITS["time"]:
        unit = alone  # a column "ms", or "seconds"
    if unit is None:
        unit, notes = "1", [Note("no-unit", f"Column {name!r} names no unit: taken as 1.")]
    place, option = f"{path}, column {name!r}", f"{role}_unit= (--{role}-unit UNIT)"
    if unit != "1" and not _is_known(unit):
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
    own = named_unit(name, None, in_row)
    if own is not None and own != unit and _is_another(own, unit):
        said = f"Column {name!r} is in {own} by the file and taken as {unit}: no value is converted"
        notes.append(warning("other-unit", f"{said}; give {own}, or correct the file."))
    return unit, notes


def _is_another(own: str, unit: str) -> bool:
    """Whether a unit has another size than the column's own or is of another quantity, but kgf for kg and
    any beside brackets that hold none."""
    if factor := conversion(own, unit):
        return factor != 1.0
    return own != "1" and MASSES.get(own) != unit and _is_known(own)


def _is_known(unit: str) -> bool:
    return _is_of_rigs(unit) or _known(unit)


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


# Quantity of a column by its name and unit, in the languages that rigs use.


def words(text: str) -> frozenset[str]:
    """The words of a text."""
    return frozenset(text.split())


WORDS = {kind: words(said) for kind, said in SAID["words"].items()}
PHRASES = SAID["phrases"]
ASIDE, COMMANDED, AMPLITUDES, HEAT, CLOCKS = (
    words(SAID["other"][name]) for name in ("aside", "commanded", "amplitudes", "heat", "clocks")
)
OSCILLATION = "oscillation modulus"
"""The kind of a storage or loss modulus: its row is the result of an oscillation, not a sample of one."""

_UMLAUTS = dict(zip("äöüÄÖÜßłŁ", ["ae", "oe", "ue", "Ae", "Oe", "Ue", "ss", "l", "L"], strict=True))
_LAST_BRACKET = re.compile(r"(\([^()\[\]]*\)|\[[^()\[\]]*\]|\{[^{}]*\}|<[^<>]*>)\s*$")


class Kind(NamedTuple):
    """A quantity, and how sure that is: 1 by word and unit, 0.9 by unit, 0.8 by word, less else."""

    name: str
    sure: float
    commanded: bool = False


def words_of(header: str) -> list[str]:
    """The words of a header, without its unit: lower case, umlauts spelt out."""
    bare = header.removeprefix("field.")  # which stands before every name that rostopic prints
    bare = _LAST_BRACKET.sub("", bare) if _LAST_BRACKET.search(bare) else _without_unit(bare)
    bare = "".join(_UMLAUTS.get(c, c) for c in bare)
    plain = unicodedata.normalize("NFKD", bare).encode("ascii", "ignore").decode()
    return [w.lower() for w in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+", plain)]


def _without_unit(header: str) -> str:
    """A header without a unit behind a slash, a comma or "in"; behind an underscore it may be a word."""
    name, unit = name_and_unit(header)
    return header if unit is None or header == f"{name}_{unit}" else name


def unit_of(header: str, in_row: str | None) -> str:
    """The unit of a column, "1" for none; an unknown unit as it is written."""
    return named_unit(header, None, in_row) or "1"


def kind_of(header: str, unit: str, aside: bool = True) -> Kind:
    """What a column measures, "unknown" where neither word nor unit says.

    `aside`: whether words such as area, ratio and rate make it something about a quantity.
    """
    said = words_of(header)
    if "_" in header and said and header.rpartition("_")[2] == unit:
        said = said[:-1] or said  # force_N: the unit is no word
    plain = re.sub(r"(?<=\w)[.· ](?=\w)", "*", unit).replace("µ", "u").replace("μ", "u")
    by_unit = next((k for k, units in UNITS.items() if {unit, plain} & {*units}), "")
    phrase = next((k for k, e in PHRASES.items() if re.search(e, header, re.IGNORECASE)), "")
    by_word = [k for w in said for k, known in WORDS.items() if w in known]
    by_word = [phrase, *by_word] if phrase else by_word
    commanded = any(word in COMMANDED or word.startswith("soll") for word in said)  # Sollweg
    shares = (
        by_unit == "strain" and unit == "percent" and not {"strain", "displacement"} & {*by_word}
    )
    if shares and (by_word or ASIDE & set(said)):  # humidity (%), load (%)
        by_unit = ""
    if unit in MASSES and "force" in by_word:
        by_unit = "force"
    if phrase == "rate" and by_unit in ("speed", ""):
        return Kind("rate", 1.0 if by_unit else 0.8, commanded)
    if phrase in (OSCILLATION, "aside") or (phrase == "modulus" and by_unit in ("stress", "")):
        return Kind(phrase, 0.8)
    if "status" in said or unit == "code":
        return Kind("label", 0.8)
    if HEAT & set(said) and by_unit in ("temperature", ""):
        return Kind("aside" if ASIDE & set(said) else "temperature", 0.8, commanded)
    spread = "sigma" in said and by_unit != "stress" and len(set(said) - {"true", "eng"}) > 1
    if aside and (spread or (ASIDE | HEAT) & set(said)) and not CLOCKS & set(said):
        return Kind("aside", 0.8, commanded)
    part = 0.5 if AMPLITUDES & set(said) else 1.0
    if by_unit and by_unit in by_word:
        return Kind(by_unit, part, commanded)
    if by_unit:
        return Kind(by_unit, 0.9 * part, commanded)
    if by_word:
        return Kind(by_word[0], 0.8 * part, commanded)
    if re.fullmatch(r"[a-zA-Z]{1,3}_?\d{1,3}", header.strip()):
        return Kind("sensor", 0.5)  # s07, ch3: one of many channels
    return Kind("unknown", 0.3, commanded)
