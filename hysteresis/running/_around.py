"""The texts of laws around a whole tree: one that knows of noise, and what it and one that learns say."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..laws._nodes import Node
    from ._text import Text


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
            text.set(node, "status", f"{text.function(search, 'status')}(m, n)"),
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
        f"for i in range(whole(n, STATE), whole(n, {node.of + 1})):",
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
