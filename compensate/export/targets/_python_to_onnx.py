"""Translation of the runtime's elements from Python to ONNX, statement by statement."""

import ast
import math
import operator
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hysteresis import InputError
from hysteresis.running._law import MATHS

from .._python_to_c99 import Element, Function
from ._onnx_graph import TYPES, Graph, Value

OPERATORS: dict[type, tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Add: ("Add", operator.add), ast.Sub: ("Sub", operator.sub), ast.Mult: ("Mul", operator.mul),
    ast.Div: ("Div", operator.truediv), ast.FloorDiv: ("Div", operator.floordiv),
    ast.Mod: ("Mod", operator.mod), ast.Lt: ("Less", operator.lt), ast.LtE: ("LessOrEqual", operator.le),
    ast.Gt: ("Greater", operator.gt), ast.GtE: ("GreaterOrEqual", operator.ge),
    ast.Eq: ("Equal", operator.eq), ast.NotEq: ("Equal", operator.ne),
}  # fmt: skip
MATHEMATICS = {name: name.title() for name in ("exp", "log", "pow", "sqrt", "tanh")} | {
    "fabs": "Abs"
}


def _asinh(graph: Graph, x: Value) -> Value:
    """log(|x| + sqrt(x^2 + 1)), with the sign of x: ONNX has it for float only."""
    made, one = graph.real, graph.constant(1.0, "real")
    root = made("Sqrt", made("Add", made("Mul", x, x), one))
    return made("Mul", made("Sign", x), made("Log", made("Add", made("Abs", x), root)))


def _log1p(graph: Graph, x: Value) -> Value:
    """log(u) x / (u - 1) with u = 1 + x as rounded: the rounding of u cancels (Kahan)."""
    made, one = graph.real, graph.constant(1.0, "real")
    u = made("Add", one, x)
    return _over_unless_zero(graph, made("Mul", made("Log", u), x), made("Sub", u, one), x)


def _expm1(graph: Graph, x: Value) -> Value:
    """(u - 1) x / log(u) with u = exp(x) as rounded: the rounding of u cancels (Kahan)."""
    made, u = graph.real, graph.real("Exp", x)
    above = made("Mul", made("Sub", u, graph.constant(1.0, "real")), x)
    return _over_unless_zero(graph, above, made("Log", u), x)


def _over_unless_zero(graph: Graph, above: Value, below: Value, otherwise: Value) -> Value:
    none = graph.node("Equal", [below, graph.constant(0.0, "real")], "bool")
    return graph.real("Where", none, otherwise, graph.real("Div", above, below))


COMPOSED = {"asinh": _asinh, "log1p": _log1p, "expm1": _expm1}
"""Functions that ONNX lacks for double."""

DONE = "has returned"
"""A call's flag among its variables: no law can have a variable of this name."""


@dataclass(eq=False)
class Part:
    """An element with its parameters, and where its state lies among the variables."""

    home: Element
    parameters: dict[str, Any]
    key: int


Given = Value | Part | Callable[..., Value] | None
"""What a function takes: a value, a structure, a function."""


class Translator:
    """Functions of elements, written into a graph where they are called."""

    def __init__(self, graph: Graph):
        self.graph, self.frames = graph, 0

    def run(self, part: Part, home: Element, name: str, given: "list[Given]") -> Value:
        """The value that a function of an element returns."""
        owner = home if name in home.functions else home.borrowed(name)
        node = owner.functions[name]
        functions = {
            a.arg: a.arg for a in node.args.args if a.annotation and "Callable" in ast.unparse(a.annotation)
        }  # fmt: skip
        types = Function(owner, node, functions, {}).types
        return self.written(node, Frame(self, part, owner, types, 0), given)

    def written(self, node: ast.FunctionDef, frame: "Frame", given: "list[Given]") -> Value:
        """The value that a function returns, in a frame of its own."""
        self.frames += 1
        frame.number, types = self.frames, frame.types
        for argument, value in zip(node.args.args, given, strict=True):
            name, kind = argument.arg, types[argument.arg]
            if isinstance(value, Value):
                value = self.graph.cast(value, kind) if kind in ("real", "int") else value
                self.graph.variables[self.frames, name] = value
            else:
                frame.bound[name] = value
        frame.block(node.body[bool(ast.get_docstring(node)) :])
        returned = self.graph.variables.get((frame.number, "return"))
        self.graph.variables = {
            key: v for key, v in self.graph.variables.items() if key[0] != frame.number
        }
        return returned if returned is not None else self.graph.constant(0.0, "real")


