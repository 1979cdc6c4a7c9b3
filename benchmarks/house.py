"""How large the house is: lines, files, names, texts and subjects, beside what they are to be.

python -m benchmarks.house [--since REV] [--json]

Everything is counted in the working tree; subjects are those of the commits since REV, of the last hundred
unless it is given. Nothing is run.
"""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from itertools import chain
from pathlib import Path
from statistics import median

from ._measure import Row, judged, noted, options, report

ROOT = Path(__file__).parents[1]
PACKAGES = ("hysteresis", "identify", "compensate", "hysid")
PLAIN = 0, 1, 2, 10, 100, 0.5
"""Numbers that choose nothing: they count, halve, or make per cent."""


def files(*folders: str, suffix: str = ".py") -> list[Path]:
    """Those of some folders, or files."""
    found = (ROOT / one for one in folders)
    return sorted(chain.from_iterable(x.rglob(f"*{suffix}") if x.is_dir() else [x] for x in found))


def lines(paths: list[Path]) -> int:
    return sum(path.read_text("utf-8").count("\n") for path in paths)


def private_imports() -> set[str]:
    """Modules of ours with an underscore that a test imports."""
    return {module for path in files("tests") for module in _imports(path) if "._" in module}


def _imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        names = [one.name for one in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and not node.level and node.module:
            names = [node.module]
            names += [f"{node.module}.{x.name}" for x in node.names if (_file(node.module, x.name))]
        yield from (name for name in names if name.split(".")[0] in PACKAGES)


def _file(module: str, name: str) -> bool:
    place = ROOT / module.replace(".", "/") / name
    return name.startswith("_") and (place.with_suffix(".py").exists() or place.is_dir())


def public_names() -> int:
    """As the reference lists them."""
    sys.path.insert(0, str(ROOT / "docs" / "tools"))
    return len(import_module("public").public_names())


def constants(package: str) -> int:
    """Numbers in capitals at the top of a module, one or several."""
    tops = chain.from_iterable(ast.parse(x.read_text("utf-8")).body for x in files(package))
    values = (x.value for x in tops if isinstance(x, ast.Assign | ast.AnnAssign) and x.value)
    found = (
        n.value for n in chain.from_iterable(map(ast.walk, values)) if isinstance(n, ast.Constant)
    )
    return sum(type(x) in (int, float) and x not in PLAIN for x in found)


def subjects(since: str) -> list[int]:
    """Lengths of the subjects of commits."""
    which = [f"{since}..HEAD"] if since else ["-100"]
    said = subprocess.run(
        ["git", "log", "--format=%s", *which],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    return [len(one) for one in said.splitlines()]


def count(pattern: str, *folders: str) -> int:
    return sum(len(re.findall(pattern, x.read_text("utf-8"), re.M)) for x in files(*folders))


def rows(since: str) -> Iterator[Row]:
    sizes = {package: lines(files(package)) for package in PACKAGES}
    yield judged("lines of the four packages", sum(sizes.values()), 52_000)
    yield from (noted(f"  {package}", size) for package, size in sizes.items())
    yield judged("files of the four packages", len(files(*PACKAGES)), 330)
    yield judged("lines of tests", lines(files("tests")), 20_000)
    yield judged("private modules that tests import", len(private_imports()), 50)
    yield judged("public names", public_names(), 160)
    yield judged("def step( in hysteresis and compensate", count(r"def step\(", *PACKAGES[::2]), 14)
    yield judged("classes named Compensator", count(r"^class \w*Compensator\b", *PACKAGES), 8)
    of_dynamics = "hysteresis/dynamics", "identify/dynamics", "identify/fitting/_oscillator.py"
    yield judged("lines of dynamics", lines(files(*of_dynamics)), 2971)
    yield judged("numeric constants in identify", constants("identify"), 120)
    texts = "README.md", "CHANGELOG.md"
    pages = [x for x in files("docs", suffix=".md") if not {"api", "experiments"} & {*x.parts}]
    words = sum(len(x.read_text("utf-8").split()) for x in [*pages, *files(*texts)])
    yield judged("pages, but those of the reference and the lab book", len(pages), 25)
    yield judged("words of these, README and changelog", words, 25_000)
    if found := subjects(since):
        yield judged("median length of a commit's subject", median(found), 50)
        yield judged("longest subject", max(found), 60)


def main(arguments: Sequence[str] | None = None) -> None:
    asked = options(
        "benchmarks.house", __doc__, arguments, since="first commit that does not count"
    )
    report(list(rows(asked.since or "")), asked.json)


if __name__ == "__main__":
    main()
