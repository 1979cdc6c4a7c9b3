"""Of many parameters of a test, which are tried by `make test` and which by `make thorough`."""

from collections.abc import Callable, Iterable
from typing import Any

import pytest


def rest_thorough(values: Iterable[Any], quick: int | Callable[[Any], bool]) -> list[Any]:
    """Values for `parametrize`, by their names: the first so many, or those chosen, are of every run."""
    marked = []
    for k, value in enumerate(values):
        often = k < quick if isinstance(quick, int) else quick(value)
        parts = value if isinstance(value, tuple) and not hasattr(value, "_fields") else (value,)
        marks, name = [] if often else pytest.mark.thorough, getattr(value, "name", None)
        marked.append(pytest.param(*parts, marks=marks, id=name))
    return marked
