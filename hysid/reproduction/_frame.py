"""`hysid reproduce`: a paper's numbers beside what virtual laboratories and our methods make of them.

What a paper prints is in PAPER.toml: its numbers, its sentences, and how the virtual rigs differ. The
module of a paper measures each number in one laboratory, and tells which sentences are true there.
"""

import math
import time
import tomllib
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy

import identify
from hysteresis._files import write_whole
from hysteresis._show import aligned
from identify.internal import versions

from ..intake._folders import check_writable

RESULT = "reproduction.json"
MODULES = {"tsuji2014": "_armor", "kim2018": "_skin_paper"}
"""Of each paper: `carry_out`."""

TOLERANCE = (
    "Virtual: mean and standard deviation over synthetic laboratories. Tolerance: what the paper's own n "
    "repeats leave open of a count (95 %), else its printed digits. Within: the mean of the virtual "
    "laboratories is within that tolerance, however much they scatter."
)
COVERAGE = 0.95
"""Of the interval of a count."""

Say = Callable[[str], None]
Measure = Callable[[Any, bool], float | None]
"""Of one laboratory, by the paper's method or by ours; None where it has not made that experiment."""


class Published(NamedTuple):
    """One number of a paper, or None for a quantity of which the paper prints no number.

    - `where`: it is printed. `unit`: "1" for none.
    - `label`: what the row is worth: the virtual rig was "tuned to this number"; the number itself is
      "inferred" from the paper; "predicted", as nothing was chosen for it; "not printed"; or "not
      comparable", as a time on another computer. `differs`: how the virtual rig differs for this number.
    - `measure`: the same number, of one virtual laboratory. `both`: our method has one, too.
    - `half_digit`: what its printing leaves open: half of its last digit, or of the step it was read in.
    - `repeats`: the number counts successes in so many of the paper's own trials; `percent`: of them.
    - `at_most`: the paper says no more than that it is not exceeded.
    - `judged`: whether the virtual rig can be within or outside; a time on another computer is neither.
    """

    key: str
    what: str
    where: str
    unit: str
    label: str
    differs: str
    measure: Measure
    value: float | None = None
    half_digit: float = 0.0
    repeats: int = 0
    percent: bool = False
    at_most: bool = False
    judged: bool = True
    both: bool = False

    def tolerance(self) -> list[float] | None:
        """What the paper's own repeats, or else its printed digits, leave open.

        Of a count it is Clopper and Pearson's interval of the chance, times the trials. The spread of
        the virtual rigs is not in it, so a worse rig does not pass more easily.
        """
        if self.value is None or not self.judged:
            return None
        if self.at_most:
            return [-math.inf, self.value + self.half_digit]
        if not self.repeats:
            return [self.value - self.half_digit, self.value + self.half_digit]
        scale = (100 if self.percent else self.repeats) / self.repeats
        seen = round(self.value / scale)
        interval = scipy.stats.binomtest(seen, self.repeats).proportion_ci(COVERAGE)
        return [float(end) * self.repeats * scale for end in interval]

    def row(self, found: list[float], ours: list[float] | None = None) -> dict[str, Any]:
        """The number beside those of the laboratories, by the paper's method and by ours.

        `within`: the laboratories' mean is within the tolerance.
        """
        named = (
            "key", "what", "where", "unit", "at_most", "half_digit", "repeats", "label", "differs",
        )  # fmt: skip
        (mean, sd), tolerance = _spread(found), self.tolerance()
        within = None if tolerance is None else bool(tolerance[0] <= mean <= tolerance[1])
        row = {name: getattr(self, name) for name in named} | {"published": self.value}
        row |= {"reproduced": mean, "sd": sd, "count": len(found)}
        row["ours"], row["ours_sd"] = _spread(ours) if ours else (None, None)
        return row | {"tolerance": tolerance, "within": within}


class Paper:
    """What PAPER.toml says of a paper."""

    def __init__(self, name: str, measures: Mapping[str, Measure]):
        self.said = tomllib.loads(Path(__file__).with_name(f"{name}.toml").read_text("utf-8"))
        rows = self.said["rows"]
        self.published = tuple(Published(measure=measures[row["key"]], **row) for row in rows)

    def findings(
        self, true: Mapping[str, Any], with_ours: bool = False, **numbers: Any
    ) -> list[dict[str, Any]]:
        """What the paper says in words, and whether the sentence is literally `true` here."""
        found = []
        for key, said in self.said["findings"].items():
            text = said["reproduced"] + (said.get("ours", "") if with_ours else "")
            one = {"published": said["published"], "reproduced": text.format_map(numbers)}
            found.append(one | {"holds": bool(true[key])})
        return found


