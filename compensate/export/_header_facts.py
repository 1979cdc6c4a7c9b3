"""What a header says about the fit it comes from: trained inputs, run-in, verdict, date of the data."""

from collections.abc import Callable
from typing import Any

from hysteresis._escape import c_string, visible

BEYOND = {"limit": "is held there", "nan": "is NaN", "free": "is given as it is"}


def trained(document: dict[str, Any], stem: str) -> str:
    """The trained inputs, what becomes of an estimate beyond them, and when the memory is known."""
    if not (guard := document["guard"]):
        return ""
    p, upper = guard["parameters"], stem.upper()
    text = (
        f" The model was trained on {p['low']:.6g} to {p['high']:.6g};"
        f" an estimate beyond {BEYOND[guard['beyond']]},\n{upper}_EXTRAPOLATED."
    )
    if not p["unknown"]:
        return text
    wait = f", and {p['time']:.4g} of dt have passed" if p["time"] else ""
    ends = "there was a reading"
    if p["bottom"] < p["top"]:
        ends = f"an estimate was at most {p['bottom']:.6g}, another at least {p['top']:.6g}"
    return f"{text}\nAfter a reset the status is {upper}_RUN_IN until {ends}{wait}."


def condition(document: dict[str, Any], stem: str) -> str:
    """The condition that a step needs beside the reading, and the range in which it is known."""
    if not (known := document.get("condition")):
        return ""
    unit = "" if known["unit"] == "1" or known["unit"] in known["name"] else f" in {known['unit']}"
    return (
        f"condition: {visible(known['name'] + unit)}, from {known['low']:.6g} to {known['high']:.6g};"
        f" beyond, the nearer end is taken,\n{stem.upper()}_EXTRAPOLATED.\n"
    )


def origin(document: dict[str, Any]) -> str:
    """The verdict on the fit, the codes of its reasons, and the date of its data."""
    if not (known := document["origin"]):
        return ""
    codes = f" ({', '.join(known['codes'])})" if known["codes"] else ""
    said = (
        f"verdict on the fit: {known['verdict'] or 'not known'}{codes}."
        f" Date of the data: {known['date'] or 'not known'}."
    )
    return f"\n\n{visible(said)}"


def facts(document: dict[str, Any], stem: str, literal: Callable[[float], str]) -> str:
    """The same for programs, as macros: they take no memory."""
    found: dict[str, str] = {}
    if guard := document["guard"]:
        low, high = (guard["parameters"][end] for end in ("low", "high"))
        found |= {"TRAINED_LOW": literal(low), "TRAINED_HIGH": literal(high)}
    if known := document["origin"]:
        words = {"VERDICT": "verdict", "DATA_DATE": "date"}
        found |= {macro: c_string(known[key]) for macro, key in words.items()}
        found["CODES"] = c_string(" ".join(known["codes"]))
    return "\n".join(f"#define {stem.upper()}_{name} {text}" for name, text in found.items())
