"""`hysid bench`: the benchmarks of the repository, one after the other."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from ..commands._console import BUG, AsJson, log, print_result

ROOT = Path(__file__).resolve().parents[2]
NAMES = (
    "preisach", "viscoelastic", "accuracy", "identification", "recovery", "compensation", "armor",
    "microchannel", "reading", "studio", "ruggedness",
)  # fmt: skip
"""Modules of `benchmarks` that judge the package; those that are there are run in this order."""


def bench(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help=f"{', '.join(NAMES)}.")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Run reduced sizes, a few minutes each.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Run the benchmarks, all or by name."""
    there = _there()
    if unknown := [name for name in names or () if name not in there]:
        raise typer.BadParameter(f"{unknown[0]!r} is not a benchmark; there are {', '.join(there)}")
    found: dict[str, Any] = {}
    failed: dict[str, int] = {}
    for name in names or there:
        command = [sys.executable, "-m", f"benchmarks.{name}", *["--quick"] * quick]
        log(f"hysid bench: {' '.join(command[1:])}")
        if not as_json:
            done = subprocess.run(command, cwd=ROOT)
        else:
            done = subprocess.run([*command, "--json"], cwd=ROOT, stdout=subprocess.PIPE, text=True)
            if not done.returncode:
                found[name] = json.loads(done.stdout)
        if done.returncode:
            failed[name] = done.returncode
    lines = [f"{name}: ended with exit status {code}" for name, code in failed.items()]
    print_result({"benchmarks": found, "failed": failed}, as_json, lines or ["All ran."])
    if failed:
        raise SystemExit(BUG)


def _there() -> list[str]:
    """The benchmarks of this checkout. Raises `InputError` where there are none."""
    there = [name for name in NAMES if (ROOT / "benchmarks" / f"{name}.py").is_file()]
    if not there:
        from hysteresis import InputError  # late: it loads JAX

        raise InputError(
            "file-not-found",
            "This installation has no benchmarks.",
            cause="hysid was installed from a wheel, which does not contain them.",
            fix="Run hysid bench from an editable install of the repository.",
        )
    return there
