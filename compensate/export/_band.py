"""The error of a compensator in the document, and its guaranteed band, there and as a function in C."""

from hysteresis import InputError
from hysteresis.laws._tree import Tree

from ..guards._guarded import GuardedCompensator
from ..uncertainty._calibrated import CalibratedCompensator
from ..uncertainty._ensemble import EnsembleCompensator
from ..uncertainty._guaranteed import GuaranteedCompensator
from ._python_to_c99 import number


def banded(band: GuaranteedCompensator, error: CalibratedCompensator | None) -> Tree:
    """What a document holds of a band.

    Raises `InputError` `not-exportable` where its shape is a deviation that the file does not have.
    """
    inner = band.inner
    while isinstance(inner, GuardedCompensator):
        inner = inner.inner
    by_deviation = isinstance(inner, CalibratedCompensator)
    unknown = by_deviation and (error is None or not _alike(inner, error))
    if unknown or isinstance(inner, EnsembleCompensator) or getattr(inner, "deviates", False):
        raise InputError(
            "not-exportable",
            "The shape of this band is a deviation that the file does not have.",
            fix="give the same `calibrated` compensator as `error` and to `guaranteed`, or one without.",
        )
    return {
        "factor": float(band.factor), "guarantee": band.guarantee, "runs": band.runs,
        "by_deviation": by_deviation, "gain": float(band.gain),
    }  # fmt: skip


def _alike(one: CalibratedCompensator, other: CalibratedCompensator) -> bool:
    pairs = ((one.levels, other.levels), (one.error, other.error))
    return all(a.shape == b.shape and bool((a == b).all()) for a, b in pairs)


def band_in_c(document: Tree, stem: str, real: str, single: bool) -> str:
    """The functions that give the band of the last estimate, and by which it follows a sensor that drifts;
    nothing where there is no band."""
    if not (band := document.get("band")):
        return ""
    factor, gain = number(band["factor"], single), number(band["gain"], single)
    allowed, zero = number(1.0 - band["guarantee"], single), number(0.0, single)
    by = " * s->last.deviation" if band["by_deviation"] else ""
    return f"""\
/* The band of the last estimate: a new run lies within its bands over its whole length with a probability
 * of {100 * band["guarantee"]:g} per cent or more, if it is exchangeable with the {band["runs"]}
 * runs of the calibration. */
static inline void {stem}_band(const {stem}_state *s, {real} *low, {real} *high)
{{
    {real} half = {factor}{by};
    *low = s->last.value - half;
    *high = s->last.value + half;
}}

/* A band that follows runs whose inputs become known: it is wider after a run that left it, and a little
 * narrower after one that did not, so that {100 - 100 * band["guarantee"]:g} per cent leave it in the long
 * run, whatever drifts. The caller keeps it, over every reset of the state. */
typedef struct {{
    {real} factor; /* half the width, over {"the deviation" if by else "1"} */
    int missed;    /* whether this run has left its band */
}} {stem}_followed;

static inline void {stem}_followed_reset({stem}_followed *f)
{{
    f->factor = {factor};
    f->missed = 0;
}}

static inline void {stem}_followed_band(
    const {stem}_followed *f, const {stem}_state *s, {real} *low, {real} *high)
{{
    {real} half = f->factor{by};
    *low = s->last.value - half;
    *high = s->last.value + half;
}}

/* The true input behind the last estimate; one that is not finite says nothing. */
static inline void {stem}_watch({stem}_followed *f, const {stem}_state *s, {real} input)
{{
    {real} half = f->factor{by};
    f->missed = f->missed || input < s->last.value - half || input > s->last.value + half;
}}

/* At the end of a run. */
static inline void {stem}_follow({stem}_followed *f)
{{
    f->factor += {gain} * (({real})f->missed - {allowed});
    f->factor = f->factor < {zero} ? {zero} : f->factor;
    f->missed = 0;
}}"""
