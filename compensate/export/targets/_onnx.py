"""One step of a compensator as an ONNX model: reading and state in, estimate and state out."""

import ast
import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hysteresis import InputError
from hysteresis._files import write_whole
from hysteresis.laws._nodes import WITHOUT, Node, function_of
from hysteresis.laws._tree import around

from ...runtime._status import Status
from .._export import Exported, Program
from .._python_to_c99 import element
from ._artefact import Artefact, name_in_c
from ._onnx_graph import Graph, Value
from ._python_to_onnx import Frame, Part, Translator

if TYPE_CHECKING:
    from onnx import ModelProto

OPSET, IR = 17, 8
"""Versions that runtimes have read since 2022."""

Tree = dict[str, Any]


def onnx(program: Program, out: Path, real: str) -> Exported:
    """Write a model of one step, with the initial state and the facts of the fit as its metadata."""
    try:
        import onnx as package  # an extra
    except ImportError:
        raise InputError(
            "missing-extra",
            "The target onnx needs the package onnx, which is not installed.",
            fix='pip install "hysid[onnx]"',
        ) from None
    made = Artefact(program, name_in_c(out), real)
    step = _Step(made.document, Graph(package))
    model = step.model(made.stem)
    facts = {"initial_state": step.initial, "hysid-export.json": made.document}
    facts["statuses"] = {int(s): s.name for s in Status}
    package.helper.set_model_props(model, {name: json.dumps(x) for name, x in facts.items()})
    package.checker.check_model(model, full_check=True)
    write_whole(out, model.SerializeToString(deterministic=True))
    return Exported(out, (*program.notes, *made.notes))


class _Step:
    def __init__(self, document: Tree, graph: Graph):
        self.document, self.graph, self.write = document, graph, Translator(graph)
        self.initial: list[float] = []
        self._places: list[tuple[tuple[Any, ...], str, int, int]] = []
        self.count = 0
        self.nodes: list[Node] = []
        self.around = self._node(around(document))

    # The model

    def model(self, title: str) -> "ModelProto":
        """The graph around the step."""
        graph, helper = self.graph, self.graph.onnx.helper
        inputs = [Value(n, "real") for n in ("dt", "reading", "condition")]
        self._unpack(Value("state", "reals"))
        condition = inputs[2]
        if not self.document["condition"]:
            condition = graph.constant(0.0, "real")
            del inputs[2]
        step = f"step_{self.around.number}"
        outputs = {"estimate": self._called(step, None, *inputs[:2], condition)}
        for name in ("deviation", "status"):
            outputs[name] = graph.variables["state", self.around.of.key, name]
        outputs["next_state"] = self._packed()
        found = []
        for label, value in outputs.items():
            node = helper.make_node("Identity", [graph.name(value)], [label])
            graph.blocks[0].append(node)
            found.append(graph.information(Value(label, value.type)))
        from_array, double = graph.onnx.numpy_helper.from_array, graph.onnx.TensorProto.DOUBLE
        constants = [from_array(array, key) for key, array in graph.constants.values()]
        vector = helper.make_tensor_value_info("state", double, [len(self.initial)])
        given = [*map(graph.information, inputs), vector]
        whole = helper.make_graph(graph.blocks[0], title, given, found, constants)
        opsets = [helper.make_opsetid("", OPSET)]
        return helper.make_model(whole, opset_imports=opsets, ir_version=IR, producer_name="hysid")

    # The state

    def _unpack(self, state: Value) -> None:
        graph = self.graph
        for key, kind, first, count in self._places:
            if kind == "reals":
                at = graph.constant(np.arange(first, first + count), "int")
                graph.variables[key] = graph.node("Gather", [state, at], "reals", axis=0)
                continue
            one = graph.node("Gather", [state, graph.constant(first, "int")], "real", axis=0)
            graph.variables[key] = graph.cast(one, kind)

    def _packed(self) -> Value:
        graph = self.graph
        row = graph.constant(np.array([-1]), "int")
        values = [(graph.variables[key], kind) for key, kind, _, _ in self._places]
        flat = [
            v if kind == "reals" else graph.node("Reshape", [graph.cast(v, "real"), row], "reals")
            for v, kind in values
        ]
        return graph.node("Concat", flat, "reals", axis=0)

    # The nodes of the tree

    def _part(self, tree: Tree) -> Part:
        known = {k: float("nan") if v is None else v for k, v in tree["parameters"].items()}
        part = Part(element(tree["kind"], "x", False), known, self.count)
        self.count += 1
        for name, kind in part.home.structures["State"].items():
            value = tree["state"][name]
            values = (value or [0.0]) if kind == "Reals" else [value]
            place = ("state", part.key, name), kind.lower(), len(self.initial), len(values)
            self._places.append(place)
            self.initial += [float("nan") if v is None else float(v) for v in values]
        return part

    def _node(self, tree: Tree) -> Node:
        kind, inner = tree["kind"], tuple(self._node(one) for one in tree.get("parts", ()))
        if kind == "adaptive":
            raise InputError(
                "not-exportable", f"The target onnx has no element {kind!r}.",
                fix="Export a compensator that does not recalibrate itself.",
            )  # fmt: skip
        part = None if kind == WITHOUT else self._part(tree)
        self.nodes.append(Node(kind, len(self.nodes), inner, part))
        return self.nodes[-1]

    def _called(self, title: str, *given: Any) -> Value:
        """A function of a node, or of a law with its structures, by its name in the text of the nodes."""
        _, of_law, function = title.rpartition("__")
        if of_law:
            part = next(x for x in given if isinstance(x, Part))
            return self.write.run(part, part.home, function, list(given))
        name, _, number = title.rpartition("_")
        (node,) = ast.parse(function_of(self.nodes[int(number)], name)).body
        assert isinstance(node, ast.FunctionDef)
        frame = Frame(
            self.write, None, None, {"s": "Any", "dt": "real", "x": "real", "c": "real"}, 0
        )
        for name in {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}:
            if name[1:].isdecimal():
                frame.types[name] = "Parameters" if name[0] == "p" else "State"
                frame.bound[name] = self.nodes[int(name[1:])].of
            elif "_" in name:
                frame.bound[name] = partial(self._called, name)
        return self.write.written(node, frame, list(given))
