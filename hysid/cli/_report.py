"""`hysid report`."""

from pathlib import Path
from typing import Annotated

import typer

from ._console import AsJson, Folders, Progress, log, print_result, start_jax


def report(
    folders: Folders,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the page that compares several fits.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write an HTML report of one fit or of several.

    DIR/report.html is self-contained. For several fits hysid also writes a page that compares them. For a
    folder the fitted FILE may be given, where the folder has its name without the suffix.
    """
    folders = [
        one.with_suffix("")
        if one.is_file() and one.suffix and one.with_suffix("").is_dir()
        else one
        for one in folders
    ]
    start_jax()
    from ..reporting import _specimens_page  # after JAX is set up

    with Progress("report", later=True) as progress:
        found = _specimens_page.report(folders, out, log, progress)
    print_result(found, as_json, [found["file"]])
