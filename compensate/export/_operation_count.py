"""What a step of an exported compensator costs at most, counted from its elements."""

import ast
import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

from hysteresis.running._law import MATHS

from ._python_to_c99 import Element

LIBRARY = 250
"""Operations that a call of math.h is taken for."""
CALL, OF_A_NODE = 8, 12
"""Those of the call of a function, and of what a node of the tree adds to its element's."""


def operations(
    home: Element, name: str, parameters: dict[str, Any], calls: dict[str, int] | None = None
) -> int:
    """An upper bound for a call: arithmetic, comparisons, look-ups and assignments.

    `calls`: what functions that are given to it cost.
    """
    return Count(home, SimpleNamespace(**parameters), calls or {}).of_function(name)


class Count:
    """Operations of functions, at most."""

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
                own = (
                    2
                    if name == "int"
                    else LIBRARY
                    if name in MATHS
                    else self.of_function(name, node.args)
                )
                return own + 2 * len(node.args) + sum(map(self.of, node.args))
        return _own(node) + sum(map(self.of, ast.iter_child_nodes(node)))


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


def _own(node: ast.AST) -> int:
    counted = isinstance(
        node,
        ast.BinOp | ast.Compare | ast.BoolOp | ast.IfExp | ast.UnaryOp | ast.Assign | ast.Return,
    )
    return 2 * counted + 2 * isinstance(node, ast.Attribute | ast.Subscript)
