"""`hysid reproduce`; no other command imports the papers."""

from pathlib import Path

from .. import reproduction
from ._asked import Reproduce
from ._console import Done, log


def run(asked: Reproduce) -> Done:
    """The tables of a paper with virtual laboratories."""
    folder = asked.out or Path(f"hysid-{asked.paper}")
    names = ("rigs", "seed", "ours", "epochs", "quick", "overwrite")
    options = {name: getattr(asked, name) for name in names}
    found = reproduction.reproduce(asked.paper, folder, say=log, **options)
    return Done(found, [*reproduction.terminal(found), "", f"Results: {folder}"])
