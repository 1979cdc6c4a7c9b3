"""What changes in a C99 compensator: its structure, its values before the first reading, and its size."""

import ctypes
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from hysteresis.laws._nodes import Node

from ._c99_nodes import place_of
from ._python_to_c99 import Element, comment


def state_in_c(
    parts: Sequence[Node],
    elements: Mapping[str, Element],
    stem: str,
    listed: Callable[..., str],
    number: Callable[..., str],
) -> str:
    """The structure of the nodes' states, and the function that resets it.

    `listed` and `number`: values as C writes them.
    """
    fields, values = [], []
    for part in parts:
        if "state" not in part.of:
            continue
        home = elements[part.kind]
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


def size_of(parts: Sequence[Node], elements: Mapping[str, Element], single: bool) -> int:
    """sizeof of that structure, by the rules that C compilers share."""
    real = ctypes.c_float if single else ctypes.c_double
    members: list[tuple[str, Any]] = []
    for part in parts:
        if "state" not in part.of:
            continue
        same = [p.of["state"] for p in parts if p.kind == part.kind]
        fields: list[tuple[str, Any]] = [
            (k, ctypes.c_int if t == "int" else real if t != "Reals"
             else real * max(1, *(len(state[k]) for state in same)))
            for k, t in elements[part.kind].structures["State"].items()
        ]  # fmt: skip
        members.append(
            (f"n{part.number}", type("_Part", (ctypes.Structure,), {"_fields_": fields}))
        )
    return ctypes.sizeof(type("_State", (ctypes.Structure,), {"_fields_": members}))
