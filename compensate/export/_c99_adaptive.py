"""In C: the functions by which a compensator that recalibrates itself learns."""

from hysteresis.laws._tree import Tree

from ._python_to_c99 import Element


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
