"""`hysid armor`."""

from pathlib import Path
from typing import Annotated

import typer

from ._console import AsJson, example, print_result, start_jax

armor = typer.Typer(help="Contacts on a robot's armor: look at a solution.", no_args_is_help=True)


@armor.callback()
def _armor() -> None:
    """A group of commands, although it has only one."""


@armor.command(epilog=example("hysid armor view tsuji2014"))
def view(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR", help="Folder with touches.json, as hysid reproduce writes it."
        ),
    ],
    as_json: AsJson = False,
) -> None:
    """Write DIR/armor.html, a replay of the contacts in 3D."""
    start_jax()
    from ..armor import _view  # after JAX is set up

    found = _view.view(folder)
    print_result(found, as_json, [found["file"]])
