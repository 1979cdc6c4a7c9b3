"""The plots of the studio's page as texts for pages of one file: rules of style, a script and its hash."""

import base64
import hashlib
import re
from functools import cache
from pathlib import Path

STATIC = Path(__file__).parent / "studio" / "static"


def styles() -> str:
    """The rules of uPlot and of the plots."""
    return "\n".join(
        (STATIC / name).read_text("utf-8") for name in ("uplot/uPlot.min.css", "plots.css")
    )


@cache
def script(last: str) -> str:
    """uPlot, the plots and a file that draws by them, as one module without imports."""
    names = ("uplot/uPlot.iife.min.js", "plots.js", last)
    whole = "\n".join((STATIC / name).read_text("utf-8") for name in names)
    return re.sub(r"^import .*\n|^export (?!default)", "", whole, flags=re.MULTILINE)


def script_rule(last: str) -> str:
    """The source of a content security policy that lets this script run, and no other."""
    digest = hashlib.sha256(script(last).encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"
