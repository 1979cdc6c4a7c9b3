"""How the nodes of a tree are put together: functions in the language of the laws, written of any tree.

    def find_2(s, dt, x):
        x = find_1(s, dt, x)
        return line__find(p0, s0, x)

`look_k`, `move_k`, `follow_k` and `find_k` of node k do what those of a law do, of which `line__find` is
one; `pk` and `sk` are the node's parameters and state. `status_k` is the worth of the last estimate. `s` is
what holds all states, where a language needs it.
"""

import inspect
from typing import Any, NamedTuple

from . import module_of
from ._codes import INVALID, OK

WITHOUT = "series"
"""The kind of node that has no law of its own."""


AROUND = "reading"
"""The kind of the node around a tree, the same trees that begin elsewhere, its error and its guard."""

BESIDE = ("error", "guard")
"""Kinds that are no trees."""


class Node(NamedTuple):
    """A node, its number, its parts, and what a language knows of it."""

    kind: str
    number: int
    parts: tuple["Node", ...]
    of: Any = None

    def all(self) -> "list[Node]":
        """Parts before their whole."""
        return [*(one for part in self.parts for one in part.all()), self]


def functions_of(root: Node) -> str:
    """The text of all functions of a tree."""
    return "\n".join(function_of(node, name) for node in root.all() for name in _names(node))


def _names(node: Node) -> list[str]:
    if node.kind == AROUND:
        return ["step"]
    if node.kind in BESIDE:
        return []
    if node.kind == "feedback":
        return ["inner", "find", "status"]
    if node.parts:
        learning = ["inner", "followed"] if node.kind == "adaptive" else []
        return ["look", "move", "find", "status", *learning]
    known = [name for name in ("look", "move", "follow", "find") if _arguments(node.kind, name)]
    return [*known, "status"]


def function_of(node: Node, name: str) -> str:
    """The text of one function of a node."""
    given, returns = "s: Any, dt: float, x: float", "float"
    if name == "status":
        given, returns = "s: Any", "int"
    if name == "step":
        given += ", c: float"
    lines = _body(node, name)
    if name == "follow":
        returns = "None"
    head = f"def {name}_{node.number}({given}) -> {returns}:"
    return "\n    ".join([head, *lines])


def _body(node: Node, name: str) -> list[str]:
    kind, parts, p, s = node.kind, node.parts, f"p{node.number}", f"s{node.number}"

    def own(function: str, *given: str) -> str:
        return f"{kind}__{function}({', '.join(given)})"

    match kind, name:
        case (_, "step"):
            return _step(node, p, s)
        case ("series", "status"):
            later = [
                x for part in parts[-2::-1] for x in (f"if y == {OK}:", f"    y = {_status(part)}")
            ]
            return [f"y = {_status(parts[-1])}", *later, "return y"]
        case (_, "status"):
            return [f"return {_status(parts[0]) if kind in ('scaled', 'share') else f'{s}.status'}"]
        case ("series", _):
            order = parts[::-1] if name == "find" else parts
            return [*(f"x = {_call(part, name)}" for part in order), "return x"]
        case ("scaled", "find"):
            return [f"return {_call(parts[0], name, own('back', p, 'x'))}"]
        case ("scaled", _):
            return [f"return {own('onward', p, _call(parts[0], name))}"]
        case ("share", "look"):  # what weighs nothing is not looked at
            return [f"return {own('weighted', s, _call(parts[0], name))} if {s}.share else 0.0"]
        case ("share", _):
            return [f"return {own('weighted', s, _call(parts[0], name))}"]
        case ("sum", "find"):
            found = own("search", f"look_{node.number}", p, s, "s", "dt", "x")
            return [f"x = {found}", *(_call(part, _follows(part)) for part in parts), "return x"]
        case ("sum", _):
            return [f"return {' + '.join(_call(part, name) for part in parts)}"]
        case ("adaptive", _):
            return _adaptive(node, name, p, s)
        case ("feedback", "find"):
            return [f"return {own('find', f'inner_{node.number}', p, s, 's', 'dt', 'x')}"]
        case ("feedback", _):  # the channels look at their drives, or move there
            return [
                *(own("taken", p, s, str(i), _channel(part, own("drive", p, s, str(i))))
                  for i, part in enumerate(parts)),
                "return x",
            ]  # fmt: skip
    time = ["dt"] if "dt" in _arguments(kind, name) else []
    called = own(name, p, s, *time, "x")
    return [called if name == "follow" else f"return {called}"]


