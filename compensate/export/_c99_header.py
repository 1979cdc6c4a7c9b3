"""A compensator as one C99 header: no allocation, no recursion, nothing of libc but math.h."""

from typing import Any, NamedTuple

from hysteresis._escape import visible
from hysteresis.laws._tree import begun, parts_of

from ..inverses._law import goes_back_only
from ..runtime._file import LONGEST
from ..runtime._status import Status
from . import _c99_adaptive
from ._band import band_in_c
from ._c99_state import size_of, state_in_c
from ._cost import cost
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

AROUND = 60
"""Operations of a step around its nodes."""


class _Part(NamedTuple):
    """A node of the tree: its number, its inner nodes, and what its functions cost."""

    tree: Tree
    number: int
    inner: "tuple[_Part, ...]"
    cost: dict[str, int]


def header(document: dict[str, Any], stem: str, *, single: bool) -> str:
    """The text of `stem`.h, from the document that `compensate.runtime` loads."""
    return _Header(document, stem, single).text()


class _Header:
    def __init__(self, document: dict[str, Any], stem: str, single: bool):
        self.document, self.stem, self.single = document, stem, single
        self.real = f"{stem}_real"
        self.elements: dict[str, Element] = {}
        self.parts: list[_Part] = []
        self.root = self._part(document["tree"])
        self.error = document["error"] and self._part(document["error"])
        self.guard = document["guard"] and self._part(document["guard"])
        self.others = [
            self._part(begun(document["tree"], iter(states))) for states in document["starts"]
        ]
        self.condition: dict[str, Any] | None = document.get("condition")
        learns = self.root.tree["kind"] == "adaptive"
        self._learns = self.elements["adaptive"] if learns else None
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
            *(self._constants(part) for part in self.parts if "parameters" in part.tree),
            state_in_c(
                self.parts,
                self.elements,
                self.stem,
                self._number(self.document["start"], "real"),
                self._list,
                self._number,
            ),
            *(self._functions(part) for part in self.parts),
            self._step(),
            band_in_c(self.document, stem, self.real, self.single),
            self._learns and _c99_adaptive.called(self._learns, self.root.number, self.document),
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
            unknown="" if self.error else ", which is not known here: NaN", motions=motions(d),
            time=clock(d, self.stem),
            real="float" if self.single else "double",
            state=size_of(self.parts, self.elements, self.single),
            predict=f"{self.stem}_predict is the model itself, on the same state." if self.predicts else "",
            tables=self._tables() * (4 if self.single else 8),
            bound=f"{self._bound():,}", operations=spent(d),
            trained=trained(d, self.stem), origin=origin(d),
            held="condition, " if self.condition else "", condition=condition(d, self.stem),
        )  # fmt: skip

    def _bound(self) -> int:
        """Operations of a step, at most."""
        whole = self.root, self.error, self.guard, *self.others
        return sum(p.cost["find"] for p in whole if p) + AROUND

    # Elements and their constants

    def _part(self, tree: Tree) -> _Part:
        inner = tuple(self._part(part) for part in parts_of(tree))
        kind = tree["kind"]
        if kind != "series" and kind not in self.elements:
            self.elements[kind] = element(kind, self.stem, self.single)
        part = _Part(
            tree, len(self.parts), inner, cost(tree, [i.cost for i in inner], self.elements)
        )
        self.parts.append(part)
        return part

    def _element(self, kind: str) -> str:
        home = self.elements[kind]
        states = [part.tree["state"] for part in self.parts if part.tree["kind"] == kind]
        lengths = {
            k: max(len(s[k]) for s in states) for k, v in states[0].items() if isinstance(v, list)
        }
        about = comment(f"---- {home.about}", "")
        return "\n\n".join(
            [
                about,
                home.structure("Parameters"),
                home.structure("State", lengths),
                home.translated(),
            ]
        ).rstrip()

    def _constants(self, part: _Part) -> str:
        home, place = self.elements[part.tree["kind"]], f"{self.stem}_{part.number}"
        own = part.tree["parameters"]
        first = next(p.number for p in self.parts if p.tree.get("parameters") is own)
        if first != part.number:  # the same parameters with another memory
            return f"#define {place} {self.stem}_{first}"
        lines, fields = [], []
        for key, kind in home.structures["Parameters"].items():
            value = part.tree["parameters"][key]
            if kind == "Reals":
                lines.append(
                    f"static const {self.real} {place}_{key}[{max(len(value), 1)}]"
                    f" {self.stem.upper()}_TABLE = {self._list(value)};"
                )
                fields.append(f"    {place}_{key},")
            else:
                fields.append(f"    {self._number(value, kind)}, /* {key} */")
        lines.append(
            f"static const {home.prefix}_parameters {place} = {{\n" + "\n".join(fields) + "\n};"
        )
        return "\n".join(lines)

    def _number(self, value: float | None, kind: str) -> str:
        if value is None:
            return f"({self.real})NAN"
        return str(int(value)) if kind == "int" else number(value, self.single)

    def _list(self, values: list[float] | list[float | None]) -> str:
        words = [self._number(v, "real") for v in values] or ["0"]
        rows = [", ".join(words[k : k + 6]) for k in range(0, len(words), 6)]
        if len(rows) == 1:
            return f"{{{rows[0]}}}"
        return "{\n    " + ",\n    ".join(rows) + "\n}"

    def _tables(self) -> int:
        own = {id(p): p for part in self.parts if (p := part.tree.get("parameters")) is not None}
        return sum(len(v) if isinstance(v, list) else 1 for p in own.values() for v in p.values())

    # Functions of the nodes

    def _functions(self, part: _Part) -> str:
        kind, k = part.tree["kind"], part.number
        if kind == "sum":
            return self._sum(part)
        if kind == "adaptive":
            return self._adaptive(part)
        bodies: dict[str, list[str]] = {}
        if kind == "series":
            walk = [f"    value = {self._call(i, 'look')};" for i in part.inner]
            bodies["look"] = [*walk, "    return value;"]
            bodies["move"] = [line.replace("_look", "_move") for line in bodies["look"]]
            if "find" in part.cost:
                bodies["find"] = [f"    s->n{k}.status = {self.stem.upper()}_OK;"]
                for i in reversed(part.inner):
                    bodies["find"] += [
                        f"    value = {self._call(i, 'find')};",
                        f"    if (s->n{k}.status == {self.stem.upper()}_OK) {{",
                        f"        s->n{k}.status = s->n{i.number}.status;", "    }",
                    ]  # fmt: skip
                bodies["find"].append("    return value;")
        elif part.inner:
            bodies = self._wrapped(part)
        else:
            home = self.elements[kind]
            for name in ("look", "move", "follow", "find"):
                if name in home.functions:
                    dt = "dt, " if home.law.takes_time(name) else ""
                    call = f"{home.prefix}_{name}(&{self.stem}_{k}, &s->n{k}, {dt}value);"
                    bodies[name] = [f"    {call}" if name == "follow" else f"    return {call}"]
        return "\n\n".join(self._function(k, name, body) for name, body in bodies.items())

    def _wrapped(self, part: _Part) -> dict[str, list[str]]:
        (i,), k = part.inner, part.number
        place, prefix = f"&{self.stem}_{k}", f"{self.stem}_{part.tree['kind']}"
        if part.tree["kind"] == "share":
            return {
                name: [f"    return {prefix}_weighted(&s->n{k}, {self._call(i, name)});"]
                for name in ("look", "move")
            }
        found = self._call(i, "find", f"{prefix}_back({place}, value)")
        kept = f"    s->n{k}.status = s->n{i.number}.status;"
        bodies = {
            name: [f"    return {prefix}_onward({place}, {self._call(i, name)});"]
            for name in ("look", "move")
        }
        return bodies | {"find": [f"    value = {found};", kept, "    return value;"]}

    def _sum(self, part: _Part) -> str:
        k, home, done = part.number, self.elements["sum"], {}
        both = {
            name: ["    return " + " + ".join(self._call(i, name) for i in part.inner) + ";"]
            for name in ("look", "move")
        }
        given = {"look": f"{self.stem}_{k}_look", "whole": f"{self.stem}_state"}
        search = home.specialised("search", given, done)
        found = [
            f"    value = {search}(&{self.stem}_{k}, &s->n{k}, s, dt, value);",
            *(
                f"    {self._call(i, 'follow')};" if "follow" in i.cost
                else f"    (void){self._call(i, 'move')};" for i in part.inner
            ),
            "    return value;",
        ]  # fmt: skip
        looks = [self._function(k, name, body) for name, body in both.items()]
        return "\n\n".join([*looks, *done.values(), self._function(k, "find", found)])

    def _adaptive(self, part: _Part) -> str:
        k, home, done = part.number, self.elements["adaptive"], {}
        calls = [self._call(i, "look") for i in part.inner[:-1]]
        bodies = _c99_adaptive.bodies(home, self.stem, k, calls)
        found = _c99_adaptive.find(home, self.stem, k, part.inner[-1].number, done)
        looks = [self._function(k, name, body) for name, body in bodies.items()]
        return "\n\n".join([*looks, *done.values(), self._function(k, "find", found)])

    def _call(self, part: _Part, name: str, value: str = "value") -> str:
        return f"{self.stem}_{part.number}_{name}(s, dt, {value})"

    def _function(self, k: int, name: str, body: list[str]) -> str:
        stem, real = self.stem, self.real
        given = "void" if name == "follow" else real
        head = f"static inline {given} {stem}_{k}_{name}({stem}_state *s, {real} dt, {real} value)"
        uses = "\n".join(body)
        spare = [
            f"    (void){v};"
            for v in ("s", "dt")
            if f"{v}," not in uses and f"{v}->" not in uses and f"({v}" not in uses
        ]
        return "\n".join([head, "{", *spare, *body, "}"])

    # What is called from outside

    def _step(self) -> str:
        stem, upper, real, k = self.stem, self.stem.upper(), self.real, self.root.number
        low, high = (self._number(v, "real") for v in self.document["limits"])
        zero, rates = self._number(0, "real"), self.document["rates"]
        longest = self._number(self.document.get("longest") or LONGEST, "real") if rates else ""
        # Not !(dt <= 0): a dt that is NaN is no time.
        passing = f"""\
    if (dt > {zero}) {{
        s->waited += dt;
        if (s->waited > {longest}) {{
            s->waited = {longest};
        }}
    }}
""" if rates else "    (void)dt;\n"  # fmt: skip
        held = f"{real} condition, " if self.condition else ""
        takes = "".join(
            f"\n        (void){stem}_share_take(&{stem}_{p.number}, &s->n{p.number}, condition);"
            for p in self.parts if p.tree["kind"] == "share"
        )  # fmt: skip
        usable = "isfinite(reading)" + (" && isfinite(condition)" if held else "")
        beyond = "seen != reading" + (f" || passed >= {longest}" if rates else "")
        if self.condition:
            first, last = (self._number(self.condition[end], "real") for end in ("low", "high"))
            beyond += f" || condition < {first} || condition > {last}"
        e = self.error.number if self.error else 0
        deviation = (
            f"\n    s->deviation = {stem}_error_deviation(&{stem}_{e}, &s->n{e}, passed, s->estimate);"
            if self.error else ""
        )  # fmt: skip
        text = f"""\
/* One reading in, one estimate and its deviation out; what it is worth is returned. */
static inline int {stem}_step(
    {stem}_state *s, {real} dt, {real} reading, {held}{real} *estimate, {real} *deviation)
{{
    int status = {upper}_INVALID;
{passing}    if ({usable}) {{
        {real} seen = reading < {low} ? {low} : reading;
        if (seen > {high}) {{
            seen = {high};
        }}
        {real} passed = s->begun ? s->waited : {zero};{takes}
        s->estimate = {stem}_{k}_find(s, passed, seen);
        int beyond = {beyond};
        s->waited = {zero};
        s->begun = 1;{deviation.replace(chr(10), chr(10) + "    ")}
{self._guarded()}
    }}
    *estimate = s->estimate;
    if (deviation) {{
        *deviation = s->deviation;
    }}
    return status;
}}"""
        if not self.predicts:
            return text
        nearest, farthest = (self._number(v, "real") for v in self.document["inputs"])
        others = "".join(
            f"\n    (void){stem}_{other.number}_move(s, passed, input);" for other in self.others
        )
        return f"""{text}

/* The model itself: an input in, the reading it gives out. NaN for an input that is not finite, which
 * changes nothing; one far beyond the trained ones is taken for the nearer end. */
static inline {real} {stem}_predict(
    {stem}_state *s, {real} dt, {real} input{held and f", {real} condition"})
{{
{passing}    if (!isfinite(input){" || !isfinite(condition)" if held else ""}) {{
        return ({real})NAN;
    }}
    if (input < {nearest}) {{
        input = {nearest};
    }}
    if (input > {farthest}) {{
        input = {farthest};
    }}
    s->estimate = input;{takes.replace("        (", "    (")}
    {real} passed = s->begun ? s->waited : {zero};
    {real} reading = {stem}_{k}_move(s, passed, input);{others}
    s->waited = {zero};
    s->begun = 1;
    return reading;
}}"""

    def _guarded(self) -> str:
        """The status, and the estimate as it is given out."""
        stem, upper, k = self.stem, self.stem.upper(), self.root.number
        if not self.guard:
            return f"""\
        status = s->n{k}.status;
        if (beyond && (status == {upper}_OK || status == {upper}_FLAT)) {{
            status = {upper}_EXTRAPOLATED;
        }}"""
        g, real, size = self.guard.number, self.real, "fabsf" if self.single else "fabs"
        away = "".join(
            f"""\
        {{
            {real} away = {size}({stem}_{other.number}_find(s, passed, seen) - s->estimate);
            apart = away > apart ? away : apart;
        }}
"""
            for other in self.others
        )
        text = f"""\
        {real} apart = {self._number(0, "real")}; /* of the estimates that began elsewhere */
{away}        s->estimate = {stem}_guard_limited(
            &{stem}_{g}, &s->n{g}, s->estimate, s->n{k}.status, beyond, apart, reading);
        status = s->n{g}.status;"""
        if self.guard.tree["beyond"] != "nan":
            return text
        return f"""{text}
        if (s->n{g}.beyond) {{
            s->estimate = ({self.real})NAN;
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
