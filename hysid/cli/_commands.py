"""The commands that have a file of their own, and the example that ends the help of each."""

import typer

from ._armor import armor
from ._bench import bench
from ._datasets import datasets
from ._examples import with_examples
from ._export import export
from ._init import init
from ._microchannel import microchannel
from ._qualify import qualify
from ._reproduce import reproduce


def register(app: typer.Typer) -> None:
    """Add them to the command line."""
    for command in (init, export, qualify, reproduce, bench):
        app.command()(command)
    app.add_typer(armor, name="armor")
    app.add_typer(microchannel, name="microchannel")
    app.add_typer(datasets, name="datasets")
    with_examples(app)
