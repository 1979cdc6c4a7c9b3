"""A compensator as one C99 header: no allocation, no recursion, nothing of libc but math.h."""

import ast
import ctypes
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

from hysteresis import InputError
from hysteresis._escape import visible
from hysteresis._format import ends
from hysteresis.laws._nodes import AROUND, BESIDE, WITHOUT, Node, function_of
from hysteresis.laws._tree import Tree, around, parts_of

from .._readings import nested
from ..guards._guarded import GuardedCompensator
from ..inverses._law import goes_back_only
from ..runtime._status import Status
from ..uncertainty._calibrated import CalibratedCompensator
from ..uncertainty._ensemble import EnsembleCompensator
from ..uncertainty._guaranteed import Guaranteed
from ._header_facts import (
    HEAD,
    STATUSES,
    clock,
    condition,
    facts,
    motions,
    origin,
    quantity,
    spent,
    tables,
    trained,
)
from ._operation_count import OF_A_NODE, Count
from ._python_to_c99 import Element, Expression, Function, comment, element, number

# The functions of a tree's nodes in C, and what they cost at most.

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


# The error of a compensator in the document, and its guaranteed band, there and as a function in C.


def banded(band: Guaranteed, error: CalibratedCompensator | None) -> Tree:
    """What a document holds of a band.

    Raises `InputError` `not-exportable` where its shape is a deviation that the file does not have.
    """
    inner = next(x for x in nested(band.compensator) if not isinstance(x, GuardedCompensator))
    by_deviation = isinstance(inner, CalibratedCompensator)
    unknown = by_deviation and (error is None or not _alike(inner, error))
    if unknown or isinstance(inner, EnsembleCompensator) or getattr(inner, "deviates", False):
        raise InputError(
            "not-exportable",
            "The shape of this band is a deviation that the file does not have.",
            fix="give the same `calibrated` compensator as `error` and to `guaranteed`, or one without.",
        )
    return {
        "factor": band.factor, "guarantee": band.guarantee, "runs": band.runs, "by_deviation": by_deviation,
    }  # fmt: skip


def _alike(one: CalibratedCompensator, other: CalibratedCompensator) -> bool:
    pairs = ((one.levels, other.levels), (one.error, other.error))
    return all(a.shape == b.shape and bool((a == b).all()) for a, b in pairs)


def band_in_c(document: Tree, stem: str, real: str, single: bool) -> str:
    """The function that gives the band of the last estimate; nothing where there is no band."""
    if not (band := document.get("band")):
        return ""
    by = " * s->last.deviation" if band["by_deviation"] else ""
    return f"""\
/* The band of the last estimate: a new run lies within its bands over its whole length with a probability
 * of {100 * band["guarantee"]:g} per cent or more, if it is exchangeable with the {band["runs"]}
 * runs of the calibration. */
static inline void {stem}_band(const {stem}_state *s, {real} *low, {real} *high)
{{
    {real} half = {number(band["factor"], single)}{by};
    *low = s->last.value - half;
    *high = s->last.value + half;
}}"""


TreeText = dict[str, Any]

STANDARD = frozenset({
    "assert", "complex", "ctype", "errno", "fenv", "float", "inttypes", "iso646", "limits", "locale",
    "math", "setjmp", "signal", "stdarg", "stdbool", "stddef", "stdint", "stdio", "stdlib", "string",
    "tgmath", "time", "wchar", "wctype",
})  # fmt: skip
"""Headers of C99 itself, which a header of such a name hides from the compiler."""

OUTPUTS = 20
"""Operations of a step that hand out what its nodes have found."""


def header(document: dict[str, Any], stem: str, *, single: bool) -> str:
    """The text of `stem`.h, from the document that `compensate.runtime` loads."""
    return _Header(document, stem, single).text()


