"""Quantity of a column by its name and unit, in the languages that rigs use."""

import re
import unicodedata
from typing import NamedTuple

from .._unit_words import SAID
from ._units import MASSES, UNITS, name_and_unit, named_unit


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
_BRACKET = re.compile(r"(\([^()\[\]]*\)|\[[^()\[\]]*\]|\{[^{}]*\}|<[^<>]*>)\s*$")


class Kind(NamedTuple):
    """A quantity, and how sure that is: 1 by word and unit, 0.9 by unit, 0.8 by word, less else."""

    name: str
    sure: float
    commanded: bool = False


def words_of(header: str) -> list[str]:
    """The words of a header, without its unit: lower case, umlauts spelt out."""
    bare = header.removeprefix("field.")  # which stands before every name that rostopic prints
    bare = _BRACKET.sub("", bare) if _BRACKET.search(bare) else _without_unit(bare)
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