@dataclass
class Frame:
    """One call: its variables are the graph's, under its number; functions and structures are `bound`, and
    names of the state's arrays are `arrays`."""

    translator: Translator
    part: Any
    home: Any
    types: dict[str, str]
    number: int
    bound: dict[str, Any] = field(default_factory=dict)
    arrays: dict[str, str] = field(default_factory=dict)

    @property
    def graph(self) -> Graph:
        """Into which it is written."""
        return self.translator.graph

    def _set(self, name: str, value: Value) -> None:
        self.graph.variables[self.number, name] = value

    @property
    def _done(self) -> Value | None:
        return self.graph.variables.get((self.number, DONE))

    # Statements

    def block(self, body: list[ast.stmt]) -> None:
        """Statements in order; after one that may have returned, the rest only if it did not."""
        for k, node in enumerate(body):
            self._statement(node)
            done = self._done
            if done is None or done.known is False or k + 1 == len(body):
                continue
            if done.known:
                return
            self.graph.branch(done, lambda: None, lambda rest=body[k + 1 :]: self._going_on(rest))
            return

    def _going_on(self, rest: list[ast.stmt]) -> None:
        # That nothing has returned is known here. Forgotten, it would be asked again behind each statement,
        # one branch in another: protobuf reads no more than 33 of them.
        self._set(DONE, self.graph.constant(False, "bool"))
        self.block(rest)

    def _statement(self, node: ast.stmt) -> None:
        graph = self.graph
        match node:
            case ast.Assign(
                targets=[ast.Name(id=name)], value=ast.Attribute(value=ast.Name(id=of), attr=array)
            ) if self._is_array(of, array):
                self.arrays[name] = array
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                made = self.value(value)
                kind = self.types.get(name, made.type)
                self._set(name, graph.cast(made, kind) if kind in TYPES else made)
            case ast.Assign(targets=[ast.Attribute(value=ast.Name(id=of), attr=name)], value=value):
                made, key = self.value(value), ("state", self.bound[of].key, name)
                graph.variables[key] = graph.cast(made, graph.variables[key].type)
            case ast.Assign(
                targets=[
                    ast.Subscript(value=ast.Attribute(attr=name) | ast.Name(id=name), slice=index)
                ],
                value=value,
            ):
                key = ("state", self.part.key, self.arrays.get(name, name))
                row = graph.constant(np.array([1]), "int")
                places = graph.node("Reshape", [self.value(index), row], "int")
                real = graph.cast(self.value(value), "real")
                update = graph.node("Reshape", [real, row], "reals")
                graph.variables[key] = graph.node(
                    "ScatterElements", [graph.variables[key], places, update], "reals", axis=0
                )
            case ast.Return(value=value):
                if value is not None:
                    made = self.value(value)
                    kind = "int" if made.type == "bool" else made.type
                    self._set("return", graph.cast(made, kind))
                self._set(DONE, graph.constant(True, "bool"))
            case ast.Expr(value=value):
                self.value(value)
            case ast.If(test=test, body=then, orelse=other):
                self._unsettled(node)
                graph.branch(self.value(test), lambda: self.block(then), lambda: self.block(other))
            case ast.While(test=test, body=body):
                self._unsettled(node)
                graph.loop(lambda: self._going(self.value(test)), lambda _: self.block(body))
            case ast.For(target=ast.Name(id=k), iter=ast.Call(args=ends), body=body):
                self._unsettled(node)
                values = [graph.cast(self.value(e), "int") for e in ends]
                first = values[0] if len(values) == 2 else graph.constant(0, "int")
                count = self._arithmetic(ast.Sub(), values[-1], first)

                def turned(turn: Value) -> None:
                    self._set(k, self._arithmetic(ast.Add(), turn, first))
                    self.block(body)

                always = graph.constant(True, "bool")
                graph.loop(lambda: self._going(always), turned, count)
            case _:
                raise self.home.law.refused(node)

    def _unsettled(self, node: ast.stmt) -> None:
        """A flag for whether a branch or loop has returned, where it can."""
        if self._done is None and any(isinstance(n, ast.Return) for n in ast.walk(node)):
            self._set(DONE, self.graph.constant(False, "bool"))

    def _going(self, test: Value) -> Value:
        done = self._done
        if done is None or done.known is False:
            return test
        return self._both("And", self.graph.cast(test, "bool"), self._not(done))

    # Expressions

    def given(self, node: ast.expr) -> Given:
        """What an argument is: a value, or a structure or a function where the name is one's."""
        match node:
            case ast.Name(id=name) if name in self.bound:
                return self.bound[name]
            case ast.Name(id=name) if not self._is_variable(name) and name in self.home.functions:
                return lambda *given: self.translator.run(self.part, self.home, name, list(given))
        return self.value(node)

    def _is_variable(self, name: str) -> bool:
        return (self.number, name) in self.graph.variables

    def _is_array(self, structure: str, name: str) -> bool:
        kind = self.part.home.structures["State"].get(name)
        return self.types.get(structure) == "State" and kind == "Reals"

    def value(self, node: ast.expr) -> Value:
        """A value of the graph."""
        graph = self.graph
        match node:
            case ast.Name(id=name) if name in self.arrays:
                return graph.variables["state", self.part.key, self.arrays[name]]
            case ast.Constant(value=bool() | int() as known):
                return graph.constant(int(known), "int")
            case ast.Constant(value=float() as known):
                return graph.constant(known, "real")
            case ast.Name(id=name) if self._is_variable(name):
                return graph.variables[self.number, name]
            case ast.Name(id=name):
                return self.value(ast.Constant(self.home.law.constant(name)))
            case ast.Attribute(value=ast.Name(id=name), attr=attribute):
                part = self.bound[name]
                if self.types.get(name) == "State":
                    return graph.variables["state", part.key, attribute]
                known = part.parameters[attribute]
                if isinstance(known, list):
                    return graph.constant(np.array(known or [0.0], float), "reals")
                kind = part.home.structures["Parameters"][attribute]
                return graph.constant(known, "int" if kind == "int" else "real")
            case ast.Subscript(value=array, slice=index):
                table, at = self.value(array), graph.cast(self.value(index), "int")
                # The trial run of a loop goes one step too far.
                if table.known is not None and at.known is not None and at.known < len(table.known):
                    return graph.constant(float(table.known[at.known]), "real")
                return graph.node("Gather", [table, at], "real", axis=0)
            case ast.UnaryOp(op=ast.Not(), operand=inner):
                return self._not(graph.cast(self.value(inner), "bool"))
            case ast.UnaryOp(operand=inner):
                value = self.value(inner)
                if value.known is not None:
                    return graph.constant(-value.known, value.type)
                return graph.node("Neg", [value], value.type)
            case ast.BinOp(left=left, op=op, right=right):
                return self._arithmetic(op, self.value(left), self.value(right))
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                return self._arithmetic(op, self.value(left), self.value(right))
            case ast.BoolOp(op=op, values=[first, *rest]):
                return self._short(isinstance(op, ast.And), first, rest)
            case ast.IfExp(test=test, body=yes, orelse=no):
                return self._either(
                    self.value(test), lambda: self.value(yes), lambda: self.value(no)
                )
            case ast.Call(func=ast.Name(id="int"), args=[inner]):
                return graph.cast(self.value(inner), "int")
            case ast.Call(func=ast.Name(id=name), args=arguments):
                return self._called(name, [self.given(a) for a in arguments])
        raise self.home.law.refused(node)

    def _called(self, name: str, given: "list[Given]") -> Value:
        graph = self.graph
        if name in self.bound:
            return self.bound[name](*given)
        if name not in MATHS:
            return self.translator.run(self.part, self.home, name, given)
        reals = [graph.cast(v, "real") for v in given if isinstance(v, Value)]
        if all(v.known is not None for v in reals):
            return graph.constant(getattr(math, name)(*(v.known for v in reals)), "real")
        if name in COMPOSED:
            return COMPOSED[name](graph, *reals)
        if name not in MATHEMATICS:
            raise InputError(
                "not-exportable", f"ONNX has no function {name}, which this model needs.",
                fix="export it to another target, as c or runtime.",
            )  # fmt: skip
        return graph.real(MATHEMATICS[name], *reals)

    def _arithmetic(self, op: ast.operator | ast.cmpop, a: Value, b: Value) -> Value:
        graph = self.graph
        name, compute = OPERATORS[type(op)]
        compared = isinstance(op, ast.cmpop)
        a, b = (graph.cast(v, "int") if v.type == "bool" else v for v in (a, b))
        kind = "real" if "real" in (a.type, b.type) or isinstance(op, ast.Div) else "int"
        a, b = graph.cast(a, kind), graph.cast(b, kind)
        if a.known is not None and b.known is not None:
            known = compute(a.known, b.known)
            return graph.constant(known, "bool" if compared else kind)
        found = graph.node(name, [a, b], "bool" if compared else kind)
        return self._not(found) if isinstance(op, ast.NotEq) else found

    def _not(self, value: Value) -> Value:
        if value.known is not None:
            return self.graph.constant(not value.known, "bool")
        return self.graph.node("Not", [value], "bool")

    def _both(self, operation: str, a: Value, b: Value) -> Value:
        neutral = operation == "And"
        for one, other in ((a, b), (b, a)):
            if one.known is not None:
                return other if bool(one.known) == neutral else one
        return self.graph.node(operation, [a, b], "bool")

    def _short(self, conjunction: bool, first: ast.expr, rest: list[ast.expr]) -> Value:
        """`and`, `or`: what is right of it is looked at only where it matters."""
        value = self.graph.cast(self.value(first), "bool")
        for k, node in enumerate(rest):
            if value.known is not None and bool(value.known) != conjunction:
                return value
            if any(isinstance(n, ast.Subscript | ast.Call) for n in ast.walk(node)):
                left = rest[k + 1 :]

                def more(node: ast.expr = node, left: list[ast.expr] = left) -> Value:
                    return self._short(conjunction, node, left)

                def same(value: Value = value) -> Value:
                    return value

                return self._either(value, *((more, same) if conjunction else (same, more)))
            right = self.graph.cast(self.value(node), "bool")
            value = self._both("And" if conjunction else "Or", value, right)
        return value

    def _either(self, test: Value, yes: Callable[[], Value], no: Callable[[], Value]) -> Value:
        self.translator.frames += 1
        key = (self.number, "chosen", self.translator.frames)

        def put(make: Callable[[], Value]) -> None:
            made = make()  # which may replace the variables
            self.graph.variables[key] = made

        self.graph.branch(test, lambda: put(yes), lambda: put(no))
        return self.graph.variables.pop(key)