class _Header:
    def __init__(self, document: dict[str, Any], stem: str, single: bool):
        self.document, self.stem, self.single = document, stem, single
        self.real = f"{stem}_real"
        self.elements: dict[str, Element] = {}
        self.parts: list[Node] = []
        self.around = self._part(around(document))
        self.nodes = Nodes(self.parts, self.elements)
        self.root, *others = self.around.parts
        self.others = [part for part in others if part.kind not in BESIDE]
        self.condition: dict[str, Any] | None = document.get("condition")
        self._learns = self.elements["adaptive"] if self.root.kind == "adaptive" else None
        self.predicts = not goes_back_only(document["tree"])

    def text(self) -> str:
        stem, upper = self.stem, self.stem.upper()
        enum = "\n".join(f"    {upper}_{s.name} = {s.value}, /* {STATUSES[s]} */" for s in Status)
        sections = [
            comment(self._about(), ""),
            f"#ifndef {upper}_H\n#define {upper}_H\n\n#include <math.h>",
            f"typedef {'float' if self.single else 'double'} {self.real};\n\n{tables(upper)}",
            f"enum {stem}_status {{\n{enum}\n}};",
            facts(self.document, stem, lambda value: self._number(value, "real")),
            *(self._element(kind) for kind in self.elements),
            *(self._constants(part) for part in self.parts if "parameters" in part.of),
            state_in_c(self.nodes, self._list, self._number),
            self._functions(),
            self._step(),
            band_in_c(self.document, stem, self.real, self.single),
            self._learns and called(self._learns, self.root.number, self.document),
            self._self_test(),
            f"#endif /* {upper}_H */\n",
        ]
        return "\n\n".join(section for section in sections if section)

    def _about(self) -> str:
        d = self.document
        reading, estimate = map(quantity, (d["reading"], d["estimate"]))
        return HEAD.format(
            title=f"{visible(d['title'])}: {estimate} from {reading}.", stem=self.stem,
            stem_upper=self.stem.upper(),
            reading=reading, estimate=estimate, limits=ends(*d["limits"], digits=6),
            unknown="" if self.document["error"] else ", which is not known here: NaN", motions=motions(d),
            time=clock(d, self.stem),
            real="float" if self.single else "double",
            state=size_of(self.nodes),
            predict=f"{self.stem}_predict is the model itself, on the same state." if self.predicts else "",
            tables=self._tables() * (4 if self.single else 8),
            bound=f"{self._bound():,}", operations=spent(d),
            trained=trained(d, self.stem), origin=origin(d),
            held="condition, " if self.condition else "", condition=condition(d, self.stem),
        )  # fmt: skip

    def _bound(self) -> int:
        """Operations of a step, at most."""
        return NodeCount(self.nodes).of_function(f"step_{self.around.number}") + OUTPUTS

    # Elements and their constants

    def _part(self, tree: TreeText) -> Node:
        inner = tuple(self._part(part) for part in parts_of(tree))
        kind = tree["kind"]
        if kind != WITHOUT and kind not in self.elements:
            self.elements[kind] = element(kind, self.stem, self.single)
        self.parts.append(Node(kind, len(self.parts), inner, tree))
        return self.parts[-1]

    def _element(self, kind: str) -> str:
        home = self.elements[kind]
        states = [part.of["state"] for part in self.parts if part.kind == kind]
        lengths = {
            k: max(len(s[k]) for s in states) for k, v in states[0].items() if isinstance(v, list)
        }
        texts = [comment(f"---- {home.about}", ""), home.structure("Parameters")]
        texts += [home.structure("State", lengths), home.translated()]
        return "\n\n".join(texts).rstrip()

    def _constants(self, part: Node) -> str:
        home, place = self.elements[part.kind], f"{self.stem}_{part.number}"
        own = part.of["parameters"]
        first = next(p.number for p in self.parts if p.of.get("parameters") is own)
        if first != part.number:  # the same parameters with another memory
            return f"#define {place} {self.stem}_{first}"
        lines, fields = [], []
        for key, kind in home.structures["Parameters"].items():
            value = own[key]
            if kind == "Reals":
                table = f"{place}_{key}[{max(len(value), 1)}] {self.stem.upper()}_TABLE"
                lines.append(f"static const {self.real} {table} = {self._list(value)};")
                fields.append(f"    {place}_{key},")
            else:
                fields.append(f"    {self._number(value, kind)}, /* {key} */")
        head = f"static const {home.prefix}_parameters {place} = {{"
        return "\n".join([*lines, head, *fields, "};"])

    def _number(self, value: float | None, kind: str) -> str:
        if value is None:
            return f"({self.real})NAN"
        return str(int(value)) if kind == "int" else number(value, self.single)

    def _list(self, values: list[float] | list[float | None]) -> str:
        words = [self._number(v, "real") for v in values] or ["0"]
        rows = [", ".join(words[k : k + 6]) for k in range(0, len(words), 6)]
        return f"{{{rows[0]}}}" if len(rows) == 1 else "{\n    " + ",\n    ".join(rows) + "\n}"

    def _tables(self) -> int:
        own = {id(p): p for part in self.parts if (p := part.of.get("parameters")) is not None}
        return sum(len(v) if isinstance(v, list) else 1 for p in own.values() for v in p.values())

    def _functions(self) -> str:
        """Of the nodes: what a step and a prediction call, and what those call."""
        done: dict[str, str] = {}
        moves = [f"move_{part.number}" for part in (self.root, *self.others)] * self.predicts
        for name in (f"step_{self.around.number}", *moves):
            NodeFunction(self.nodes, name, done).translate()
        return "\n\n".join(done.values())

    # What is called from outside

    def _step(self) -> str:
        stem, real, k = self.stem, self.real, self.around.number
        held = f"{real} condition, " if self.condition else ""
        text = f"""\
/* One reading in, one estimate and its deviation out; what it is worth is returned. */
static inline int {stem}_step(
    {stem}_state *s, {real} dt, {real} reading, {held}{real} *estimate, {real} *deviation)
{{
    *estimate = {stem}_{k}_step(s, dt, reading, {"condition" if held else self._number(0, "real")});
    if (deviation) {{
        *deviation = s->last.deviation;
    }}
    return s->last.status;
}}"""
        if not self.predicts:
            return text
        nearest, farthest = (self._number(v, "real") for v in self.document["inputs"])
        others = "".join(
            f"\n    (void){stem}_{other.number}_move(s, passed, input);" for other in self.others
        )
        takes = "".join(
            f"\n    (void){stem}_share_take(&{stem}_{p.number}, &s->n{p.number}, condition);"
            for p in self.parts if p.kind == "share"
        )  # fmt: skip
        return f"""{text}

/* The model itself: an input in, the reading it gives out. NaN for an input that is not finite, which
 * changes nothing; one far beyond the trained ones is taken for the nearer end. */
static inline {real} {stem}_predict(
    {stem}_state *s, {real} dt, {real} input{held and f", {real} condition"})
{{
    (void){stem}_reading_wait(&{stem}_{k}, &s->last, dt);
    if (!isfinite(input){" || !isfinite(condition)" if held else ""}) {{
        return ({real})NAN;
    }}
    if (input < {nearest}) {{
        input = {nearest};
    }}
    if (input > {farthest}) {{
        input = {farthest};
    }}
    s->last.value = input;{takes}
    {real} passed = {stem}_reading_begin(&s->last);
    {real} reading = {stem}_{self.root.number}_move(s, passed, input);{others}
    return reading;
}}"""

    def _self_test(self) -> str:
        stem, real, golden = self.stem, self.real, self.document["golden"]
        n, rates = len(golden["reading"]), self.document["rates"]
        given = ["dt"] * rates + ["reading"] + ["condition"] * bool(self.condition) + ["value"]
        at = f"{stem.upper()}_AT"
        passed = "" if rates else f"{self._number(0, 'real')}, "
        passed += "".join(f"{at}({name}, k), " for name in given[:-1])
        arrays = "\n".join(
            f"    static const {real} {k}[{n}] {stem.upper()}_TABLE = {self._list(golden[k])};"
            for k in given
        )
        tolerance = number(golden["tolerance"] * (1e6 if self.single else 1.0), self.single)
        wrong = f"!(fabs{'f' if self.single else ''}(estimate - {at}(value, k)) <= {tolerance})"
        if None in golden["value"]:
            wrong = f"isnan({at}(value, k)) ? !isnan(estimate) : {wrong}"
        return f"""\
/* How many of {n} readings give another estimate than where this file was made; the state is reset. */
static inline int {stem}_self_test({stem}_state *s)
{{
{arrays}
    int wrong = 0;
    {stem}_reset(s);
    for (int k = 0; k < {n}; ++k) {{
        {real} estimate;
        (void){stem}_step(s, {passed}&estimate, 0);
        if ({wrong}) {{
            ++wrong;
        }}
    }}
    {stem}_reset(s);
    return wrong;
}}"""
