"""The texts of laws around a whole tree: one that learns, and one that knows of noise.

Both move twice: what remembers what is given out, and what is beside it.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ._text import Node, Text


def adaptive(text: "Text", node: "Node", name: str) -> list[str]:
    """As `_adaptive` of `hysteresis/laws/_tree.py`."""
    count = len(node.parts) // 2
    own, teaching, fitted = node.parts[:count], node.parts[count:-1], node.parts[-1]

    def each(function: str, parts: "Sequence[Node]", of: str, x: str) -> list[str]:
        return [
            text.law(node, function, str(k), text.call(part, of, x)) for k, part in enumerate(parts)
        ]

    if name in ("inner", "followed"):
        total = each("one", own, "look" if name == "inner" else "move", "x")
        return [
            f"return {text.law(node, 'zero_now')} + {text.law(node, 'raised', ' + '.join(total))}"
        ]
    sign = text.number(node, "sign", "Parameters")
    if name == "look":
        return [f"return {sign} * {text.call(node, 'inner')}"]
    if name == "move":
        return [
            *each("taught", teaching, "move", "x"),
            f"return {sign} * {text.call(node, 'followed')}",
        ]
    look = {"look": text.function(node, "inner")}
    known, reference = (text.number(node, field) for field in ("known", "reference"))
    return [
        text.law(node, "began", "dt"),
        "y = x",
        f"x = {text.call(fitted, 'find')}",
        text.set(node, "status", f"1.0 * {text.status(fitted)}(m, n)"),
        f"if {text.number(node, 'share')} > 0.0:",
        f"    x = {text.law(node, 'nearest', 'dt', f'{sign} * y', given=look)}",
        text.set(node, "value", "x"),
        f"if {known} != 0.0:",
        *(f"    {line}" for line in each("kept", own, "look", reference)),
        text.call(node, "followed"),
        *each("taught", teaching, "move", text.law(node, "driving", "x")),
        f"if {known} != 0.0:",
        f"    {text.law(node, 'learn', 'y')}",
        "return x",
    ]


def filtered(text: "Text", node: "Node", name: str) -> list[str]:
    """Two trees alike: the first one goes from inputs to outputs, the second one back.

    `kept` holds what both remember while something is tried: their states lie in m before the node's own.
    """
    forward, search = node.parts
    tried = {"look": text.function(forward, "look")}
    if name == "find":
        tried["back"] = text.function(node, "back")
        return [
            text.call(node, "keep"),
            f"y = {text.call(search, 'find')}",
            text.set(node, "status", f"1.0 * {text.status(search)}(m, n)"),
            text.call(node, "restore"),
            f"x = {text.law(node, 'likeliest', 'dt', 'y', given=tried)}",
            f"y = {text.call(forward, 'move')}",
            text.call(search, "find", "y"),
            "return x",
        ]
    if name == "back":  # from an input to the last one
        return [
            text.call(node, "keep"),
            text.call(forward, "move"),
            f"y = {text.call(forward, 'move', text.number(node, 'value'), '0.0')}",
            text.call(node, "restore"),
            "return y",
        ]
    here, there = "i", f"{text.place(node, 'kept')} + i - whole(n, STATE)"
    to, of = (there, here) if name == "keep" else (here, there)
    return [
        f"for i in range(whole(n, STATE), whole(n, {node.row + 1})):",
        f"    put(m, {to}, get(m, {of}))",
        "return x",
    ]


def said(text: "Text", node: "Node") -> list[str]:
    """What the law says beside an estimate: expressions of m and n."""
    if node.kind == "filtered":
        return [text.law(node, "deviation")]
    zero, drift = (f"get(m, {text.place(node, 'theta')} + {k})" for k in (0, 1))
    moved = f"{zero} + {drift} * {text.number(node, 'elapsed')} - {text.number(node, 'zero', 'Parameters')}"
    return [
        text.law(node, "advice"),
        text.law(node, "lost"),
        text.number(node, "changes"),
        f"{text.number(node, 'sign', 'Parameters')} * ({moved})",
        text.law(node, "gain"),
        text.law(node, "loop"),
    ]