def compared(
    published: Sequence[Published],
    laboratories: Sequence[Any],
    with_ours: bool,
    progress: Callable[[int], None] = lambda done: None,
) -> list[dict[str, Any]]:
    """One row for each number, which `with_ours` has the same by our method beside it."""
    found: dict[tuple[str, bool], list[float]] = {}
    for n, laboratory in enumerate(laboratories):
        for ours in (False, True) if with_ours else (False,):
            for p in published:
                if (p.both or not ours) and (value := p.measure(laboratory, ours)) is not None:
                    found.setdefault((p.key, ours), []).append(value)
        progress(n + 1)
    return [p.row(found[p.key, False], found.get((p.key, True))) for p in published]


def _spread(values: list[float]) -> tuple[float, float]:
    return float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else 0.0


def reproduce(
    paper: str, out: Path, *, rigs: int | None = None, overwrite: bool = False, quick: bool = False,
    say: Say = lambda _: None, **asked: Any,
) -> dict[str, Any]:  # fmt: skip
    """Make a paper's experiments anew: DIR/reproduction.json, table.txt, and what it adds.

    `asked`: `seed` of the first laboratory; `ours`: also by our methods; `epochs` of a paper's networks,
    None for as many as it trained. `quick`: fewer laboratories and epochs.
    """
    begin = time.perf_counter()
    module = import_module(f"{__package__}.{MODULES[paper]}")
    identify.internal.check_free(out, overwrite, RESULT)
    check_writable(out)
    said = module.PAPER.said
    rigs = int(rigs or said["quick_laboratories" if quick else "laboratories"])
    say(f"{rigs} virtual laboratories, {said['seconds_a_laboratory']}")
    out.mkdir(parents=True, exist_ok=True)
    document = {"schema": 1, "paper": paper, "rigs": rigs, "seed": asked["seed"], "quick": quick}
    document |= module.carry_out(rigs, quick=quick, say=say, **asked)
    document["files"] = {"table": "table.txt"}
    document["seconds"] = round(time.perf_counter() - begin, 3)
    document["versions"] = versions(("hysid", "jax", "numpy"))
    write_whole(out / "table.txt", "\n".join([said["title"], "", *terminal(document), ""]))
    identify.internal.write_json(out / RESULT, document)
    return document


def terminal(document: dict[str, Any]) -> list[str]:
    """The tables, and below them what the paper says in words."""
    lines = aligned(rows := _cells(document), range(2, len(rows[0]) - 2))
    tables = [line for pair in document.get("tables", {}).items() for line in (*pair, "")]
    said = [
        f"{_yes(one['holds']).title()}: {one['published']} {one['reproduced']}"
        for one in document["findings"]
    ]
    return [document["rig"], "", *lines, "", TOLERANCE, "", *said, "", *tables]


def _cells(document: dict[str, Any]) -> list[list[str]]:
    with_ours = any(row["ours"] is not None for row in document["rows"])
    header = ["quantity", "printed in", "published", "tolerance"]
    header += [f"virtual, {document['rigs']} rigs"] + ["ours"] * with_ours
    table = [[*header, "unit", "within", "label", "how the virtual rig differs"]]
    for row in document["rows"]:
        sign, published = "<" * row["at_most"], row["published"]
        cells = [row["what"], row["where"], "" if published is None else f"{sign}{published:g}"]
        fewer = "" if row["count"] == document["rigs"] else f" (of {row['count']})"
        cells += [_tolerance(row), _with_error(row["reproduced"], row["sd"]) + fewer]
        if with_ours:
            cells.append("" if row["ours"] is None else _with_error(row["ours"], row["ours_sd"]))
        cells += ["" if row["unit"] == "1" else row["unit"], _yes(row["within"])]
        table.append([*cells, row["label"], row["differs"]])
    return table


def _tolerance(row: dict[str, Any]) -> str:
    if row["tolerance"] is None or row["at_most"]:
        return ""
    low, high = row["tolerance"]
    if row["repeats"]:
        return f"{low:.4g} to {high:.4g} (n = {row['repeats']})"
    # As many decimals as half of the last printed digit has.
    decimals = max(0, math.ceil(-math.log10(row["half_digit"]))) if row["half_digit"] else 0
    return f"{low:.{decimals}f} to {high:.{decimals}f}"


def _with_error(mean: float, sd: float) -> str:
    """As many decimals as leave two digits of the spread."""
    if not sd > 0:
        return f"{mean:.4g}"
    decimals = min(max(1 - math.floor(math.log10(sd)), 0), 4)
    return f"{mean:.{decimals}f} ± {sd:.{decimals}f}"


def _yes(holds: bool | None) -> str:
    return "" if holds is None else "yes" if holds else "no"
