"""A compensator as one C99 header: no allocation, no recursion, nothing of libc but math.h."""

from typing import Any

from hysteresis._escape import visible
from hysteresis.laws._nodes import BESIDE, WITHOUT, Node
from hysteresis.laws._tree import around, parts_of

from ..inverses._law import goes_back_only
from ..runtime._status import Status
from ._band import band_in_c
from ._c99_nodes import NodeCount, NodeFunction, Nodes, called, size_of, state_in_c
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
from ._python_to_c99 import Element, comment, element, number

Tree = dict[str, Any]

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
        low, high = d["limits"]
        return HEAD.format(
            title=f"{visible(d['title'])}: {estimate} from {reading}.", stem=self.stem,
            stem_upper=self.stem.upper(),
            reading=reading, estimate=estimate, low=low, high=high,
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

    def _part(self, tree: Tree) -> Node:
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
