"""`hysid reproduce`; no other command imports the papers."""

from pathlib import Path

from .. import reproduction
from ._asked import Reproduce
from ._console import Done, log


def run(asked: Reproduce) -> Done:
    """The tables of a paper with virtual laboratories."""
    folder = asked.out or Path(f"hysid-{asked.paper}")
    found = reproduction.reproduce(
        asked.paper, folder, rigs=asked.rigs, seed=asked.seed, with_ours=asked.ours,
        epochs=asked.epochs, quick=asked.quick, overwrite=asked.overwrite, say=log,
    )  # fmt: skip
    return Done(found, [*reproduction.terminal(found), "", f"Results: {folder}"])
