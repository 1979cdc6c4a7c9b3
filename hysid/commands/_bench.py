"""`hysid bench`: the benchmarks of the repository, one after the other."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import typer

from hysteresis import InputError

from ._asked_more import BENCHMARKS, Bench
from ._console import BUG, Done, log

ROOT = Path(__file__).resolve().parents[2]


def run(asked: Bench) -> Done:
    """Run those that are there, or those named, in the order of the names."""
    there, names = _there(), asked.names
    if unknown := [name for name in names or () if name not in there]:
        raise typer.BadParameter(f"{unknown[0]!r} is not a benchmark; there are {', '.join(there)}")
    found: dict[str, Any] = {}
    failed: dict[str, int] = {}
    for name in names or there:
        command = [sys.executable, "-m", f"benchmarks.{name}", *["--quick"] * asked.quick]
        log(f"hysid bench: {' '.join(command[1:])}")
        if not asked.as_json:
            done = subprocess.run(command, cwd=ROOT)
        else:
            done = subprocess.run([*command, "--json"], cwd=ROOT, stdout=subprocess.PIPE, text=True)
            if not done.returncode:
                found[name] = json.loads(done.stdout)
        if done.returncode:
            failed[name] = done.returncode
    lines = [f"{name}: ended with exit status {code}" for name, code in failed.items()]
    document = {"benchmarks": found, "failed": failed}
    return Done(document, lines or ["All ran."], BUG if failed else 0)


def _there() -> list[str]:
    """The benchmarks of this checkout. Raises `InputError` where there are none."""
    there = [name for name in BENCHMARKS if (ROOT / "benchmarks" / f"{name}.py").is_file()]
    if not there:
        raise InputError(
            "file-not-found",
            "This installation has no benchmarks.",
            cause="hysid was installed from a wheel, which does not contain them.",
            fix="Run hysid bench from an editable install of the repository.",
        )
    return there
