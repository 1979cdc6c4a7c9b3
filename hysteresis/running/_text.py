"""The source of a tree of laws: its functions, each node's from those of its parts, and the loop over time.

What is wanted ("run", "find", "tangents", "find_tangents") names the loop, see `_kernels.py`.
"""

import ast
from functools import cache
from pathlib import Path

from ..laws._nodes import WITHOUT, Node, function_of
from . import _around
from ._law import PARSING, kept, law
from ._marks import Leaf, Marked
from ._numbers import Structure

FORWARD = {"feedback": "find", "oscillator": "find"}
"""Kinds that go from what is given to what is measured by another function than `move`."""

WRAPPED = {"scaled": "onward", "share": "weighted"}
"""Kinds around one part, and their function of its output."""


EACH = "each_"
"""Before the name of a law's function and what of its state is kept: a loop over columns of numbers."""


@kept
def text_of(structure: Structure, wanted: str) -> str:
    """The whole text: laws, nodes, the loop."""
    return Text(structure).of(wanted)


class Text:
    def __init__(self, structure: Structure):
        self.home = Marked(_constants(structure))
        self.numbered: list[Node] = []
        self.rows = 0  # of n: each node's begins at `of`
        self.root = self._node(structure)
        self.nodes: dict[str, str] = {}

    def of(self, wanted: str) -> str:
        entries = [f"STATE = {self.rows}", self._take()]
        if wanted.startswith(EACH):
            loop = self._each(wanted)
            return "\n\n\n".join([*self.home.texts.values(), *self.nodes.values(), loop])
        if "tangents" in wanted:
            entries += self._marked()
        if wanted == "find_told":
            entries.append(self._told())
        if wanted in ("run", "looks"):
            forward = FORWARD.get(self.root.kind, "move")
            entries.append(f"move = {self.function(self.root, forward)}")
        if wanted == "looks":
            entries.append(f"look = {self.function(self.root, 'look')}")
        if "find" in wanted:
            entries.append(f"found = {self.function(self.root, 'find')}")
            entries.append(f"status_of = {self.function(self.root, 'status')}")
        entries += [_loop("begun"), _loop(wanted)]
        made = [*self.home.texts.values(), *self.nodes.values(), *entries]
        return "\n\n\n".join(made)

    def _take(self) -> str:
        """What takes the condition before a row."""
        lines = [self.law(node, "take", "c") for node in self.numbered if node.kind == "share"]
        if self.root.kind == "adaptive":  # its condition is the input, where that is known
            lines += [
                "known = 1.0 if c - c == 0.0 else 0.0", self.set(self.root, "known", "known"),
                self.set(self.root, "reference", "c if known != 0.0 else 0.0"),
            ]  # fmt: skip
        return _function("take(m, n, c)", lines or ["pass"])

    def _told(self) -> str:
        """What keeps beside each estimate what a law around the tree says of it."""
        said = _around.said(self, self.root)
        return _function(
            "told(m, n, said, k)",
            [f"put(said, k * {len(said)} + {j}, 1.0 * {x})" for j, x in enumerate(said)],
        )

    def _each(self, wanted: str) -> str:
        """A loop over rows that calls a function of the law, as `find_told` does over rows of a tree."""
        name, *kept = wanted.removeprefix(EACH).split("_")
        taken = [a.arg for a in law(self.root.kind).functions[name].args.args[2:]]
        columns = [x for x in taken if x != "dt"]
        values = [
            "get(dt, k)" if x == "dt" else f"get(given, {len(columns)} * k + {columns.index(x)})"
            for x in taken
        ]
        said = [
            f"    put(said, k * {len(kept)} + {j}, 1.0 * {self.number(self.root, x)})"
            for j, x in enumerate(kept)
        ]
        return "\n    ".join([
            f"@loop\ndef {wanted}(m, n, first, size, x, dt, c, rows, u, status, said, given):",
            "for k in range(rows):",
            "    if get(x, k) - get(x, k) == 0.0:",
            f"        put(u, k, {self.law(self.root, name, *values)})",
            f"        put(status, k, {self.number(self.root, 'status')})",
            *said,
        ])  # fmt: skip

    def _node(self, structure: Structure) -> Node:
        parts = tuple(self._node(part) for part in structure.parts)
        node = Node(structure.kind, len(self.numbered), parts, self.rows)
        self.numbered.append(node)
        self.rows += 0 if structure.kind == WITHOUT else law(structure.kind).row
        return node

    # Values

    def law(self, node: Node, name: str, *values: str, given: dict[str, str] | None = None) -> str:
        """A call of a function of a node's law."""
        title = self.home.values(node.kind, name, given)
        return f"{title}({', '.join(['m', 'n', str(node.of), *values])})"

    def number(self, node: Node, field: str, of: str = "State") -> str:
        """A number of a node."""
        return f"get(m, {self.place(node, field, of)})"

    def set(self, node: Node, field: str, value: str) -> str:
        return f"put(m, {self.place(node, field)}, {value})"

    def place(self, node: Node, field: str, of: str = "State") -> str:
        place = law(node.kind).place(of, field)
        if law(node.kind).fields[of][field] == "Reals":
            return f"whole(n, {node.of + place})"
        return f"whole(n, {node.of + int(of == 'State')}) + {place}"

    def function(self, node: Node, name: str) -> str:
        """The name of a node's `look`, `move`, `follow` or `find`, (m, n, dt, x), or `status`, (m, n)."""
        title = f"{name}_{node.number}"
        if title not in self.nodes:
            if node.kind == "filtered" and name != "status":
                made = _function(f"{title}(m, n, dt, x)", _around.filtered(self, node, name))
            else:
                with PARSING:
                    function = _Addresses(self).visit(ast.parse(function_of(node, name)))
                    made = f"@njit\n{ast.unparse(function)}"
            self.nodes[title] = made
        return title

    def call(self, node: Node, name: str, x: str = "x", dt: str = "dt") -> str:
        return f"{self.function(node, name)}(m, n, {dt}, {x})"

    # Marks

    def _marked(self) -> list[str]:
        """A move with marks."""
        u, dt, y = (self.home.number("", name) for name in ("u", "dt", "y"))
        lines: list[str] = []
        value, number = self._moved(self.root, ("u", str(u)), str(dt), lines)
        lines += [f"mark1(t, {y}, {number}, 1.0)", f"return {value}"]
        self.nodes["move_r"] = _function("move_r(m, n, t, dt, u)", lines)
        return [f"LOCALS = {len(self.home.numbers)}", f"U, DT, Y = {u}, {dt}, {y}"]

    def _moved(self, node: Node, x: Leaf, dt: str, lines: list[str]) -> Leaf:
        """Lines of a node whose input is variable x[0] of number x[1]; its output's."""
        kind, inner = node.kind, node.parts
        if kind == WITHOUT:
            for part in inner:
                x = self._moved(part, x, dt, lines)
            return x
        out = f"y{node.number}", str(self.home.number("", f"y{node.number}"))
        outputs = [self._moved(part, x, dt, lines) for part in inner]
        if kind == "sum":
            lines.append(f"{out[0]} = {' + '.join(name for name, _ in outputs)}")
            leaves = "".join(f", {number}, 1.0" for _, number in outputs)
            lines.append(f"mark{len(outputs)}(t, {out[1]}{leaves})")
            return out
        entry = (WRAPPED | FORWARD).get(kind, "move")
        title, key = self.home.marked(kind, entry), f"{kind}_{entry}"
        floats = [
            a.arg
            for a in law(kind).functions[entry].args.args
            if a.annotation is not None and getattr(a.annotation, "id", "") == "float"
        ]
        given = [("dt", dt) if name == "dt" else (outputs or [x])[0] for name in floats]
        for name, (_, number) in zip(floats, given, strict=True):
            if (key, name) in self.home.active:
                lines.append(f"mark1(t, {self.home.number(key, name)}, {number}, 1.0)")
        values = ", ".join(value for value, _ in given)
        lines.append(f"{out[0]} = {title}(m, n, t, {node.of}, {values})")
        back = ""
        if (key, "return") in self.home.active:
            back = f", {self.home.number(key, 'return')}, 1.0"
        lines.append(f"mark{1 if back else 0}(t, {out[1]}{back})")
        return out


