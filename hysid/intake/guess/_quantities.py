"""Quantity of a column by its name and unit, in the languages that rigs use."""

import re
import unicodedata
from typing import NamedTuple

from hysteresis.records._units import named_unit


def words(text: str) -> frozenset[str]:
    """The words of a text."""
    return frozenset(text.split())


WORDS: dict[str, str] = {
    "time": "time t zeit pruefzeit testzeit temps tiempo tempo timestamp clock elapsed zaman millis micros",
    "force": "force load kraft standardkraft pruefkraft normalkraft f fx fy fz fn last effort charge "
    "fuerza carga forza kuvvet thrust weight tension loadcell",
    "stress": "stress sigma pressure druck contrainte tensile",
    "torque": "torque drehmoment couple",
    "displacement": "displacement disp dist extension position pos weg standardweg traversenweg traverse "
    "distance crosshead stroke compression deflection gap depth travel indentation hub verformung "
    "deplacement desplazamiento spostamento extensometer elongation length height lvdt z",
    "strain": "strain dehnung stretch stauchung e eps epsilon deformation drift gamma",
    "voltage": "voltage volt volts vout spannung u uout bridge",
    "current": "current strom courant corriente i",
    "resistance": "resistance widerstand r ohm res",
    "capacitance": "capacitance kapazitaet cap",
    "field": "field feld h gradient flux b induction",
    "moment": "moment magnetisation magnetization m",
    "angle": "angle winkel rotation encoder",
    "sensor": "raw adc sensor signal reading counts count output fbg wavelength",
    "compliance": "compliance nachgiebigkeit",
    "modulus": "modulus modul",
    "temperature": "temperature temp temperatur",
    "speed": "speed velocity rate geschwindigkeit frequency freq acceleration grad derivative",
    "index": "index row point no nr number cycle cycles zyklus count marker line step",
    "label": "flag dropout status valid state mode error",
}
"""Words that name a quantity; German umlauts as ae, oe, ue."""

UNITS: dict[str, str] = {
    "time": "s ms us min h",
    "force": "N mN uN kN gf kgf lbf",
    "stress": "Pa kPa MPa GPa bar mbar psi N/mm^2 N/mm²",
    "torque": "Nm N*m N.m Nmm",
    "displacement": "mm um cm m inch in µm",
    "strain": "mm/mm percent %",
    "voltage": "V mV uV V/V",
    "current": "A mA uA",
    "resistance": "Ohm ohm kohm Mohm kOhm Ω",
    "capacitance": "F pF nF uF",
    "field": "T mT Oe A/m",
    "moment": "emu A*m^2 Am2",
    "angle": "deg rad °",
    "temperature": "degC °C K C",
    "speed": "mm/s m/s mm/min Hz 1/s",
    "sensor": "count counts",
    "compliance": "1/Pa 1/kPa 1/MPa",
}

ASIDE = words(
    "std sd err error uncertainty noise filtered rate per area ratio speed velocity peak max min "
    "energy work temperature temp"
)
"""Words that make a column something about a quantity, not the quantity itself."""

CLOCKS = {"time", "zeit", "clock", "timestamp"}
COMMANDED = words(
    "command commanded cmd setpoint set target demand reference ref soll sollwert nominal desired"
)
"""A wish, not a reading."""


_UMLAUTS = {"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss"}


class Kind(NamedTuple):
    """A quantity, and how sure that is: 1 by word and unit, 0.9 by unit, 0.8 by word, less else."""

    name: str
    sure: float
    commanded: bool = False


def words_of(header: str) -> list[str]:
    """The words of a header, without its unit: lower case, umlauts spelt out."""
    bare = header.removeprefix("field.")  # which stands before every name that rostopic prints
    bare = re.sub(r"[(\[][^()\[\]]*[)\]]\s*$", "", bare)
    bare = "".join(_UMLAUTS.get(c, c) for c in bare)
    plain = unicodedata.normalize("NFKD", bare).encode("ascii", "ignore").decode()
    return [w.lower() for w in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+", plain)]


def unit_of(header: str, in_row: str | None) -> str:
    """The unit of a column, "1" for none; an unknown unit as it is written."""
    return named_unit(header, None, in_row) or "1"


def kind_of(header: str, unit: str) -> Kind:
    """What a column measures, "unknown" where neither word nor unit says."""
    said = words_of(header)
    if "_" in header and said and header.rpartition("_")[2] == unit:
        said = said[:-1] or said  # force_N: the unit is no word
    by_unit = next((k for k, units in UNITS.items() if unit in units.split()), "")
    by_word = [k for w in said for k, known in WORDS.items() if w in known.split()]
    commanded = bool(COMMANDED & set(said))
    if unit in ("g", "kg", "mg") and "force" in by_word:
        by_unit = "force"
    spread = "sigma" in said and by_unit != "stress" and len(set(said) - {"true", "eng"}) > 1
    if (spread or ASIDE & set(said)) and not CLOCKS & set(said):
        return Kind("aside", 0.8, commanded)
    if by_unit and by_unit in by_word:
        return Kind(by_unit, 1.0, commanded)
    if by_unit:
        return Kind(by_unit, 0.9, commanded)
    if by_word:
        return Kind(by_word[0], 0.8, commanded)
    if re.fullmatch(r"[a-zA-Z]{1,3}_?\d{1,3}", header.strip()):
        return Kind("sensor", 0.5)  # s07, ch3: one of many channels
    return Kind("unknown", 0.3, commanded)
