"""`hysid reproduce`: the numbers of a paper beside what virtual rigs and our methods make of them."""

import math
import platform
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

import identify
from hysteresis import InputError

from . import _reproduce_figures as figures
from ._jobs import Say, _check_writable
from ._reproduce_armor import DISPLACEMENTS, METHODS, OURS, Rig, body_errors, surface_errors
from ._reproduce_rows import compared, findings
from ._reproduce_touches import write_touches

RESULT = "reproduction.json"


def reproduce(
    out: Path, *, rigs: int = 60, seed: int = 0, with_ours: bool = True, overwrite: bool = False,
    say: Say = lambda _: None,
) -> dict[str, Any]:  # fmt: skip
    """Tsuji et al. (2014) on virtual rigs: write DIR/reproduction.json, table.md, pictures, touches.

    `with_ours`: also by our method, which calibrates every rig.
    """
    begin = time.perf_counter()
    _check_free(out, overwrite)
    laboratories = [Rig(seed + n) for n in range(rigs)]
    say(f"{rigs} virtual rigs: sponge, 76 points of surface 1, 45 points of the body")
    if with_ours:
        say("each is also calibrated by twenty presses: seconds a rig (--no-ours leaves that out)")

    def progress(done: int) -> None:
        if done % 10 == 0 or done == rigs:
            say(f"rig {done} of {rigs}")

    document: dict[str, Any] = {
        "schema": 1,
        "paper": "tsuji2014",
        "rigs": rigs,
        "seed": seed,
        "rows": compared(laboratories, progress, with_ours),
        "findings": findings(laboratories),
        "methods": {name: _method(laboratories, name) for name in _some(METHODS, with_ours)},
        "points": _points(laboratories, with_ours),
    }
    say("drawing")
    out.mkdir(parents=True, exist_ok=True)
    drawn = _draw(laboratories, out, with_ours)
    document["touches"] = write_touches(laboratories[0], out, with_ours)
    document["files"] = {"table": "table.md", "touches": "touches.json", **drawn}
    document["seconds"] = round(time.perf_counter() - begin, 3)
    names = ("hysid", "jax", "numpy")
    document["versions"] = {"python": platform.python_version()} | {n: version(n) for n in names}
    (out / "table.md").write_text(_markdown(document), "utf-8")
    identify.write_json(out / RESULT, document)
    return document


def terminal(document: dict[str, Any]) -> list[str]:
    """The table, and below it what does not fit."""
    header, *rows = _cells(document)
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    lines = [
        "  ".join(
            cell.ljust(width) if k < 2 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in (header, *rows)
    ]
    notes = [f"{r['what']}: {r['deviation']}" for r in document["rows"] if r["deviation"]]
    said = [f"{'Yes' if f['holds'] else 'No'}: {_finding(f)}" for f in document["findings"]]
    return [*lines, "", *notes, "", *said]


def _check_free(out: Path, overwrite: bool) -> None:
    if (out / RESULT).exists() and not overwrite:
        raise InputError(
            "would-overwrite",
            "results are there already, and were left as they are.",
            place=str(out),
            fix="name another folder (--out DIR), or write over them (--overwrite).",
        )
    _check_writable(out)


def _method(rigs: list[Rig], name: str) -> dict[str, Any]:
    """The mean error of each rig, in mm, and what they have in common."""
    means = np.array([body_errors(rig, name).mean() for rig in rigs])
    method = METHODS[name]
    return {
        "label": method.label,
        "published": method.published,
        "mean": means.mean(),
        "sd": means.std(ddof=1),
        "each": means,
    }


def _points(rigs: list[Rig], with_ours: bool) -> dict[str, Any]:
    """Errors in z at the 76 points, mm: mean and standard deviation over the rigs."""
    names = _some(DISPLACEMENTS, with_ours)
    errors = {name: np.array([surface_errors(rig, name) for rig in rigs]) for name in names}
    return {name: {"mean": e.mean(0), "sd": e.std(0, ddof=1)} for name, e in errors.items()}


def _some(table: dict[str, Any], with_ours: bool) -> list[str]:
    return [name for name in table if with_ours or name != OURS]


def _draw(rigs: list[Rig], out: Path, with_ours: bool) -> dict[str, str]:
    one = rigs[0]
    blocks = {h: one.of_thickness(h) for h in (50.0, 30.0, 10.0)}
    drawn = {
        "fig6": figures.loops(one.fresh, one.lines, "Fig 6. Five tests, three approximations"),
        "fig7": figures.force_range(one.to_40),
        "fig9": figures.aging(one.fresh, one.aged),
        "fig10": figures.thickness(blocks),
        "fig12": figures.surface_1(rigs, _some(DISPLACEMENTS, with_ours)),
        "fig14": figures.body(rigs, _some(METHODS, with_ours)),
    }
    for name, figure in drawn.items():
        figure.savefig(out / f"{name}.png", dpi=160)
    return {name: f"{name}.png" for name in drawn}


def _cells(document: dict[str, Any]) -> list[list[str]]:
    with_ours = any(row["ours"] is not None for row in document["rows"])
    header = ["quantity", "figure", "published", f"reproduced, {document['rigs']} rigs"]
    header += ["ours"] * with_ours + ["unit", "within 2 sd"]
    table = [header]
    for row in document["rows"]:
        cells = [row["what"], row["where"], f"{'<' if row['at_most'] else ''}{row['published']:g}"]
        cells.append(_with_error(row["reproduced"], row["sd"]))
        if with_ours:
            cells.append("" if row["ours"] is None else _with_error(row["ours"], row["ours_sd"]))
        cells += ["" if row["unit"] == "1" else row["unit"], _yes(row["within_two_sd"])]
        table.append(cells)
    return table


def _with_error(mean: float, sd: float) -> str:
    """As many decimals as leave two digits of the spread."""
    decimals = min(max(1 - math.floor(math.log10(sd)), 0), 4) if sd > 0 else 0
    return f"{mean:.{decimals}f} ± {sd:.{decimals}f}"


def _markdown(document: dict[str, Any]) -> str:
    header, *rows = (f"| {' | '.join(row)} |" for row in _cells(document))
    columns = header.count("|") - 1
    lines = ["# Tsuji et al. (2014) on virtual rigs", ""]
    lines += [header, "|" + " --- |" * columns, *rows, ""]
    lines += [
        "Published, and the mean and standard deviation over the rigs. Within 2 sd: the two differ by "
        "no more than two of these standard deviations and what the printed digits leave open.",
        "",
        "## Where they deviate",
        "",
        *(f"- {r['what']}: {r['deviation']}" for r in document["rows"] if r["deviation"]),
        "",
        "## What the paper says in words",
        "",
        *(f"- {_yes(f['holds'])}: {_finding(f)}" for f in document["findings"]),
        "",
    ]
    pictures = [name for name in document["files"].values() if name.endswith(".png")]
    lines += [f"![{Path(name).stem}]({name})\n" for name in pictures]
    return "\n".join(lines)


def _finding(finding: dict[str, Any]) -> str:
    return f"{finding['published']} {finding['reproduced']}"


def _yes(holds: bool) -> str:
    return "yes" if holds else "no"
