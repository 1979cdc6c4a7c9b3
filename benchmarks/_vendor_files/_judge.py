"""Judgement of `hysid init` on each variant: right, refused, or silently wrong.

Right: the columns' names and units as written, the rows, the clock, and the pair of drive and answer in
either direction; or no pair, or a refusal, where that is the answer. A wrong unit, column or role is worse
than a refusal.
"""

import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from hysid.intake._init import init
from hysteresis import InputError

from .._measure import Row, judged, noted
from ._binaries import binaries
from ._instruments import instruments
from ._loggers import loggers
from ._machines import machines
from ._variant import Variant

RIGHT = 90.0


def variants() -> dict[str, Variant]:
    """Every variant by its name."""
    return {**machines(), **instruments(), **loggers(), **binaries()}


def outcome(file: Path, expected: Variant) -> tuple[str, str]:
    """`right`, `refused` or `wrong`, and why."""
    try:
        told = init(file, file.with_suffix(".configuration.toml"), {})
    except InputError as error:
        return ("right", "") if expected.refused else ("refused", f"[{error.code}] {error.problem}")
    except Exception as error:  # a fault of the program
        return "wrong", f"{type(error).__name__}: {error}"
    if expected.refused:
        return "wrong", "it cannot be used, and was"
    units = {column["name"]: column["unit"] for column in told["columns"]}
    chosen, faults = told["selection"], []
    for name, unit in expected.units.items():
        if name not in units:
            faults.append(f"no column {name!r} among {list(units)}")
        elif units[name] != unit:
            faults.append(f"unit of {name!r}: {units[name]!r} for {unit!r}")
    if expected.rows not in (None, told["rows"]):
        faults.append(f"{told['rows']} rows for {expected.rows}")
    pair = {chosen.get("input"), chosen.get("output")} if chosen.get("output") else None
    if expected.pair is None and pair is not None:
        faults.append(f"roles {pair} where there are none")
    elif expected.pair is not None and pair is None:
        return "refused", f"no roles: {told.get('no_roles')}"
    elif expected.pair is not None and pair != set(expected.pair):
        faults.append(f"roles {pair} for {set(expected.pair)}")
    if expected.time is not None and chosen.get("time") != expected.time:
        faults.append(f"clock {chosen.get('time')!r} for {expected.time!r}")
    return ("wrong", "; ".join(faults)) if faults else ("right", "")


def judge(files: Mapping[str, Variant]) -> list[Row]:
    """Rows of how many are right, and how many silently wrong; each that is not right is printed."""
    counts = {"right": 0, "refused": 0, "wrong": 0}
    with tempfile.TemporaryDirectory() as folder:
        for k, (name, variant) in enumerate(files.items()):
            file = Path(folder) / f"run{k}{variant.suffix}"
            variant.write(file)
            word, why = outcome(file, variant)
            counts[word] += 1
            if word != "right":
                print(f"{name}: {word}: {why}", file=sys.stderr, flush=True)
    total = len(files)
    return [
        noted("variants of makers' files", total),
        judged("variants: right, per cent", 100 * counts["right"] / total, RIGHT, at_least=True),
        noted("variants: refused", counts["refused"]),
        judged("variants: silently wrong", counts["wrong"], 0),
    ]
