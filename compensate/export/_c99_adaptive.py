"""In C: the node of a compensator that recalibrates itself, and the functions by which it learns."""

from collections.abc import Sequence

from hysteresis.laws._tree import Tree

from ._operation_count import operations
from ._python_to_c99 import Element


def cost(home: Element, p: Tree, inner: Sequence[dict[str, int]]) -> dict[str, int]:
    """Operations of the functions of the node, at most; `inner`: those of its parts, which it has twice,
    and of the model as it was fitted."""
    *parts, fitted = inner
    look = sum(one["look"] + 12 for one in parts) // 2 + 30 * p["parts"] + 30
    moved = sum(one["move"] + 12 for one in parts) + 30 * p["parts"] + 30
    looked = operations(home, "nearest", p, {"look": look})
    learnt = operations(home, "learn", p)
    return {
        "look": look,
        "move": moved,
        "find": fitted["find"] + looked + look + moved + learnt,
    }


def bodies(home: Element, stem: str, k: int, parts: Sequence[str]) -> dict[str, list[str]]:
    """`look` and `move` of a reading with its sign; `inner`, which the search looks at, and `followed`, by
    which the memories move, without it; `kept` and `taught` keep what the parts give.

    `parts`: their calls, with "look" for the name of the function; the second half of them teaches.
    """
    p, s = f"&{stem}_{k}", f"&s->n{k}"
    estimating, teaching = parts[: len(parts) // 2], parts[len(parts) // 2 :]

    def total(name: str) -> str:
        terms = [
            f"{home.prefix}_one({p}, {s}, {i}, {call.replace('_look(', f'_{name}(')})"
            for i, call in enumerate(estimating)
        ]
        return f"{home.prefix}_zero_now({s}) + {home.prefix}_raised({p}, {' + '.join(terms)})"

    def stored(name: str, calls: Sequence[str]) -> list[str]:
        lines = [
            f"    {home.prefix}_{name}({p}, {s}, {i}, {call});" for i, call in enumerate(calls)
        ]
        return [*lines, "    return value;"]

    moving = [call.replace("_look(", "_move(") for call in teaching]
    return {
        "inner": [f"    return {total('look')};"],
        "look": [f"    return {stem}_{k}.sign * {stem}_{k}_inner(s, dt, value);"],
        "followed": [f"    return {total('move')};"],
        "kept": stored("kept", estimating),
        "taught": stored("taught", moving),
        "move": [
            f"    (void){stem}_{k}_taught(s, dt, value);",
            f"    return {stem}_{k}.sign * {stem}_{k}_followed(s, dt, value);",
        ],
    }


def find(home: Element, stem: str, k: int, fitted: int, done: dict[str, str]) -> list[str]:
    """The body of `find`; the search that it calls is added to `done`. `fitted`: the node of the model."""
    p, s = f"&{stem}_{k}", f"&s->n{k}"
    given = {"look": f"{stem}_{k}_inner", "whole": f"{stem}_state"}
    search = home.specialised("nearest", given, done)
    return [
        f"    {home.prefix}_began({s}, dt);",
        f"    {home.real} found = {stem}_{fitted}_find(s, dt, value);",
        f"    s->n{k}.status = s->n{fitted}.status;",
        f"    if (s->n{k}.share > 0) {{",
        f"        found = {search}({p}, {s}, s, dt, {stem}_{k}.sign * value);",
        "    }",
        f"    s->n{k}.value = found;",
        f"    if (s->n{k}.known) {{",
        f"        (void){stem}_{k}_kept(s, dt, s->n{k}.reference);",
        "    }",
        f"    (void){stem}_{k}_followed(s, dt, found);",
        f"    (void){stem}_{k}_taught(s, dt, {home.prefix}_driving({s}, found));",
        f"    if (s->n{k}.known) {{",
        f"        {home.prefix}_learn({p}, {s}, value);",
        "    }",
        "    return found;",
    ]


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
