"""The functions of a tree's nodes in C, and what they cost at most."""

import ast
import ctypes
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

from hysteresis.laws._nodes import AROUND, Node, function_of
from hysteresis.laws._tree import Tree

from ._operation_count import OF_A_NODE, Count
from ._python_to_c99 import Element, Expression, Function, comment

# In C: the functions by which a compensator that recalibrates itself learns.


def called(home: Element, k: int, document: Tree) -> str:
    """What is called from outside: a reading with its true input, and what is said of the compensator."""
    real, prefix, stem = home.real, home.prefix, home.stem
    held = f"{real} condition, " if document.get("condition") else ""
    passed = "dt, reading, " + ("condition, " if held else "")
    return f"""\
/* As {stem}_step, of a reading whose true input, the reference, is known: the compensator learns from it.
 * The estimate is made before. A reference that is not finite is none. */
static inline int {stem}_learn(
    {stem}_state *s, {real} dt, {real} reading, {held}{real} reference, {real} *estimate, {real} *deviation)
{{
    s->n{k}.known = isfinite(reference) ? 1 : 0;
    s->n{k}.reference = s->n{k}.known ? reference : s->n{k}.reference;
    int status = {stem}_step(s, {passed}estimate, deviation);
    s->n{k}.known = 0;
    return status;
}}

/* Why a calibration is needed now; 0 where none is. A change is being learnt, most of it of 1: the zero,
 * 2: the gain, 3: the width of the loop. 4: errors are large, and none of these explains them. 5: the zero
 * may have drifted too far since the last reference. */
static inline int {stem}_advice({stem}_state *s)
{{
    return {prefix}_advice(&{stem}_{k}, &s->n{k});
}}

/* The rms error that estimates have beyond that of the fit. */
static inline {real} {stem}_lost({stem}_state *s)
{{
    return {prefix}_lost(&{stem}_{k}, &s->n{k});
}}"""


def place_of(node: Node) -> str:
    """Where the state of a node lies in that of the whole."""
    return "last" if node.kind == AROUND else f"n{node.number}"


class Nodes(SimpleNamespace):
    """The nodes of a tree, by their numbers, and the elements of their laws, by their kinds; in place of an
    element for the functions of nodes."""

    def __init__(self, nodes: Sequence[Node], elements: Mapping[str, Element]):
        one = next(iter(elements.values()))
        super().__init__(stem=one.stem, real=one.real, single=one.single, prefix=one.stem)
        self.comments, self.common, self.elements = {}, {}, elements
        self.nodes = {node.number: node for node in nodes}
        self.changing = [node for node in nodes if "state" in node.of]

    def function(self, title: str) -> ast.FunctionDef:
        """A function of a node, by its name in the text."""
        name, _, number = title.rpartition("_")
        (made,) = ast.parse(function_of(self.nodes[int(number)], name)).body
        assert isinstance(made, ast.FunctionDef)
        return made


class NodeFunction(Function):
    """A function of a node on its way to C."""

    def __init__(self, home: Nodes, title: str, done: dict[str, str]):
        super().__init__(home, home.function(title), {"s": f"{home.stem}_state"}, done)
        name, _, number = title.rpartition("_")
        self.name = f"{home.stem}_{number}_{name}"

    def _used(self) -> set[str]:
        used = super()._used()
        return used | {"s"} if any(x[0] == "s" and x[1:].isdecimal() for x in used) else used

    def _expression(self, node: ast.expr, quiet: bool = False) -> Expression:
        match node:
            case ast.Attribute(value=ast.Name(id=x), attr=field):
                own = self.home.nodes[int(x[1:])]
                structure = "Parameters" if x[0] == "p" else "State"
                kind = self.home.elements[own.kind].structures[structure][field]
                return Expression(f"{self._place(x)}.{field}", kind)
            case ast.Name(id=x) if x not in self.types:
                return Expression(f"&{self._place(x)}", "")
        return super()._expression(node, quiet)

    def _place(self, structure: str) -> str:
        number = structure[1:]
        node = self.home.nodes[int(number)]
        return f"{self.home.stem}_{number}" if structure[0] == "p" else f"s->{place_of(node)}"

    def _call(self, node: ast.Call, name: str, quiet: bool) -> Expression:
        kind, of_law, function = name.rpartition("__")
        if of_law:
            element = self.home.elements[kind]
            return self._called(element, element.functions[function], node, quiet)
        called = NodeFunction(self.home, name, self.done)
        given = ", ".join(self._as(a, "real" if k else "") for k, a in enumerate(node.args))
        text = "" if quiet else f"{called.translate()}({given})"
        return Expression(text, called.kind)

    def _own(self, name: str) -> str:
        return NodeFunction(self.home, name, self.done).translate()


class NodeCount(Count):
    """Operations of the functions of nodes."""

    def __init__(self, home: Nodes):
        self.nodes = home

    def of_function(self, name: str, arguments: Sequence[ast.expr] = ()) -> int:
        kind, of_law, function = name.rpartition("__")
        if not of_law:
            return OF_A_NODE + sum(map(self.of, self.nodes.function(name).body))
        names = [a.id for a in arguments if isinstance(a, ast.Name)]
        own = next(self.nodes.nodes[int(x[1:])] for x in names if x[1:].isdecimal())
        looks = [self.of_function(x) for x in names if x.rpartition("_")[0] in ("look", "inner")]
        calls = dict.fromkeys(["look"], sum(looks))
        parameters = SimpleNamespace(**own.of["parameters"])
        return Count(self.nodes.elements[kind], parameters, calls).of_function(function)


# What changes in a C99 compensator: its structure, its values before the first reading, and its size.


def state_in_c(nodes: Nodes, listed: Callable[..., str], number: Callable[..., str]) -> str:
    """The structure of the nodes' states, and the function that resets it.

    `listed` and `number`: values as C writes them.
    """
    stem, fields, values = nodes.stem, [], []
    for part in nodes.changing:
        home = nodes.elements[part.kind]
        fields.append(f"    {home.prefix}_state {place_of(part)};")
        given = [
            listed(value) if t == "Reals" else number(value, t)
            for k, t in home.structures["State"].items()
            for value in [part.of["state"][k]]
        ]  # fmt: skip
        values.append("        {" + ", ".join(given) + "}")
    body = ",\n".join(values)
    return "\n".join(
        [
            comment("Everything that changes; the caller keeps it.", ""),
            "typedef struct {", *fields, f"}} {stem}_state;", "",
            f"static inline void {stem}_reset({stem}_state *s)", "{",
            f"    static const {stem}_state initial {stem.upper()}_TABLE = {{\n{body}\n    }};",
            f"    {stem.upper()}_COPY(s, &initial);", "}",
        ]
    )  # fmt: skip


def size_of(nodes: Nodes) -> int:
    """sizeof of that structure, by the rules that C compilers share."""
    real = ctypes.c_float if nodes.single else ctypes.c_double
    members: list[tuple[str, Any]] = []
    for part in nodes.changing:
        same = [p.of["state"] for p in nodes.changing if p.kind == part.kind]
        fields: list[tuple[str, Any]] = [
            (k, ctypes.c_int if t == "int" else real if t != "Reals"
             else real * max(1, *(len(state[k]) for state in same)))
            for k, t in nodes.elements[part.kind].structures["State"].items()
        ]  # fmt: skip
        structure = type("_Part", (ctypes.Structure,), {"_fields_": fields})
        members.append((f"n{part.number}", structure))
    return ctypes.sizeof(type("_State", (ctypes.Structure,), {"_fields_": members}))
