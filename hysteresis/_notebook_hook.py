"""How our objects look in a notebook: as whoever has registered draws them, else as text."""

from collections.abc import Callable
from typing import Any

_drawn_by: list[Callable[[Any], str]] = []


def draw_with(draw: Callable[[Any], str]) -> None:
    """From now on `draw` makes the HTML of records, fits, posteriors and compensators."""
    _drawn_by[:] = [draw]


def html_of(thing: Any) -> str | None:
    """The HTML of one of our objects; None, for which notebooks show text, without a `draw`."""
    return _drawn_by[0](thing) if _drawn_by else None
