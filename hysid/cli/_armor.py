"""`hysid armor` on the command line."""

from pathlib import Path
from typing import Annotated

import typer

armor = typer.Typer(help="The touched robot: look at what was found.", no_args_is_help=True)


@armor.command()
def view(
    folder: Annotated[
        Path,
        typer.Argument(metavar="DIR", help="Folder with touches.json, as reproduce writes it."),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Write DIR/armor.html: shell, line of action, contact and its covariance, replayed."""
    from ._app import _print, _start

    _start()
    from ..armor import _view as _armor_view

    found = _armor_view.view(folder)
    _print(found, as_json, [found["file"]])


@armor.callback()
def _armor() -> None:
    """Commands of the armour."""
