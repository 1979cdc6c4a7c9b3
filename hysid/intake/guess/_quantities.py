"""Quantity of a column by its name and unit, in the languages that rigs use."""

import re
import unicodedata
from typing import NamedTuple

from hysteresis.records._units import MASSES, name_and_unit, named_unit


def words(text: str) -> frozenset[str]:
    """The words of a text."""
    return frozenset(text.split())


WORDS: dict[str, str] = {
    "time": "time t zeit pruefzeit testzeit laufzeit messzeit temps tiempo tempo czas godzina cas tijd tid "
    "timestamp clock elapsed zaman millis micros",
    "force": "force load kraft standardkraft pruefkraft normalkraft f fx fy fz fn last effort charge "
    "fuerza carga forza forca carico kuvvet obciazenie sila zatizeni kracht yuk "
    "zugkraft druckkraft thrust weight tension loadcell",
    "stress": "stress sigma pressure druck contrainte tensile zugspannung naprezenie napeti schubspannung "
    "druckspannung biegespannung esfuerzo sforzo gerilme cisaillement",
    "torque": "torque drehmoment couple mx my mz tx ty tz",
    "displacement": "displacement disp dist extension position pos weg standardweg traversenweg traverse "
    "distance crosshead stroke compression deflection gap depth travel indentation hub verformung "
    "deplacement desplazamiento deslocamento spostamento przemieszczenie posuv draha extensometer "
    "elongation length height lvdt z verlaengerung allongement estensione extensao "
    "uzama verplaatsing alongamento",
    "strain": "strain swelling dehnung stretch stauchung e eps epsilon deformation odksztalcenie "
    "deformacion deformacao deformazione druckdehnung zugdehnung rek drift gamma",
    "voltage": "voltage volt volts vout spannung u uout bridge",
    "current": "current strom courant corriente i",
    "resistance": "resistance widerstand r ohm res",
    "capacitance": "capacitance kapazitaet cap",
    "field": "field feld h gradient flux b induction",
    "moment": "moment magnetisation magnetization m",
    "polarization": "polarization polarisation",
    "angle": "angle winkel rotation encoder",
    "sensor": "raw adc sensor signal reading counts count output fbg wavelength",
    "compliance": "compliance nachgiebigkeit",
    "modulus": "modulus modul",
    "temperature": "temperature temp temperatur",
    "speed": "speed velocity rate geschwindigkeit acceleration grad derivative",
    "frequency": "frequency freq frequenz frequence",
    "viscosity": "viscosity viskositaet viscosite",
    "index": "index row point points no nr number cycle cycles zyklus count marker line step",
    "label": "flag dropout status valid state mode error",
}
"""Words that name a quantity; German umlauts as ae, oe, ue."""

UNITS: dict[str, str] = {
    "time": "s ms us min h",
    "force": "N mN uN nN kN MN gf kgf lbf kip kips",
    "stress": "Pa kPa MPa GPa bar mbar psi ksi N/mm^2 N/mm² kgf/cm^2",
    "torque": "N*m mN*m uN*m kN*m N*mm lbf*in lbf*ft in*lbf ft*lbf",
    "displacement": "mm um nm cm m inch in µm mil",
    "strain": "mm/mm percent %",
    "voltage": "V mV uV V/V",
    "current": "A mA uA",
    "resistance": "Ohm ohm kohm Mohm kOhm Ω",
    "capacitance": "F pF nF uF",
    "field": "T mT uT Oe kOe A/m kA/m G kG Gs kV/cm kV/mm V/m MV/m V/um V/µm",
    "moment": "emu memu uemu A*m^2 A*m² emu/g emu/cm^3 A*m^2/kg A*m²/kg",
    "polarization": "C/m^2 C/m² mC/m^2 mC/m² uC/cm^2 uC/cm² uC/mm^2",
    "angle": "deg rad °",
    "temperature": "degC °C K C",
    "speed": "mm/s m/s mm/min rad/s 1/s",
    "frequency": "Hz kHz",
    "viscosity": "Pa*s mPa*s",
    "sensor": "count counts",
    "compliance": "1/Pa 1/kPa 1/MPa",
}

ASIDE = words(
    "std sd err error uncertainty noise filtered rate per area ratio speed velocity peak max min "
    "energy work scan fit center viscosity viskositaet viscosite quad coefficient "
    "humidity feuchte rh"
)
"""Words that make a column something about a quantity, not the quantity itself."""

CLOCKS = {"time", "zeit", "clock", "timestamp"}
COMMANDED = words(
    "command commanded cmd setpoint set target demand reference ref soll sollwert nominal desired"
)
"""A wish, not a reading."""
AMPLITUDES = words("complex komplex complexe oscillation amplitude dyn dynamic")
"""A result of one oscillation, not a sample of it."""
HEAT = words("temperature temp temperatur")

OSCILLATION = "oscillation modulus"
"""The kind of a storage or loss modulus: its row is the result of an oscillation, not a sample of one."""
PHRASES: tuple[tuple[str, str], ...] = (
    ("rate", r"shear ?rate|gradient de cisaillement|(vitesse|taux) de cisaillement|scher(rate|geschw)"
                   r"|剪切速率|せん断速度|^GP\b|γ̇|gamma ?dot"),
    (OSCILLATION, r"storage|loss modul|stockage|module de perte|speichermodul|verlustmodul|tan ?\(?delta|"
                  r"\((elastic|viscous|complex) component\)|^\|?[EG](\*|'|\"|_?(stor|loss)\b)"),
    ("modulus", r"relaxation modul|relaxationsmodul|^[EG](_?relax|\(t\))"),
    ("acidity", r"^pH\b"),
    ("aside", r"normal stress|contrainte normale|normalspannung|phase angle|raw phase"),
    ("stress", r"应力|応力|응력"),
    ("strain", r"应变|ひずみ|변형률|деформаци"),
    ("time", r"时间|時間|시간|время"),
    ("displacement", r"位移|变形|行程|変位|ストローク|変形|변위|перемещен"),
    ("force", r"载荷|載荷|荷重|负荷|试验力|試験力|力$|力[ (（]|하중|сила|нагрузк|siła"),
    ("temperature", r"温度"),
    ("voltage", r"电压|電圧"),
    ("current", r"电流|電流"),
    ("torque", r"扭矩|トルク"),
    ("angle", r"角度"),
    ("field", r"磁场|磁場"),
    ("moment", r"磁矩|磁化"),
    ("polarization", r"极化"),
)  # fmt: skip
"""Quantities of several words, or of letters that are not Latin; the first that is found."""


_UMLAUTS = {
    "ä": "ae",
    "ö": "oe",
    "ü": "ue",
    "Ä": "Ae",
    "Ö": "Oe",
    "Ü": "Ue",
    "ß": "ss",
    "ł": "l",
    "Ł": "L",
}


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
    by_unit = next((k for k, units in UNITS.items() if {unit, plain} & {*units.split()}), "")
    phrase = next((k for k, e in PHRASES if re.search(e, header, re.IGNORECASE)), "")
    by_word = [k for w in said for k, known in WORDS.items() if w in known.split()]
    by_word = [phrase, *by_word] if phrase else by_word
    commanded = bool(COMMANDED & set(said))
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
