"""`hysid init`."""

from ..intake._init import init
from ._asked import Init
from ._console import Done


def run(asked: Init) -> Done:
    """Guess a configuration and write it; without an input and output, only say what was seen."""
    found = init(asked.file, asked.out, asked.selection, overwrite=asked.overwrite)
    lines = found.pop("lines")
    return Done(found, lines)
