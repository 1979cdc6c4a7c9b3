"""A Preisach grid's inverse in integers, for processors without floating point."""

from typing import Any

import numpy as np

from hysteresis import InputError

from ...runtime._status import Status
from .._header_facts import STATUSES, facts
from ._artefact import Artefact

ONE = 1 << 16
"""A cell of the grid, in parts of which inputs are counted: Q16.16."""
LARGEST = 1 << 28
"""Of the numbers of the tables; sums of a few of them stay below 2^31."""
TOLERANCE = 2e-4
"""Of the range: what an estimate of the golden pair may be off."""
ROUNDING = 8
"""How far a sum of table entries can be off, in units of the last place: one for each product."""


def add_fixed_point(made: Artefact, path: str) -> None:
    """Add the header. Raises `InputError` `not-exportable` for other models than a grid of even cells."""
    tree, guard = made.document["tree"], made.document["guard"]
    p = tree.get("parameters", {})
    if tree["kind"] != "preisach" or not p["scale"] or p["cells"] > 120:
        raise InputError(
            "not-exportable",
            "Fixed point is for a Preisach grid of at most 120 even cells, of an output that rises.",
            fix='Use float, or fit a GridDensity (model="Preisach").',
        )
    if guard and guard["beyond"] != "limit":
        raise InputError(
            "not-exportable",
            f"Fixed point cannot be exported with beyond={guard['beyond']!r}.",
            cause="its estimates end with the grid, and integers have no NaN.",
            fix='Use float, or beyond="limit".',
        )
    made.words |= _tables(made, p, tree["state"])
    made.add_template("fixed.h", path)


def _tables(made: Artefact, p: dict[str, Any], state: dict[str, Any]) -> dict[str, Any]:
    cells, low = p["cells"], p["edges"][0]
    width = 1 / p["scale"]
    everett = 2 * p["orientation"] * np.array(p["everett"])
    reversible = np.array(p["reversible"])
    sizes = [np.abs(everett).max(), np.abs(reversible).max(), abs(p["floor"]), abs(p["ceiling"])]
    # A power of two, so that every number is scaled without rounding.
    factor = 2.0 ** np.floor(np.log2(LARGEST / max(sizes)))
    limits = (np.array(made.document["limits"]) - p["offset"]) * factor

    def integer(value: Any) -> Any:
        whole = np.clip(np.round(np.asarray(value, float)), -(2**31) + 1, 2**31 - 1)
        return whole.astype(int).tolist()

    def output(value: Any) -> Any:
        return integer(np.asarray(value, float) * factor)

    def at(value: Any) -> Any:
        found = integer((np.asarray(value, float) - low) / width * ONE)
        return np.clip(found, 0, cells * ONE - 1).tolist()

    def edge(value: float) -> int:
        return int(integer((value - low) / width * ONE))

    golden, depth = made.document["golden"], state["depth"]
    guarded = made.document["guard"] and made.document["guard"]["parameters"]
    found = [v for v in golden["value"] if v is not None]
    span = max(found) - min(found)
    told = max(guarded["slack"], TOLERANCE * (guarded["high"] - guarded["low"])) if guarded else 0.0
    seen = [k for k, v in enumerate(golden["value"]) if v is not None]
    readings = (np.array(golden["reading"])[seen] - p["offset"]) * factor
    steps = np.diff(reversible)
    tables = [everett, 2 * p["orientation"] * np.array(p["diagonal"]), reversible]
    origin = made.words["origin"]
    return {
        "macros": facts(made.document, made.stem, repr),
        "facts_line": (
            f"Verdict on the fit: {origin['verdict'] or 'not known'}. Date of the data:"
            f" {origin['date'] or 'not known'}. SHA-256 of the data: {origin['sha256'] or 'not known'}."
        ),
        "statuses": [(s.name, s.value, STATUSES[s]) for s in Status],
        "reading_zero": repr(float(p["offset"])), "reading_step": repr(float(1 / factor)),
        "estimate_zero": repr(float(low)), "estimate_step": repr(float(width / ONE)),
        "cells": cells, "depth": p["capacity"], "table_bytes": 4 * sum(map(len, tables)),
        "count": "uint8_t" if p["capacity"] < 256 else "uint16_t",
        "everett": _rows(output(everett)), "diagonal": _rows(output(tables[1])),
        "reversible": _rows(output(reversible)),
        "first": list(zip(at(state["extremum"][:depth]), output(state["level"][:depth]), strict=True)),
        "rising": state["rising"], "u": at(state["u"]), "z": output(state["z"]),
        "floor": output(p["floor"]), "ceiling": output(p["ceiling"]),
        "low_limit": integer(limits[0]), "high_limit": integer(limits[1]),
        "margin": ROUNDING, "flat": max(output(p["flat"]), ROUNDING),
        "goes_on": bool(min(steps[0], steps[-1]) > p["flat"]),
        "known": output(_known(p, guarded)),
        "guard": guarded and {
            "low": edge(guarded["low"]), "high": edge(guarded["high"]), "rounding": edge(low + told),
            "bottom": edge(guarded["low"] + guarded["within"]),
            "top": edge(guarded["high"] - guarded["within"]),
            "ends": _ends(p, state) if made.document["starts"] else 0,
        },
        "golden": len(seen), "golden_readings": _rows(integer(readings)),
        "golden_values": _rows([edge(golden["value"][k]) for k in seen]),
        "tolerance": edge(low + TOLERANCE * span) + 1,
    }  # fmt: skip


def _known(p: dict[str, Any], guard: dict[str, Any] | None) -> list[float]:
    """The least and the greatest reading, less the offset, that are known, also beyond the model's outputs.

    Where the reversible part goes on, estimates may be as far beyond the trained inputs as the guard does
    not tell; where it does not, the training rows had such readings.
    """
    if guard is None:
        return [p["floor"], p["ceiling"]]
    edges, rises = p["edges"], np.diff(p["reversible"])

    def beyond(end: float, rise: float, past: float, seen: float) -> float:
        if rise > p["flat"]:
            return max(past, 0.0) * rise * p["scale"]
        return max(seen - end, 0.0) if guard["least"] <= guard["most"] else 0.0

    least, most = (guard[seen] - p["offset"] for seen in ("least", "most"))
    low, high = guard["low"] - guard["slack"], guard["high"] + guard["slack"]
    return [
        p["floor"] - beyond(-p["floor"], rises[0], edges[0] - low, -least),
        p["ceiling"] + beyond(p["ceiling"], rises[-1], high - edges[-1], most),
    ]


def _ends(p: dict[str, Any], state: dict[str, Any]) -> int:
    """Which ends estimates have to reach before the first state no longer matters: 1 low, 2 high, 3 both.

    Relays that are not as the virgin state has them shift estimates one way. At the end that estimates then
    reach later than the input does, all relays are one way.
    """
    z, virgin = state["z"], {p["floor"]: 1, p["ceiling"]: 2}
    found = virgin.get(z, 3)
    return found if p["orientation"] > 0 or found == 3 else 3 - found


def _rows(values: list[int]) -> str:
    rows = [", ".join(map(str, values[k : k + 8])) for k in range(0, len(values), 8)]
    return ",\n    ".join(rows)
