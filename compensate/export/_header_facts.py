"""What a header says about the fit it comes from: trained inputs, run-in, verdict, date of the data."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hysteresis._escape import c_string, visible
from hysteresis._format import ends
from hysteresis.laws._tree import Tree
from hysteresis.records._units import named_unit

from ..runtime._file import LONGEST
from ..runtime._status import Status

HEAD = """\
{title}

    {stem}_state state;
    {stem}_reset(&state);
    int status = {stem}_step(&state, dt, reading, {held}&estimate, &deviation);

reading: {reading}, from {limits}; beyond, the nearer end is taken.
estimate: {estimate}.{trained}
deviation: its standard deviation{unknown}; a null pointer for none.{motions}
{time}{condition}status: {stem_upper}_OK, or what the estimate is worth, below. NaN and infinity change
nothing: the last estimate is held. {stem}_reset is the state before the first sample;
{stem}_self_test replays what the file was made with. {predict}{origin}

Numbers are {real}. State: {state} bytes. Tables: {tables} bytes, constant.
{operations}No step can take more than {bound} operations (arithmetic, comparisons, look-ups,
assignments; a call of math.h for 250): a bound, which no reading need reach.
"""

STATUSES = {
    Status.OK: "as exact as the model",
    Status.EXTRAPOLATED: "beyond what is known: continued, or the nearer end taken",
    Status.SATURATED: "beyond the outputs the model can have: the end of its range is held",
    Status.FLAT: "the model does not change here: the nearest input is held",
    Status.BELOW_THRESHOLD: "no contact yet",
    Status.RUN_IN: "the memory before the first sample is not known yet",
    Status.INVALID: "the sample was not finite: nothing changed",
}

BEYOND = {"limit": "is held there", "nan": "is NaN", "free": "is given as it is"}


def trained(document: Tree, stem: str) -> str:
    """The trained inputs, what becomes of an estimate beyond them, and when the memory is known."""
    if not (guard := document["guard"]):
        return ""
    p, upper = guard["parameters"], stem.upper()
    text = (
        f" The model was trained on {ends(p['low'], p['high'], digits=6)};"
        f" an estimate beyond {BEYOND[guard['beyond']]},\n{upper}_EXTRAPOLATED."
    )
    if not (starts := len(document["starts"])):
        return text
    return (
        f"{text}\nAfter a reset the status is {upper}_RUN_IN until estimates that begin in {starts} other"
        f" state{'s' * (starts > 1)} have been at most\n{p['within']:.3g} away for a quarter as many"
        " samples as they were farther:\nthen it no longer matters what came before."
    )


def motions(document: Tree) -> str:
    """For which motions the deviation was verified, and how often it held."""
    if not (error := document["error"]) or not (known := learnt_on(error["parameters"])):
        return ""
    text = f"\nIt was learnt {known}.\nWhere the last two turns or the speed are others, it grows."
    if (held := document.get("coverage")) is not None:
        text += f" Of held-out rows {100 * held:.3g} %\nwere within 1.645 of it; 90 % are meant."
    return text


def learnt_on(p: Mapping[str, Any]) -> str:
    """The motions that an error was learnt on, from the parameters of its element, in words."""
    if not p["growth"]:
        return ""
    turns = np.ravel(p["turns"])
    down, up = (ends(*two) for two in (turns[:2], turns[4:6]))
    text = f"at inputs from {ends(p['least'], p['most'])} that turned down at {down} and up at {up}"
    if p["slow"] > 0:
        text += f", in strokes of a mean speed from {ends(p['slow'], p['fast'])}"
    return text


def clock(document: Tree, stem: str) -> str:
    """What dt is, and how long it may be."""
    if not document["rates"]:
        return "dt: time since the last call, which this model does not need: any number.\n"
    longest = document.get("longest") or LONGEST
    return (
        f"dt: time since the last call, in the unit of the model's times, at most {longest:.6g}; a"
        f" longer one is taken for that,\n{stem.upper()}_EXTRAPOLATED; one that is negative or NaN is"
        " none.\n"
    )


def condition(document: Tree, stem: str) -> str:
    """The condition that a step needs beside the reading, and the range in which it is known."""
    if not (known := document.get("condition")):
        return ""
    unit = "" if known["unit"] == "1" or known["unit"] in known["name"] else f" in {known['unit']}"
    return (
        f"condition: {visible(known['name'] + unit)}, from {ends(known['low'], known['high'], digits=6)};"
        f" beyond, the nearer end is taken,\n{stem.upper()}_EXTRAPOLATED.\n"
    )


def origin(document: Tree) -> str:
    """The verdict on the fit, the codes of its reasons, and the date of its data."""
    if not (known := document["origin"]):
        return ""
    codes = f" ({', '.join(known['codes'])})" if known["codes"] else ""
    said = (
        f"verdict on the fit: {known['verdict'] or 'not known'}{codes}."
        f" Date of the data: {known['date'] or 'not known'}."
    )
    digest = f"\nSHA-256 of the data: {known['sha256']}." if known.get("sha256") else ""
    return f"\n\n{visible(said)}{visible(digest, keep=chr(10))}"


def facts(document: Tree, stem: str, literal: Callable[[float], str]) -> str:
    """The same for programs, as macros: they take no memory."""
    found = {"MODEL": c_string(document["title"])}
    for role in ("reading", "estimate"):
        found[role.upper()] = c_string(document[role]["name"])
        found[f"{role.upper()}_UNIT"] = c_string(document[role]["unit"])
    if guard := document["guard"]:
        low, high = (guard["parameters"][end] for end in ("low", "high"))
        found |= {"TRAINED_LOW": literal(low), "TRAINED_HIGH": literal(high)}
    if known := document["origin"]:
        words = {"VERDICT": "verdict", "DATA_DATE": "date", "DATA_SHA256": "sha256"}
        found |= {macro: c_string(known.get(key, "")) for macro, key in words.items()}
        found["CODES"] = c_string(" ".join(known["codes"]))
    return "\n".join(f"#define {stem.upper()}_{name} {text}" for name, text in found.items())


def tables(upper: str) -> str:
    """Where constants lie: in flash on an AVR, whose RAM is a tenth of it and holds all others."""
    return f"""\
#ifdef __AVR__
#include <avr/pgmspace.h>
#define {upper}_TABLE PROGMEM
#define {upper}_AT(table, k) pgm_read_float(&(table)[k])
#define {upper}_COPY(to, from) memcpy_P((to), (from), sizeof *(to))
#else
#define {upper}_TABLE
#define {upper}_AT(table, k) (table)[k]
#define {upper}_COPY(to, from) (void)(*(to) = *(from))
#endif"""


def spent(document: Tree) -> str:
    """The operations of a step as they were counted; nothing where they were not."""
    if not (found := document.get("operations")):
        return ""
    return (
        f"A step took {found['mean']:,.0f} operations in the mean and {found['most']:,} at most, counted on"
        f" {found['readings']:,} readings.\n"
    )


def quantity(one: dict[str, str]) -> str:
    """The name, with the unit where there is one and the name does not have it, on one line."""
    known = one["unit"] in ("", "1", named_unit(one["name"], None, None))
    return visible(one["name"] if known else f"{one['name']} in {one['unit']}")
