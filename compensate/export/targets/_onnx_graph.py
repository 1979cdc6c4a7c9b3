"""An ONNX graph in the making: values, branches that become If, loops that become Loop.

A variable is a value of the graph; an assignment makes a new one. What a branch or a loop changes is what
it gives back. Numbers that are known when the graph is made are computed here, by Python, which rounds as
the graph would.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from onnx import GraphProto, NodeProto, ValueInfoProto

Key = tuple[Any, ...]
TYPES = {"real": np.float64, "int": np.int64, "bool": np.bool_}


@dataclass(eq=False)
class Value:
    """A value: its name, "real", "int", "bool" or "reals", and what it is where that is known."""

    name: str
    type: str
    known: Any = None


@dataclass
class Graph:
    """A graph in the making: the nodes of the innermost block, and the variables."""

    onnx: Any
    blocks: list[list[Any]] = field(default_factory=lambda: [[]])
    constants: dict[Any, tuple[str, Any]] = field(default_factory=dict)
    variables: dict[Key, Value] = field(default_factory=dict)
    count: int = 0

    # Nodes

    def fresh(self) -> str:
        """A name that no other value has."""
        self.count += 1
        return f"v{self.count}"

    def node(self, operation: str, inputs: list[Value], kind: str, **attributes: int) -> Value:
        """A node with one output."""
        made = Value(self.fresh(), kind)
        names = [self.name(v) for v in inputs]
        self.blocks[-1].append(
            self.onnx.helper.make_node(operation, names, [made.name], **attributes)
        )
        return made

    def real(self, operation: str, *inputs: Value) -> Value:
        """A node that gives a real."""
        return self.node(operation, list(inputs), "real")

    def name(self, value: Value) -> str:
        """The name of a value; one that is known becomes an initializer."""
        if value.known is None:
            return value.name
        array = np.asarray(value.known, TYPES.get(value.type, np.float64))
        key = (value.type, array.shape, array.tobytes())
        if key not in self.constants:
            self.constants[key] = (self.fresh(), array)
        return self.constants[key][0]

    def constant(self, known: "float | np.ndarray", kind: str) -> Value:
        """A number, or an array, that is known."""
        return Value("", kind, known)

    def cast(self, value: Value, kind: str) -> Value:
        """The value as another type; a real becomes an integer towards zero, as in C."""
        if value.type == kind:
            return value
        if value.known is not None:
            return self.constant({"int": int, "real": float, "bool": bool}[kind](value.known), kind)
        kinds = {"real": "DOUBLE", "int": "INT64", "bool": "BOOL"}
        return self.node("Cast", [value], kind, to=getattr(self.onnx.TensorProto, kinds[kind]))

    @contextmanager
    def block(self) -> "Iterator[list[NodeProto]]":
        """Nodes of a branch or a loop's body."""
        self.blocks.append([])
        yield self.blocks[-1]
        self.blocks.pop()

    def subgraph(
        self, nodes: "list[NodeProto]", inputs: list[Value], outputs: list[Value]
    ) -> "GraphProto":
        """A branch or a body."""
        given, found = ([self.information(v) for v in some] for some in (inputs, outputs))
        return self.onnx.helper.make_graph(nodes, self.fresh(), given, found)

    def information(self, value: Value) -> "ValueInfoProto":
        """Name, type and shape of an input or an output."""
        proto = self.onnx.TensorProto
        kind = {"int": proto.INT64, "bool": proto.BOOL}.get(value.type, proto.DOUBLE)
        return self.onnx.helper.make_tensor_value_info(
            value.name, kind, [None] if value.type == "reals" else []
        )

    # Control flow

    def branch(self, test: Value, then: Callable[[], None], otherwise: Callable[[], None]) -> None:
        """Whichever the test says; only that one where it is known."""
        test = self.cast(test, "bool")
        if test.known is not None:
            (then if test.known else otherwise)()
            return
        before = dict(self.variables)
        ends: list[tuple[list[Any], dict[Key, Value]]] = []
        for run in (then, otherwise):
            self.variables = dict(before)
            with self.block() as nodes:
                run()
                ends.append((nodes, self.variables))
        changed = [
            key
            for key in dict.fromkeys([*ends[0][1], *ends[1][1]])
            if any(end.get(key) is not before.get(key) for _, end in ends)
        ]
        self.variables = before
        if not changed:
            return
        kinds = {}
        for key in changed:
            found = {end[key].type for _, end in ends if key in end}
            kinds[key] = "real" if found == {"int", "real"} else found.pop()
        graphs = []
        for nodes, end in ends:
            self.blocks.append(nodes)
            outputs = [self.settled(end.get(key), kinds[key]) for key in changed]
            self.blocks.pop()
            graphs.append(self.subgraph(nodes, [], outputs))
        made = {key: Value(self.fresh(), kinds[key]) for key in changed}
        names = [v.name for v in made.values()]
        node = self.onnx.helper.make_node(
            "If", [test.name], names, then_branch=graphs[0], else_branch=graphs[1]
        )
        self.blocks[-1].append(node)
        self.variables |= made

    def settled(self, value: Value | None, kind: str) -> Value:
        """A value that a block gives out, which has to be made within it; 0 for one that is not used."""
        zero = np.zeros(1) if kind == "reals" else 0
        value = self.constant(zero, kind) if value is None else value
        return self.node("Identity", [self.cast(value, kind)], kind)

    def loop(
        self, test: Callable[[], Value], body: Callable[[Value], None], trips: Value | None = None
    ) -> None:
        """The body, given how often it ran, while the test holds; at most `trips` times."""
        carried = self._changed_by(test, body)
        before = dict(self.variables)
        first = self.cast(test(), "bool")
        if first.known is False:
            return
        start = [self.cast(before.get(k) or self.constant(0, t), t) for k, t in carried.items()]
        with self.block() as nodes:
            turn, going = Value(self.fresh(), "int"), Value(self.fresh(), "bool")
            inside = {key: Value(self.fresh(), kind) for key, kind in carried.items()}
            self.variables = before | inside
            body(turn)
            again = self.settled(self.cast(test(), "bool"), "bool")
            ends = [self.settled(self.variables[key], kind) for key, kind in carried.items()]
        graph = self.subgraph(nodes, [turn, going, *inside.values()], [again, *ends])
        made = {key: Value(self.fresh(), kind) for key, kind in carried.items()}
        names = [self.name(v) for v in [first, *start]]
        count = "" if trips is None else self.name(trips)
        outputs = [v.name for v in made.values()]
        self.blocks[-1].append(
            self.onnx.helper.make_node("Loop", [count, *names], outputs, body=graph)
        )
        self.variables = before | made

    def _changed_by(
        self, test: Callable[[], Value], body: Callable[[Value], None]
    ) -> dict[Key, str]:
        """What the body sets, with types: found by trial runs, in which what it sets is not known."""
        before, count, carried = dict(self.variables), self.count, dict[Key, str]()
        while True:
            unknown = {key: Value(self.fresh(), kind) for key, kind in carried.items()}
            self.variables = before | unknown
            start = dict(self.variables)
            with self.block():
                body(Value(self.fresh(), "int"))
                test()
            found = {k: v.type for k, v in self.variables.items() if v is not start.get(k)}
            wider = {
                k: "real" for k, t in found.items() if {t, carried.get(k, t)} == {"int", "real"}
            }
            more = carried | {k: t for k, t in found.items() if k not in carried} | wider
            self.variables = dict(before)
            if more == carried:
                self.count = max(self.count, count)
                return carried
            carried = more
