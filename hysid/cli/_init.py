"""`hysid init`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ._console import AsJson, File, Overwrite, print_result, start_jax
from ._selection import takes_selection, values_of


@takes_selection("input", "output", "time", "dt", "step", "group", "each", optional=True)
def init(
    file: File,
    selection: dict[str, Any],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FILE.toml", help="Configuration to write (default: FILE's .toml)."
        ),
    ] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Guess columns, units and cycles of a file; write its .toml.

    Give the columns that you know as options; hysid guesses the others, and what to hold out.
    """
    start_jax()
    from ..operations import _init  # after JAX is set up

    given = selection | {"input": list(values_of(selection.get("input")))}
    found = _init.init(file, out, given, overwrite=overwrite)
    lines = found.pop("lines")
    print_result(found, as_json, lines)