def _step(node: Node, p: str, s: str) -> list[str]:
    """A reading x at a condition c: `y` its estimate, `t` the time before it, `z` what is seen of it, `b`
    whether it is beyond what is known. One that is not finite is none: the last estimate is held."""
    (tree, *others), beside = (
        [part for part in node.parts if (part.kind in BESIDE) == is_beside]
        for is_beside in (False, True)
    )
    errors, guards = ([p.number for p in beside if p.kind == kind] for kind in ("error", "guard"))
    shares = [one.number for part in (tree, *others) for one in part.all() if one.kind == "share"]
    lines = [
        f"t = reading__begin({s})", f"z = reading__clipped({p}, x)",
        *(f"share__take(p{k}, s{k}, c)" for k in shares), f"y = find_{tree.number}(s, t, z)",
        f"v = {_status(tree)}", f"b = reading__unknown({p}, t, z, x, c)",
        *(f"{s}.deviation = error__deviation(p{k}, s{k}, t, y)" for k in errors),
    ]  # fmt: skip
    for k in guards:
        apart = [f"a = reading__farther({p}, a, find_{one.number}(s, t, z), y)" for one in others]
        lines += [
            "a = 0.0", *apart, f"y = guard__limited(p{k}, s{k}, y, v, b, a, x)",
            f"{s}.status = s{k}.status", f"if {p}.hides and s{k}.beyond:", f"    y = {p}.none",
        ]  # fmt: skip
    if not guards:
        lines.append(f"{s}.status = reading__worth({s}, b, v)")
    return [
        f"reading__wait({p}, {s}, dt)", f"{s}.status = {INVALID}",
        "if x - x == 0.0 and c - c == 0.0:", *(f"    {x}" for x in lines), f"    {s}.value = y",
        f"return {s}.value",
    ]  # fmt: skip


def _adaptive(node: Node, name: str, p: str, s: str) -> list[str]:
    """The parts that remember estimates; the same, which teach; the model as it was fitted."""
    k, count = node.number, len(node.parts) // 2
    remembering, teaching, fitted = node.parts[:count], node.parts[count:-1], node.parts[-1]

    def each(function: str, parts: tuple[Node, ...], of: str, x: str = "x") -> list[str]:
        calls = (_call(part, of, x) for part in parts)
        return [f"adaptive__{function}({p}, {s}, {i}, {call})" for i, call in enumerate(calls)]

    match name:
        case "inner" | "followed":
            total = each("one", remembering, "look" if name == "inner" else "move")
            return [f"return adaptive__zero_now({s}) + adaptive__raised({p}, {' + '.join(total)})"]
        case "look":
            return [f"return {p}.sign * inner_{k}(s, dt, x)"]
        case "move":
            taught = each("taught", teaching, "move")
            return [*taught, f"return {p}.sign * followed_{k}(s, dt, x)"]
    return [
        f"adaptive__began({s}, dt)",
        "y = x",
        f"x = {_call(fitted, 'find')}",
        f"{s}.status = {_status(fitted)}",
        f"if {s}.share > 0.0:",
        f"    x = adaptive__nearest(inner_{k}, {p}, {s}, s, dt, {p}.sign * y)",
        f"{s}.value = x",
        f"if {s}.known:",
        *(f"    {line}" for line in each("kept", remembering, "look", f"{s}.reference")),
        f"followed_{k}(s, dt, x)",
        f"z = adaptive__driving({s}, x)",
        *each("taught", teaching, "move", "z"),
        f"if {s}.known:",
        f"    adaptive__learn({p}, {s}, y)",
        "return x",
    ]


def _call(part: Node, name: str, x: str = "x") -> str:
    return f"{name}_{part.number}(s, dt, {x})"


def _channel(part: Node, drive: str) -> str:
    return f"{_call(part, 'move', drive)} if x > 0.0 else {_call(part, 'look', drive)}"


def _status(part: Node) -> str:
    return f"status_{part.number}(s)"


def _follows(part: Node) -> str:
    """A law may move without telling the output, where this costs less."""
    return "follow" if not part.parts and _arguments(part.kind, "follow") else "move"


def _arguments(kind: str, name: str) -> list[str]:
    function = getattr(module_of(kind), name, None)
    return list(inspect.signature(function).parameters) if function else []
