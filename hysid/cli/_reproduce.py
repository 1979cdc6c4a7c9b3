"""`hysid reproduce`."""

from pathlib import Path
from typing import Annotated

import typer

from ._console import AsJson, Overwrite, log, one_of, print_result, start_jax

PAPERS = ("tsuji2014", "kim2018")


def reproduce(
    paper: Annotated[
        str,
        typer.Argument(metavar="PAPER", help=f"{' or '.join(PAPERS)}.", callback=one_of(*PAPERS)),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results (default: hysid-PAPER).")
    ] = None,
    rigs: Annotated[
        int | None,
        typer.Option(
            min=2,
            help="Number of virtual laboratories (default: 60 for tsuji2014, 20 for kim2018).",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first laboratory.")] = 0,
    ours: Annotated[
        bool, typer.Option(help="Also use the methods of hysid, which takes longer.")
    ] = True,
    epochs: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Training epochs of kim2018's network (default: the paper's 1,000).",
        ),
    ] = None,
    quick: Annotated[
        bool,
        typer.Option("--quick", help="Fewer laboratories and epochs: five minutes on two cores."),
    ] = False,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Reproduce a paper's tables with virtual laboratories."""
    folder = out or Path(f"hysid-{paper}")
    start_jax()
    from .. import reproduction  # after JAX is set up; no other command imports it

    found = reproduction.reproduce(
        paper, folder, rigs=rigs, seed=seed, with_ours=ours, epochs=epochs, quick=quick,
        overwrite=overwrite, say=log,
    )  # fmt: skip
    print_result(found, as_json, [*reproduction.terminal(found), "", f"Results: {folder}"])
