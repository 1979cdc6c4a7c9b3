"""How often `hysid init` is sure and wrong, over every file with a known answer.

They are the variants of makers' files and, where they lie beside the checkout, the small cases, the makers'
own files and the measured sets. What drives is known of the cases and of the makers' files; of the others
the pair is.
"""

import json
import re
import shlex
import sys
import tempfile
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from hysid.intake._init import init
from hysteresis import InputError

from .._measure import Row, judged, noted
from ._judge import variants

SHARED = Path(__file__).resolve().parents[3] / "shared"
EITHER_WAY = ("variant", "measured")
"""Kinds of files of which the pair is known, and not which of the two drives."""

Name = str | None


class Answer(NamedTuple):
    """A file and its right `pairs` of drive and response, none where no column drives another.

    - `pairs`, `time`: None where they are not known.
    """

    kind: str
    file: Path
    pairs: list[tuple[Name, Name]] | None
    time: Name = None


def sure_and_wrong(quick: bool) -> list[Row]:
    """Rows of how many roles were told sure, and how many of them are wrong; each wrong one is printed."""
    sure = wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        for k, answer in enumerate(_answers(Path(folder))):
            if quick and k % 8:
                continue
            try:
                told = init(answer.file, Path(folder) / f"{k}.toml", {})
            except InputError:
                continue  # a refusal is not sure
            for what, faults in _faults(told, answer):
                sure += 1
                wrong += bool(faults)
                if faults:
                    print(
                        f"{answer.file.name}: sure of {what}: {faults}", file=sys.stderr, flush=True
                    )
    return [noted("roles and clocks told as sure", sure), judged("of these wrong", wrong, 0)]


def _faults(told: dict[str, Any], answer: Answer) -> Iterator[tuple[str, str]]:
    """What is told as sure, and what is wrong with it ("": nothing)."""
    certain = {found["what"] for found in told["found"] if found["sure"] == "sure"}
    chosen = told["selection"]

    def plain(name: Name) -> str:
        """A header without the unit that a file may write into it."""
        return re.sub(r"\s*(\[.*\]|\(.*\))$", "", str(name))

    if {"input", "output"} <= certain and answer.pairs is not None:
        pair = [plain(chosen.get("input")), plain(chosen.get("output"))]
        right = [[plain(a), plain(b)] for a, b in answer.pairs]
        if answer.kind in EITHER_WAY:
            right += [one[::-1] for one in right]
        yield "the pair", "" if pair in right else f"{pair} for {right}"
    if "time" in certain and answer.time is not None and chosen.get("time"):
        clocks = plain(chosen["time"]), plain(answer.time)
        yield "the clock", "" if clocks[0] == clocks[1] else " for ".join(clocks)


def _answers(folder: Path) -> Iterator[Answer]:
    for k, variant in enumerate(variants().values()):
        file = folder / f"run{k}{variant.suffix}"
        variant.write(file)
        yield Answer("variant", file, [variant.pair] if variant.pair else [], variant.time)
    for case in _documents("cases", "cases"):
        for check in case["checks"]:
            if check["do"] == "init":
                yield Answer("case", SHARED / "cases" / case["file"], _roles(check["right"]))
    for known in _documents("vendor", "files"):
        number = known.get("main table")
        main = known["tables"][number] if number is not None and known["tables"] else {}
        drive, response, time = (
            known.get(role, main.get(role)) for role in ("drive", "response", "time")
        )
        if not isinstance(drive, int):  # a number: the file has no names that could be compared
            pairs = [(drive, response)] if drive else []
            yield Answer("maker", SHARED / "vendor" / known["file"], pairs, time)
    for card in sorted((SHARED / "data").glob("*/CARD.md")):
        asked: dict[Path, list[tuple[Name, Name]]] = {}
        for line in re.findall(r"^ +hysid fit (.*)$", card.read_text("utf-8"), re.MULTILINE):
            first, *words = shlex.split(line)
            given = {
                option: [b for a, b in pairwise(words) if a == option]
                for option in ("--input", "--output")
            }
            pairs = [(a, b) for a in given["--input"] for b in given["--output"]]
            asked.setdefault(card.parent / first, []).extend(pairs)
        for file, pairs in asked.items():
            if pairs and file.is_file():
                yield Answer("measured", file, pairs)


def _documents(folder: str, key: str) -> list[dict[str, Any]]:
    file = SHARED / folder / "key.json"
    return json.loads(file.read_text("utf-8"))[key] if file.is_file() else []


def _roles(right: Any) -> list[tuple[Name, Name]] | None:
    """The pairs of an answer, or of several of which one must be given; None where it tells none."""
    every = right if isinstance(right, list) else [right]
    if not any("output" in one or "no roles" in one for one in every):
        return None
    found: list[tuple[Name, Name]] = []
    for one in every:
        sides = (one.get("input"), one.get("output"))
        inputs, outputs = (side if isinstance(side, list) else [side] for side in sides)
        found += [(a, b) for a in inputs for b in outputs if b is not None]
    return found
