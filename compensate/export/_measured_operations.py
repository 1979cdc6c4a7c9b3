"""What a step of an exported compensator costs on some readings, counted while it runs."""

import ast
import inspect
import sys
from collections.abc import Callable, Sequence
from functools import cache
from types import FrameType
from typing import NamedTuple

from hysteresis.laws import FORGET, KINDS, _search, announced, module_of
from hysteresis.laws._tree import Tree

from ..runtime._compensator import Compensator
from ._operation_count import CALL, OF_A_NODE, OwnCount

Tracer = Callable[[FrameType, str, object], object]

TRACED = 200
"""Steps that are traced; one takes some tenths of a millisecond."""


class Operations(NamedTuple):
    """Operations of a step: in the mean and at most over so many readings."""

    mean: float
    most: int
    readings: int


def measured(document: Tree, samples: Sequence[Sequence[float]]) -> Operations:
    """Of a document that `compensate.runtime` loads, over samples (dt, reading), and the condition if any.

    The lines of the elements that a step runs are traced, in so many of the steps, evenly; each counts as
    `operations` counts it.
    """
    lines, sensor, count = _costs(announced()), Compensator(document), 0

    def within(frame: FrameType, event: str, _: object) -> Tracer:
        nonlocal count
        if event == "line":
            count += lines[frame.f_code.co_filename].get(frame.f_lineno, 0)
        return within

    def called(frame: FrameType, event: str, _: object) -> Tracer | None:
        nonlocal count
        if frame.f_code.co_filename not in lines:
            return None
        count += CALL + (OF_A_NODE if frame.f_code.co_name in ("look", "move", "find") else 0)
        return within

    before, each = sys.gettrace(), []
    try:
        for k, sample in enumerate(samples):
            if k * TRACED // len(samples) == (k - 1) * TRACED // len(samples):
                sensor.step(*sample)
                continue
            count = 0
            sys.settrace(called)  # pyright: ignore[reportArgumentType]
            sensor.step(*sample)
            sys.settrace(before)
            each.append(count)
    finally:
        sys.settrace(before)
    return Operations(sum(each) / max(len(each), 1), max(each, default=0), len(each))


@cache
def _costs(further: tuple[str, ...]) -> dict[str, dict[int, int]]:
    """Operations of every line of the elements, by file and line."""
    found: dict[str, dict[int, int]] = {}
    kinds = [kind for kind in KINDS if kind != "series"]
    for module in (_search, *map(module_of, (*kinds, *further, "error", "guard"))):
        code = ast.parse(inspect.getsource(module))
        lines = found[str(inspect.getsourcefile(module))] = {}
        for function in (node for node in code.body if isinstance(node, ast.FunctionDef)):
            for node in ast.walk(function):
                if isinstance(node, ast.stmt) and node is not function:
                    lines[node.lineno] = lines.get(node.lineno, 0) + OwnCount().of(node)
    return found


FORGET.append(_costs.cache_clear)
