"""How our objects are drawn: the one place where lower packages ask hysid, which has all drawing code."""

from importlib import import_module
from typing import Any

from ._errors import InputError
from ._precision import in_own_precision


@in_own_precision
def html_of(thing: Any) -> str | None:
    """The HTML by which a notebook shows a record, a fit, a posterior or a compensator; None without hysid,
    and then it shows text. Raises `InputError` `no-picture` for anything else."""
    drawing = _drawing()
    return None if drawing is None else drawing.html(thing)


@in_own_precision
def plot_of(thing: Any, **options: Any) -> Any:
    """The matplotlib `Figure` that `thing.plot(**options)` gives back.

    Raises `InputError` `missing-extra` without hysid or matplotlib, `no-picture` as `html_of` does.
    """
    drawing = _drawing()
    if drawing is None:
        said = "Figures are drawn by hysid with matplotlib, and one of them cannot be imported."
        raise InputError("missing-extra", said, fix="pip install hysid")
    return drawing.plot(thing, **options)


def _drawing() -> Any:
    # Imports otherwise run from hysid to us. By name and at the first use, because matplotlib takes half a
    # second to load and nobody who only computes should wait for it; nothing is registered anywhere.
    try:
        return import_module("hysid.figures._plot")
    except ImportError:
        return None
