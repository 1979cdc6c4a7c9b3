"""What a step of an exported compensator costs at most, counted from its elements."""

import ast
import inspect
import math
import sys
from collections.abc import Callable, Sequence
from functools import cache
from types import FrameType, SimpleNamespace
from typing import Any, NamedTuple

from hysteresis.laws import FORGET, KINDS, _search, announced, module_of
from hysteresis.laws._tree import Tree
from hysteresis.running._law import MATHS

from ..runtime._compensator import Compensator
from ._python_to_c99 import Element

LIBRARY = 250
"""Operations that a call of math.h is taken for."""
KNOWN = {"int": 2, **dict.fromkeys(MATHS, LIBRARY)}
CALL, OF_A_NODE = 8, 12
"""Those of the call of a function, and of what a node of the tree adds to its element's."""
COUNTED = ast.BinOp | ast.Compare | ast.BoolOp | ast.IfExp | ast.UnaryOp | ast.Assign | ast.Return
"""What counts as one operation."""


class Count:
    """Operations of functions, at most: arithmetic, comparisons, look-ups and assignments. `calls`: what
    functions that are given to them cost."""

    def __init__(self, home: Element, parameters: SimpleNamespace, calls: dict[str, int]):
        self.home, self.calls = home, calls
        self.known: dict[str, Any] = {"p": parameters, "log2": math.log2, **vars(parameters)}

    def of_function(self, name: str, arguments: Sequence[ast.expr] = ()) -> int:
        if name in self.calls:
            return self.calls[name]
        home = self.home if name in self.home.functions else self.home.borrowed(name)
        names = [a.arg for a in home.functions[name].args.args]
        given = {
            taken: self.of_function(e.id)
            for taken, e in zip(names, arguments, strict=False)
            if isinstance(e, ast.Name) and e.id in self.home.functions
        }
        inner = Count(home, self.known["p"], self.calls | given)
        return CALL + sum(map(inner.of, home.functions[name].body))

    def of(self, node: ast.AST) -> int:
        match node:
            case ast.For(target=ast.Name(id=k), iter=ast.Call(args=ends)):
                last = max(int(eval(ast.unparse(ends[-1]), {}, self.known)), 0)
                self.known[k] = max(last - 1, 0)
                return 4 + last * (4 + sum(map(self.of, node.body)))
            case ast.While():
                times = math.ceil(eval(self.home.law.bounds[node.lineno], {}, self.known))
                return (times + 1) * self.of(node.test) + times * (2 + sum(map(self.of, node.body)))
            case ast.If():
                branches = [sum(map(self.of, block)) for block in (node.body, node.orelse)]
                return 2 + self.of(node.test) + max(branches)
            case ast.Call(func=ast.Name(id=name)):
                own = KNOWN.get(name) or self.of_function(name, node.args)
                return own + 2 * len(node.args) + sum(map(self.of, node.args))
        own = 2 * isinstance(node, COUNTED) + 2 * isinstance(node, ast.Attribute | ast.Subscript)
        return own + sum(map(self.of, ast.iter_child_nodes(node)))


class OwnCount(Count):
    """Operations of a statement, without those of the statements and functions in it."""

    def __init__(self) -> None:
        pass

    def of_function(self, name: str, arguments: Sequence[ast.expr] = ()) -> int:
        return 0

    def of(self, node: ast.AST) -> int:
        match node:
            case ast.For():
                return 4
            case ast.If() | ast.While():
                return 2 + self.of(node.test)
        return super().of(node)


# What a step of an exported compensator costs on some readings, counted while it runs.


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
    `Count` counts it.
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
