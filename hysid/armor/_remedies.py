"""Remedies of the armor's errors for whoever types a command: options and files instead of Python."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from hysteresis import InputError

P = ParamSpec("P")
Found = TypeVar("Found")

REMEDIES = {
    "no-time": "add --stream, where the rows are one stream with a column time (s), or say with"
    " --dwell SECONDS how long each load has rested.",
    "wrong-direction": "fit the cover from force to displacement:"
    " hysid fit FILE --input 'force (N)' --output 'displacement (mm)' --out DIR.",
    "wrong-unit": "fit the cover from force to displacement, with their units in the headers, and check the"
    " units of the shape.",
    "no-unit": "fit the cover again with the units in the headers, as force (N) and displacement (mm).",
    "not-a-mesh": "mend the mesh where it was drawn (closed, its triangles counter-clockwise from outside),"
    " and write it again as STL or OBJ.",
    "missing-extra": "pip install 'hysid[mesh]', or give a box instead of a mesh.",
}
"""By the code of an error that names no file: `compensate.armor` raises it for Python and its commands."""


def with_remedies(command: Callable[P, Found]) -> Callable[P, Found]:
    """The command, with errors that recommend only what can be typed."""

    @wraps(command)
    def run(*given: P.args, **named: P.kwargs) -> Found:
        try:
            return command(*given, **named)
        except InputError as error:
            if error.place or error.code not in REMEDIES:
                raise
            fix = REMEDIES[error.code]
            raise InputError(error.code, error.problem, cause=error.cause, fix=fix) from error

    return run
