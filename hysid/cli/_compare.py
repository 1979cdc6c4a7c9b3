"""`hysid compare`."""

from typing import Annotated

import typer

from ._console import AsJson, Folders, print_result, start_jax


def compare(
    folders: Folders,
    change: Annotated[
        bool,
        typer.Option(
            "--change", help="Test whether one model's parameters differ between data sets."
        ),
    ] = False,
    margin: Annotated[
        float,
        typer.Option(help="With --change: the relative difference that counts as a change."),
    ] = 0.05,
    as_json: AsJson = False,
) -> None:
    """Rank models of the same data, or test for a change.

    With --change the folders are two fits of one model to different data: before, after.
    """
    start_jax()
    from ..operations import _compare  # after JAX is set up

    if change:
        document = _compare.change(folders, margin)
        lines = _compare.change_lines(document)
    else:
        document = _compare.compare(folders)
        lines = _compare.comparison_lines(document)
    print_result(document, as_json, lines)
