"""What each record adds to a spectrum, as rows of a least-squares problem."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from hysteresis import InputError

from ._prony_series import Input, Kind, Problem, Way


class Response(NamedTuple):
    """What one record adds to a spectrum.

    - `t` (rows,): times since the load came on, or angular frequencies for a `kind` of "modulus".
    - `y` (rows,): the output, or the complex modulus G' + i G''. Real numbers are storage alone, and
      a NaN was not measured.
    - `kind`: "creep", displacement under a force; "relaxation", force under a displacement; "modulus".
    - `input` (rows,): the force (creep) or displacement (relaxation), linear between samples; None for a
      unit step at t = 0, when y is the compliance J or the modulus G.
    - `way`: how the input came to a unit hold from t = 0 on, without an `input`; None for a step.
    - `weight`: of all rows, or of each, beside that of other records.
    - `relative`: weigh errors by 1 / |y|, as an answer that spans decades needs; with an `input`, and where
      False, all rows weigh the same.

    **Example:**

        >>> identify.Response(np.ones(3), np.full(3, 2 + 1j), "modulus").kind
        'modulus'
    """

    t: Any
    y: Any
    kind: Literal["creep", "relaxation", "modulus"] = "creep"
    input: Any = None
    way: Way | None = None
    weight: Any = 1.0
    relative: bool = True


Rows = tuple[Input, np.ndarray, np.ndarray]
"""A response as an input, outputs and weights."""


def problem_of(
    responses: Sequence[Response],
    notes: list[str] | None = None,
    known: tuple[tuple[int, float], ...] = (),
) -> Problem:
    """The rows of all of them; of creep alone, or beside moduli, in compliances. `notes` grows."""
    if not responses:
        raise InputError(
            "too-few-rows", "no response was given.", fix="give a Response or several."
        )
    kind = side_of(responses)
    rows = [rows_of(one, kind, [] if notes is None else notes) for one in responses]
    inputs, y, weights = zip(*rows, strict=True)
    return Problem(inputs, np.concatenate(y), np.concatenate(weights), known)


def side_of(responses: Sequence[Response]) -> Kind:
    """Whether their spectrum is one of compliances or of stiffnesses."""
    kinds = {one.kind for one in responses}
    return "creep" if "creep" in kinds and "relaxation" not in kinds else "relaxation"


def rows_of(response: Response, kind: Kind, notes: list[str]) -> Rows:
    """Weighted rows; what is left out is said in `notes`."""
    t, y, u = _checked(response)
    weight = np.broadcast_to(np.asarray(response.weight, float), t.shape)
    if response.kind == "modulus":
        return _moduli(t, y, weight, kind, response)
    y = y.real
    relative = response.relative and u is None
    if relative:
        kept = (y > 0) & ((t > 0) if response.way is None else (t >= 0))
        if count := int((~kept).sum()):
            rows = "row" if count == 1 else "rows"
            notes.append(f"Left out: {count} {rows} not positive or at the step itself.")
        t, y, weight = t[kept], y[kept], weight[kept]
    weights = weight / (y if relative else np.sqrt(np.mean(y**2)))
    return Input(kind, t if u is None else t - t[0], u, response.way), y, weights


def _moduli(omega: np.ndarray, y: Any, weight: np.ndarray, kind: Kind, response: Response) -> Rows:
    """Rows of storage, then of loss; one that is not a number does not count."""
    y = 1 / np.conj(y) if kind == "creep" else y
    parts = np.concatenate([y.real, y.imag])
    there = np.isfinite(parts)
    size = np.hypot(*np.nan_to_num(np.split(parts, 2)))
    size = size if response.relative else np.full_like(size, np.sqrt(np.mean(size**2)))
    weights = np.where(there, np.tile(weight / size, 2), 0.0)
    return Input(kind, omega, oscillation=True), np.nan_to_num(parts), weights


def resolved(at: Input) -> tuple[float, float]:
    """The shortest time that a record resolves, first row, least step or 1 / frequency, and its longest."""
    if at.oscillation:
        return float(1 / at.t.max()), float(1 / at.t.min())
    times = at.t if at.u is None else np.diff(at.t)
    return float(times[times > 0].min()), float(at.t[-1])


def _checked(response: Response) -> tuple[np.ndarray, Any, np.ndarray | None]:
    """Times and outputs as arrays, and the input, if any."""
    t, y, kind = np.asarray(response.t, float), np.asarray(response.y, complex), response.kind
    u = None if response.input is None else np.asarray(response.input, float)
    if kind not in ("creep", "relaxation", "modulus"):
        raise InputError(
            "bad-option", f"kind={kind!r}.", fix='give "creep", "relaxation" or "modulus".'
        )
    given = [t, y] if u is None else [t, y, u]
    if any(a.ndim != 1 or a.shape != t.shape for a in given):
        shapes = ", ".join(str(a.shape) for a in given)
        raise InputError("length-mismatch", f"t, y and input need one length each; have {shapes}.")
    if kind == "modulus":
        if not np.iscomplexobj(response.y):
            y.imag = np.nan
        if not (np.isfinite(t) & (t > 0)).all():
            raise InputError("not-finite", "a frequency is not above 0.", fix="drop those rows.")
        return t, y, None
    if not all(np.isfinite(a).all() for a in given):
        raise InputError("not-finite", "t, y or input is NaN or infinite.", fix="drop those rows.")
    if len(t) and (np.diff(t) < 0).any():
        raise InputError(
            "time-backwards", "time decreases.", fix="sort the rows, or fit one sequence."
        )
    if u is None and len(t) and t[0] < 0:
        raise InputError(
            "time-backwards",
            f"t begins at {t[0]:g}.",
            fix="count time from where the step was made.",
        )
    return t, y, u
