"""`hysid reproduce`: a paper's numbers beside what virtual laboratories and our methods make of them."""

import math
import time
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import identify
from hysteresis import InputError
from hysteresis._atomic_file import write_whole
from hysteresis._show import aligned
from identify.internal import versions

from ..intake._folders import check_writable

RESULT = "reproduction.json"


TOLERANCE = (
    "Virtual: mean and standard deviation over synthetic laboratories. Tolerance: what the paper's own n "
    "repeats leave open of a count (95 %), else its printed digits. Within: the mean of the virtual "
    "laboratories is within that tolerance, however much they scatter."
)


class Asked(NamedTuple):
    """What to do: the folder, how many virtual laboratories, the seed of the first.

    - `with_ours`: also by our methods. `epochs`: of a paper's networks; None for as many as it trained.
    - `quick`: fewer laboratories and epochs, and the slow experiments on the first laboratory alone.
    - `say`: tells the user where the work stands.
    """

    out: Path
    rigs: int
    seed: int
    with_ours: bool
    epochs: int | None
    quick: bool
    say: Callable[[str], None]


class Paper(NamedTuple):
    """A paper: `carry_out` makes its experiments and pictures and returns what the document says of them.

    The entries `rows`, `findings` and `files` {name: file}, and, if any, `tables` {title: text}, are shown.
    """

    title: str
    laboratories: int
    quick_laboratories: int
    seconds_a_laboratory: str
    carry_out: Callable[[Asked], dict[str, Any]]
    needs: tuple[tuple[str, str], ...] = ()
    """packages that it imports on the way, and the extra of each"""


PAPERS = {"tsuji2014": "_armor_paper", "kim2018": "_skin_paper"}
"""The module of each, with its `PAPER`."""


def reproduce(
    paper: str, out: Path, *, rigs: int | None = None, seed: int = 0, with_ours: bool = True,
    epochs: int | None = None, quick: bool = False, overwrite: bool = False,
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:  # fmt: skip
    """Make a paper's experiments anew: DIR/reproduction.json, table.md, pictures, and what it adds.

    Raises `InputError` `missing-extra` before any work where a package that it needs is not installed.
    """
    begin = time.perf_counter()
    of = _paper(paper)
    _check_packages(of.needs, paper)
    identify.internal.check_free(out, overwrite, RESULT)
    check_writable(out)
    rigs = rigs or (of.quick_laboratories if quick else of.laboratories)
    say(f"{rigs} virtual laboratories, {of.seconds_a_laboratory}")
    out.mkdir(parents=True, exist_ok=True)
    document = {"schema": 1, "paper": paper, "rigs": rigs, "seed": seed, "quick": quick}
    document |= of.carry_out(Asked(out, rigs, seed, with_ours, epochs, quick, say))
    document["files"] = {"table": "table.md"} | document["files"]
    document["seconds"] = round(time.perf_counter() - begin, 3)
    document["versions"] = versions(("hysid", "jax", "numpy"))
    write_whole(out / "table.md", _markdown(document, of.title))
    identify.internal.write_json(out / RESULT, document)
    return document


def _check_packages(needs: tuple[tuple[str, str], ...], paper: str) -> None:
    missing = {extra: name for name, extra in needs if find_spec(name) is None}
    if missing:
        extras = ",".join(sorted(missing))
        raise InputError(
            "missing-extra", f"{paper} needs {', '.join(missing.values())}, which is not installed.",
            fix=f"pip install 'hysid[{extras}]'",
        )  # fmt: skip


def _paper(name: str) -> Paper:
    return import_module(f"{__package__}.{PAPERS[name]}").PAPER


def terminal(document: dict[str, Any]) -> list[str]:
    """The tables, and below them what the paper says in words."""
    lines = aligned(rows := _cells(document), range(2, len(rows[0]) - 2))
    said = [f"{'Yes' if f['holds'] else 'No'}: {_finding(f)}" for f in document["findings"]]
    tables = [
        line for name, text in document.get("tables", {}).items() for line in (name, text, "")
    ]
    return [document.get("rig", ""), "", *lines, "", TOLERANCE, "", *said, "", *tables]


def _cells(document: dict[str, Any]) -> list[list[str]]:
    with_ours = any(row["ours"] is not None for row in document["rows"])
    header = ["quantity", "printed in", "published", "tolerance"]
    header += [f"virtual, {document['rigs']} rigs"] + ["ours"] * with_ours
    header += ["unit", "within", "label", "how the virtual rig differs"]
    table = [header]
    for row in document["rows"]:
        cells = [row["what"], row["where"], _printed(row), _tolerance(row)]
        fewer = "" if row["count"] == document["rigs"] else f" (of {row['count']})"
        cells.append(_with_error(row["reproduced"], row["sd"]) + fewer)
        if with_ours:
            cells.append("" if row["ours"] is None else _with_error(row["ours"], row["ours_sd"]))
        cells += ["" if row["unit"] == "1" else row["unit"], _yes(row["within"])]
        table.append([*cells, row["label"], row["differs"]])
    return table


def _printed(row: dict[str, Any]) -> str:
    if row["published"] is None:
        return ""
    return f"{'<' if row['at_most'] else ''}{row['published']:g}"


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


def _markdown(document: dict[str, Any], title: str) -> str:
    header, *rows = (f"| {' | '.join(row)} |" for row in _cells(document))
    columns = header.count("|") - 1
    lines = [f"# {title}", "", document.get("rig", ""), ""]
    lines += [header, "|" + " --- |" * columns, *rows, ""]
    lines += [
        TOLERANCE,
        "",
        "## What the paper says in words",
        "",
        "Yes: the sentence is literally true on the virtual rigs.",
        "",
        *(f"- {_yes(f['holds'])}: {_finding(f)}" for f in document["findings"]),
        "",
    ]
    for name, text in document.get("tables", {}).items():
        lines += [f"## {name}", "", "```", text, "```", ""]
    pictures = [name for name in document["files"].values() if name.endswith(".png")]
    lines += [f"![{Path(name).stem}]({name})\n" for name in pictures]
    return "\n".join(lines)


def _finding(finding: dict[str, Any]) -> str:
    return f"{finding['published']} {finding['reproduced']}"


def _yes(holds: bool | None) -> str:
    return "" if holds is None else "yes" if holds else "no"
