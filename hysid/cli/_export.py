"""`hysid export` on the command line: what it is told, what it prints."""

from pathlib import Path
from typing import Annotated

import typer


def export(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a fit.")],
    c: Annotated[Path | None, typer.Option("--c", metavar="FILE.h", help="A C99 header.")] = None,
    runtime: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="A file for compensate.runtime.")
    ] = None,
    single: Annotated[bool, typer.Option("--float", help="Numbers in C are float.")] = False,
    depth: Annotated[
        int, typer.Option(min=3, help="Reversals that a Preisach model remembers.")
    ] = 64,
    limits: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Readings beyond are taken for the limit; LOW HIGH."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Write a fit's compensator as a C99 header, or for plain Python: neither needs JAX."""
    from ._app import _print, _say, _start

    if c is None and runtime is None:
        raise typer.BadParameter("nothing to write; give --c FILE.h, --runtime FILE.json or both")
    _start()
    from ..operations._export import export as exported

    found = exported(folder, c, runtime, single=single, limits=limits, depth=depth)
    for note in found["notes"]:
        _say(f"Mind: {note}")
    _print(found, as_json, [*found["files"].values()])
