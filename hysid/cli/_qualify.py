"""`hysid qualify` on the command line: what it is told, what it prints, how it ends."""

from pathlib import Path
from typing import Annotated

import typer

Where = Annotated[
    list[str] | None, typer.Option(help="COL=VALUE[,VALUE]: rows to use; repeatable.")
]


def qualify(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a fit.")],
    file: Annotated[Path, typer.Argument(metavar="FILE", help="CSV file the fit has not seen.")],
    max_error: Annotated[
        float | None, typer.Option(help="Largest error that is allowed, in the input's unit.")
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Samples a second to keep up with.")] = None,
    where: Where = None,
    nan: Annotated[
        str | None, typer.Option(help="As in fit; by default what the fit used.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Judge a fit's compensator on unseen data: PASS or CAUTION; FAIL, and exit 2, below the needs."""
    from ._app import _NAN, _print, _start

    changes = {"where": tuple(where)} if where else {}
    changes |= {"nan": _NAN(nan)} if nan else {}
    _start()
    from ..operations import _qualify as _qualify_job

    found = _qualify_job.qualify(folder, file, max_error=max_error, rate=rate, changes=changes)
    lines = [*(f"Mind: {note}" for note in found["notes"]), found.pop("text"), found["file"]]
    _print(found, as_json, lines)
    if found["verdict"]["level"] == "FAIL":
        raise SystemExit(2)  # said on stdout, and no error of the command's
