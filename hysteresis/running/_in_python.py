"""A tree's loop in plain Python: the same text, with m and n as lists; 1 to 100 microseconds a row.

put(m, i, get(m, j))    becomes    m[i] = m[j]
"""

import ast
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ._law import MATHS, PARSING, kept
from ._memory_sizes import MOST
from ._numbers import Structure
from ._text import text_of

OUTPUTS = 8
"""Arguments of a loop before what it writes; the first, m, is written too."""


@kept
def in_python(structure: Structure, wanted: str) -> Callable[..., None]:
    """The loop `wanted` of a tree, as `_kernels.py` says; of arrays in place of addresses."""
    text = text_of(structure, wanted)
    with PARSING:
        tree = ast.fix_missing_locations(_Lists().visit(ast.parse(text)))
        code = compile(tree, f"<{wanted}>", "exec")
    space: dict[str, Any] = {name: getattr(math, name) for name in MATHS}
    space |= dict.fromkeys((f"mark{count}" for count in range(MOST + 1)), _mark)
    space |= {"spot": _spot, "njit": lambda made: made, "loop": lambda made: made}
    exec(code, space)
    # Marks write rows of the table of tangents, which is NumPy's.
    table = (OUTPUTS, OUTPUTS + 1) if "tangents" in wanted else ()

    def call(*given: Any) -> None:
        lists = [
            x.ravel().tolist() if isinstance(x, np.ndarray) and k not in table else x
            for k, x in enumerate(given)
        ]
        if table:
            lists[table[1]] = given[table[1]].reshape(-1)
        space[wanted](*lists)
        for k, (x, values) in enumerate(zip(given, lists, strict=True)):
            if isinstance(values, list) and (k == 0 or k >= OUTPUTS) and x.flags.writeable:
                x.reshape(-1)[:] = values

    return call


class _Lists(ast.NodeTransformer):
    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id in ("get", "whole"):
            return ast.Subscript(node.args[0], node.args[1], ast.Load())
        return node

    def visit_Expr(self, node: ast.Expr) -> ast.stmt:
        self.generic_visit(node)
        match node.value:
            case ast.Call(func=ast.Name(id="put"), args=[array, place, value]):
                return ast.Assign([ast.Subscript(array, place, ast.Store())], value)
        return node


def _spot(t: Any, x: int, a: int, d: float) -> None:
    t[x] += d * t[a]


def _mark(t: Any, x: int, *given: Any) -> None:
    others = list(given[::2])
    t[x] = np.asarray(given[1::2]) @ t[others] if others else 0.0
