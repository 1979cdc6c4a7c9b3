"""The commands that have a file of their own, and the example that ends the help of each."""

import typer

from ._armor_command import armor
from ._bench_command import bench
from ._catalogue_command import datasets
from ._examples import with_examples
from ._export_command import export
from ._init_command import init
from ._microchannel_command import microchannel
from ._qualify_command import qualify
from ._reproduce_command import reproduce


def register(app: typer.Typer) -> None:
    """Add them to the command line."""
    for command in (init, export, qualify, reproduce, bench):
        app.command()(command)
    app.add_typer(armor, name="armor")
    app.add_typer(microchannel, name="microchannel")
    app.add_typer(datasets, name="datasets")
    with_examples(app)
