"""`hysid reproduce` on the command line: what it is told, what it prints."""

from pathlib import Path
from typing import Annotated

import typer


def reproduce(
    paper: Annotated[str, typer.Argument(metavar="PAPER", help="tsuji2014 or kim2018.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; by default hysid-PAPER.")
    ] = None,
    rigs: Annotated[
        int | None,
        typer.Option(
            min=2, help="Virtual laboratories; by default 60 of tsuji2014, 20 of kim2018."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first laboratory.")] = 0,
    ours: Annotated[bool, typer.Option(help="Also by our methods, which takes longer.")] = True,
    epochs: Annotated[
        int | None,
        typer.Option(min=1, help="Of the networks of kim2018; by default the paper's 1,000."),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Write over results that are there.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """A paper's tables and figures beside what virtual laboratories make of them."""
    from ._app import _one_of, _print, _say, _start

    _one_of("tsuji2014", "kim2018")(paper)
    folder = out or Path(f"hysid-{paper}")
    _start()
    from ..reproduction import reproduce as reproduced
    from ..reproduction import terminal

    found = reproduced(
        paper, folder, rigs=rigs, seed=seed, with_ours=ours, epochs=epochs,
        overwrite=overwrite, say=_say,
    )  # fmt: skip
    _print(found, as_json, [*terminal(found), "", f"Results: {folder}"])
