"""`hysid init` on the command line: what it is told, what it prints."""

from pathlib import Path
from typing import Annotated

import typer


def init(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="File of the test rig.")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.toml", help="By default FILE's .toml.")
    ] = None,
    input: Annotated[
        list[str] | None, typer.Option("--input", help="Input column, if you know it; repeatable.")
    ] = None,
    output: Annotated[str | None, typer.Option(help="Output column, if you know it.")] = None,
    time: Annotated[str | None, typer.Option(help="Time column, if you know it.")] = None,
    dt: Annotated[float | None, typer.Option(help="Sampling step in seconds.")] = None,
    step: Annotated[
        float | None, typer.Option(help="Constant input of creep or relaxation.")
    ] = None,
    group: Annotated[str, typer.Option(help="COL[,COL]: independent sequences.")] = "",
    each: Annotated[str | None, typer.Option(help="COL: one fit for each of its values.")] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Write over a file that is there.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Look at a file: guess columns, units, cycles and what to hold out; write FILE's .toml."""
    from ._app import _print, _start

    _start()
    from ..operations._init import init as guessed

    given = {
        "input": list(input or ()), "output": output, "time": time, "dt": dt, "step": step,
        "group": tuple(part for part in group.split(",") if part), "each": each,
    }  # fmt: skip
    found = guessed(file, out, given, overwrite=overwrite)
    lines = found.pop("lines")
    _print(found, as_json, lines)
