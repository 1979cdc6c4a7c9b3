"""The functions of a tree's nodes in C, and what they cost at most."""

import ast
from collections.abc import Mapping, Sequence
from types import SimpleNamespace

from hysteresis.laws._nodes import AROUND, Node, function_of

from ._operation_count import OF_A_NODE, Count
from ._python_to_c99 import Element, Expression, Function


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
