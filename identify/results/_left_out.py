"""What a fit would have been without one cycle, or one sequence: its errors there are those of new rows.

Residuals of the rows that a model was fitted to are too small, the more so the more weights it has. So
every cycle is left out in turn, a long one in pieces; what was chosen for the fit (parts, grid, prior
strength) is kept.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from hysteresis import AbstractModel, Record
from hysteresis._parameter import parameter_at
from hysteresis.records._cycles import counted_cycles

from .._levels import GROUPS, HELD, MANY_ROWS, MUCH, ROUNDING
from ..linear._composition import CompositionUnknowns
from ..linear._composition_parts import memory_blocks
from ..linear._cross_validation import NormalEquations, normal_equations_of
from ..linear._linear_fit import LinearFit
from ..linear._preisach_fit import PreisachProblem
from ..linear._preisach_unknowns import GridUnknowns
from ..linear._unknown_vectors import relative
from ..parameters._settings import numbers_of, replaced
from ..records._conditions import condition_parts, inner_folds, name_of_condition, trained_values
from ..records._folds import BLOCKS_OF_FOLD, KIND, Fold, Parts, parts
from ._detail import Composition, GridWeights, Parametric
from ._fit_result import FitResult
from ._repeatability import groups_of, slope_of

LEAST = 2
"""Groups without which nothing can be left out."""

KNOWN = 0.25
"""Two groups alike hold a half each of what is known; a quarter is half of that."""

HALVES = (*0.5 ** np.arange(10), 0.0)
"""Parts of a step that are tried."""


class WithoutGroup(NamedTuple):
    """A model fitted without some `rows` (samples,)."""

    rows: Bool[np.ndarray, " samples"]
    model: AbstractModel


def models_without_groups(fit: FitResult) -> list[WithoutGroup]:
    """The model of a fit without each of its cycles in turn, or its sequences where it has several.

    For weights H x = b of all rows, the minimum of x'(H - H_g) x / 2 - (b - b_g)'x with the group's own
    normal equations H_g, b_g is found with the same signs; for few parameters one step of Gauss-Newton,

        dx = (J'J - J_g'J_g)^-1 J_g' r_g

    halved until the other rows are missed by no more than before, and without the directions of which the
    group holds more than three quarters of what is known.

    **Returns:** none where there are fewer than two groups, more than 100,000 rows, or neither weights nor
    few parameters.
    """
    group = groups_of(fit.train, fit.used)
    count = int(group.max()) + 1 if len(group) else 0
    if count < LEAST or len(group) > MANY_ROWS:
        return []
    if count > GROUPS:
        group = np.where(group >= 0, group * GROUPS // count, -1)
    group = _alike(group, fit.used)
    if isinstance(fit.detail, GridWeights | Composition):
        models = _of_weights(fit.detail.linear, fit.train, np.where(fit.used, group, -1))
    elif isinstance(fit.detail, Parametric):
        models = _of_parameters(fit, group)
    else:
        return []
    return [WithoutGroup(fit.used & (group == g), model) for g, model in models]


def _alike(
    group: Int[np.ndarray, " samples"], used: Bool[np.ndarray, " samples"]
) -> Int[np.ndarray, " samples"]:
    """Groups of which none has more than twice the counted rows of the middle one: larger ones are divided.

    A model without most of the rows is another one, and its errors are not those of the fit.
    """
    sizes = np.bincount(group[used & (group >= 0)])
    most, found, number = 2 * np.median(sizes[sizes > 0]), np.full_like(group, -1), 0
    for one in np.flatnonzero(sizes):
        own, parts = np.flatnonzero(group == one), int(np.ceil(sizes[one] / most))
        rank = np.cumsum(used[own]) - used[own]
        found[own] = number + np.minimum(rank * parts // sizes[one], parts - 1)
        number += parts
    return found


def _of_weights(
    linear: LinearFit, record: Record, group: Int[np.ndarray, " samples"]
) -> Iterator[tuple[int, AbstractModel]]:
    meaning = linear.meaning
    if not linear.is_current:
        return
    if isinstance(meaning, GridUnknowns):
        parts = Parts(group, (), None, "every group")
        normal = PreisachProblem(record, parts, meaning).normal
    elif isinstance(meaning, CompositionUnknowns):
        normal = _of_composition(meaning, record, group)
    else:
        return
    for g, own in normal.items():
        rest = linear.rows - own.rows
        if rest <= 0 or not own.rows:
            continue
        H = (linear.rows * linear.H - own.H) / rest
        b = (linear.rows * linear.b - own.b) / rest
        yield g, meaning.model(meaning.minimum(H, b, linear.unknowns != 0))


def _of_composition(
    meaning: CompositionUnknowns, record: Record, group: Int[np.ndarray, " samples"]
) -> dict[int, NormalEquations]:
    y = relative(meaning, record.output)
    used = (group >= 0) & (y > meaning.least + HELD)  # below it an output tells only a limit
    found: dict[int, NormalEquations] = {}
    for here, memory in memory_blocks(meaning.memory(), record, np.flatnonzero(used)):
        w, own = record.weights[here], group[here]
        which = {int(g): own == g for g in np.unique(own)}
        A = w[:, None] * meaning.columns(memory)
        for g, more in normal_equations_of(A, w * y[here], which).items():
            found[g] = found[g] + more if g in found else more
    return found


def _of_parameters(
    fit: FitResult, group: Int[np.ndarray, " samples"]
) -> Iterator[tuple[int, AbstractModel]]:
    free = [p for p in fit.parameters if p.status == "free"]
    used = fit.used & np.isfinite(fit.residuals)
    if not free:
        return
    w = fit.train.weights
    J = w[:, None] * np.column_stack([slope_of(fit, p.name) for p in free])
    size = np.maximum(np.sqrt((J[used] ** 2).sum(0)), np.finfo(float).tiny)
    J, r = J / size, np.where(used, w * fit.residuals, 0.0)
    lows = {name: info.bounds[0] for name, info, _ in numbers_of(fit.model)}
    for g in range(int(group.max()) + 1):
        own, rest = used & (group == g), used & (group != g)
        if not (own.any() and rest.any()):
            continue
        step = _step(J[used].T @ J[used], J[rest].T @ J[rest], J[own].T @ r[own]) / size
        # The fit to the rest cannot miss it by more than the whole fit does: where the step leads to more,
        # it is longer than the model is linear.
        least = float(np.sum(r[rest] ** 2)) * (1 + ROUNDING)
        for part in HALVES:
            model = fit.model
            for p, by in zip(free, part * step, strict=True):
                # On the scale on which it has no lower bound.
                old, low = float(parameter_at(model, p.name)), lows[p.name]
                new = old + by if low == -np.inf else low + (old - low) * np.exp(by / (old - low))
                model = replaced(model, p.name, float(new))
            missed = w * (replace(fit, model=model).predict(fit.train) - fit.train.output)
            if float(np.sum(missed[rest] ** 2)) <= least:
                break
        yield g, model


def _step(
    whole: Float[np.ndarray, "p p"], rest: Float[np.ndarray, "p p"], slope: Float[np.ndarray, " p"]
) -> Float[np.ndarray, " p"]:
    """rest^-1 slope, in the directions of which the rest holds at least a `KNOWN` part of the information.

    A model without nearly all that is known of a direction is another one; there the fit's own is kept.
    """
    value, vector = np.linalg.eigh(whole)
    root = vector / np.sqrt(np.maximum(value, 1e-12 * value.max()))
    part, direction = np.linalg.eigh(root.T @ rest @ root)
    gain = np.where(part >= KNOWN, 1 / np.maximum(part, KNOWN), 0.0)
    turned = root @ direction
    return turned @ (gain * (turned.T @ slope))


# Members of an average, and what was asked of a fit on rows that it had not seen, with the errors.

BEYOND = {
    "input": "an input beyond the trained ones", "rate": "a rate beyond the trained ones",
    "time": "a longer hold than any trained one", "inside": "nothing beyond the trained ranges",
}  # fmt: skip


FOLDS = {
    "run": "a new run", "time": "a later time", "amplitude": "another amplitude", "rate": "another rate",
}  # fmt: skip


class Asked(NamedTuple):
    """A member of an average with its weight, or a question with the rows that ask it; the rms `error`
    there, in the unit of the output, None where no row asks it. `key`: of `FOLDS` or `BEYOND`, or other."""

    key: str
    what: str
    share: str
    error: float | None


def members_and_questions(fit: FitResult) -> list[Asked]:
    """The members of an average; what the folds ask by which the model was chosen; then what held-out rows
    beyond the trained ones ask.

    A fold asks for another amplitude where no trained cycle has a range within a fifth of those of its own
    cycles, and for another rate where none is within a factor of 1.5.
    """
    linear = fit.detail.linear if isinstance(fit.detail, Composition) else None
    found = [
        Asked("member", one.name, f"member, {100 * one.weight:.0f} %", one.error)
        for one in getattr(getattr(linear, "meaning", None), "members", ())
    ]
    if fit.blocks is not None:
        found += _of_folds(fit, fit.blocks)
    if fit.extrapolation is not None:
        beyond = fit.extrapolation._asdict().items()
        found += [
            Asked(k, BEYOND[k], f"{x.rows} held-out rows", x.rmse) for k, x in beyond if x.rows
        ]
    return found


def _of_folds(fit: FitResult, blocks: Float[np.ndarray, " blocks"]) -> Iterator[Asked]:
    record, condition = fit.train, name_of_condition(fit.train)
    cut = parts(record) if condition is None else condition_parts(record, condition)
    if len(blocks) != BLOCKS_OF_FOLD * len(cut.folds):
        return
    errors = blocks.reshape(-1, BLOCKS_OF_FOLD).mean(1)
    asked = [_asked(fit, cut, fold) for fold in cut.folds]
    words = dict(FOLDS)
    if condition is not None:
        words["condition"] = f"another {condition}"
        inner = inner_folds(trained_values(record, condition))
        asked = [{"condition"} if k < inner else own for k, own in enumerate(asked)]
    for key, what in words.items():
        own = [error for error, every in zip(errors, asked, strict=True) if key in every]
        error = float(np.sqrt(np.mean(own))) if own else None
        yield Asked(key, what, "folds of training rows" if own else "no row", error)


def _asked(fit: FitResult, cut: Parts, fold: Fold) -> set[str]:
    found = {"run" if len(fit.train.labels) > 1 else "time"}
    seen, new = (_moves(fit, np.isin(cut.label, side)) for side in fold)
    for k, (key, factor) in enumerate((("amplitude", 1 + KIND), ("rate", MUCH))):
        if len(seen) and len(new):
            apart = np.abs(new[:, k, None] - seen[:, k]).min(1)  # NaN without a clock
            found |= {key} if (apart > np.log(factor)).all() else set()
    return found


def _moves(fit: FitResult, rows: np.ndarray) -> np.ndarray:
    """Logarithms of the ranges and the rates of cycles, (cycles, 2)."""
    record, found = fit.train, []
    for one in (x.rows for cycles in counted_cycles(record, rows) for x in cycles):
        span = np.ptp(record.input[one])
        lasted = np.nan if record.time is None else np.ptp(record.time[one])
        found.append((np.log(span), np.log(span / lasted)))
    return np.array(found)
