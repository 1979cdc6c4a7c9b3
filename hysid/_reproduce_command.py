"""`hysid reproduce` on the command line: what it is told, what it prints."""

from pathlib import Path
from typing import Annotated

import typer


def reproduce(
    paper: Annotated[str, typer.Argument(metavar="PAPER", help="tsuji2014.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; by default hysid-PAPER.")
    ] = None,
    rigs: Annotated[int, typer.Option(min=2, help="Virtual rigs to take the spread from.")] = 60,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first rig.")] = 0,
    ours: Annotated[
        bool, typer.Option(help="Also by our method, which takes seconds a rig.")
    ] = True,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Write over results that are there.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """A paper's tables and figures beside what virtual rigs make of them."""
    from ._cli import _one_of, _print, _say, _start

    _one_of("tsuji2014")(paper)
    folder = out or Path(f"hysid-{paper}")
    _start()
    from ._reproduce import reproduce as reproduced
    from ._reproduce import terminal

    found = reproduced(folder, rigs=rigs, seed=seed, with_ours=ours, overwrite=overwrite, say=_say)
    _print(found, as_json, [*terminal(found), "", f"Results: {folder}"])
