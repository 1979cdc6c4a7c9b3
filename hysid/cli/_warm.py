"""`hysid warm`."""

from pathlib import Path
from typing import Annotated

import typer

from ._console import AsJson, print_result, start_jax


def warm(
    fits: Annotated[
        list[Path] | None, typer.Argument(metavar="[DIR]...", help="Folders of fits.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compile ahead what these fits and their compensators run; without any, each law alone.

    hysid compiles a model when a long record is worth it, and keeps that in the cache folder. On a machine
    that has to answer at once this command does it before.
    """
    start_jax()
    from ..operations import _warm  # after JAX is set up

    found = _warm.warm(fits or [])
    print_result(found, as_json, [f"{found['loops']} loops are compiled."])
