"""`hysid qualify`."""

from typing import Annotated, Any

import typer

from ._console import USER, AsJson, File, Folder, print_result, start_jax, warnings
from ._selection import takes_selection


@takes_selection("where", "nan", optional=True)
def qualify(
    folder: Folder,
    file: File,
    selection: dict[str, Any],
    max_error: Annotated[
        float | None, typer.Option(help="Largest error that is allowed, in the unit of the input.")
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(help="Samples per second that the compensator must keep up with."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Judge a fit's compensator on data it has not seen.

    The verdict is PASS, CAUTION or FAIL; FAIL, and exit status 2, where the compensator does not meet
    --max-error or --rate. --where and --nan are by
    default those of the fit.
    """
    start_jax()
    from ..operations import _qualify  # after JAX is set up

    found = _qualify.qualify(folder, file, max_error=max_error, rate=rate, changes=selection)
    lines = [*warnings(found["notes"], "Note"), found.pop("text"), found["file"]]
    print_result(found, as_json, lines)
    if found["verdict"]["level"] == "FAIL":
        raise SystemExit(USER)  # stdout says why; the command itself did not fail