class _Addresses(ast.NodeTransformer):
    """A function of a node, of addresses."""

    def __init__(self, text: Text):
        self.text = text

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        given = ["m", "n", *(a.arg for a in node.args.args[1:])]
        node.args.args, node.returns = [ast.arg(x) for x in given], None
        self.generic_visit(node)
        return node

    def visit_Assign(self, node: ast.Assign) -> ast.stmt:
        value = self.visit(node.value)
        match node.targets:
            case [ast.Attribute(value=ast.Name(id=x), attr=field)]:
                put = self.text.set(self.text.numbered[int(x[1:])], field, ast.unparse(value))
                return ast.Expr(ast.Name(put))
        return ast.Assign(node.targets, value, lineno=0)

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        assert isinstance(node.value, ast.Name)
        own = self.text.numbered[int(node.value.id[1:])]
        structure = {"p": "Parameters", "s": "State"}[node.value.id[0]]
        number = self.text.number(own, node.attr, structure)
        whole = law(own.kind).fields[structure][node.attr] == "int"
        return ast.Name(f"int({number})" if whole else number)

    def visit_Call(self, node: ast.Call) -> ast.expr:
        assert isinstance(node.func, ast.Name)
        kind, of_law, function = node.func.id.rpartition("__")
        if not of_law:
            given = [ast.unparse(self.visit(a)) for a in node.args[1:]]
            return ast.Name(f"{self._of_node(node.func.id)}({', '.join(['m', 'n', *given])})")
        own, functions, values = self.text.root, {}, []
        for argument, a in zip(law(kind).functions[function].args.args, node.args, strict=True):
            match a:
                case ast.Name(id=x) if x[1:].isdecimal():
                    own = self.text.numbered[int(x[1:])]
                case ast.Name(id=x) if "_" in x:
                    functions[argument.arg] = self._of_node(x)
                case ast.Name(id="s"):
                    pass
                case _:
                    values.append(ast.unparse(self.visit(a)))
        return ast.Name(self.text.law(own, function, *values, given=functions))

    def _of_node(self, title: str) -> str:
        name, _, number = title.rpartition("_")
        return self.text.function(self.text.numbered[int(number)], name)


def _function(head: str, lines: list[str]) -> str:
    return "\n".join(["@njit", f"def {head}:", *(f"    {line}" for line in lines)])


def _constants(structure: Structure) -> set[tuple[str, str]]:
    """Parameters without derivative in every node of their kind."""
    free: dict[str, set[str]] = {}

    def collect(node: Structure) -> None:
        if node.kind != WITHOUT:
            free.setdefault(node.kind, set()).update(node.free)
        for part in node.parts:
            collect(part)

    collect(structure)
    return {(k, f) for k, own in free.items() for f in law(k).fields["Parameters"] if f not in own}


@cache
def _loop(wanted: str) -> str:
    """The text of one loop over time, or of what it calls."""
    text = (Path(__file__).parent / "_kernels.py").read_text("utf-8")
    return next(part for part in text.split("\n\n\n") if f"\ndef {wanted}(" in part)
