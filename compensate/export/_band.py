"""The error of a compensator in the document, and its guaranteed band, there and as a function in C."""

from hysteresis import InputError
from hysteresis.laws._tree import Tree

from .._readings import nested
from ..guards._guarded import GuardedCompensator
from ..uncertainty._calibrated import CalibratedCompensator
from ..uncertainty._ensemble import EnsembleCompensator
from ..uncertainty._guaranteed import Guaranteed
from ._python_to_c99 import number


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
