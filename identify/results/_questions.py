"""Members of an average, and what was asked of a fit on rows that it had not seen, with the errors."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from hysteresis.records._cycles import counted_cycles

from .._levels import MUCH
from ..records._conditions import condition_parts, inner_folds, name_of_condition, trained_values
from ..records._folds import BLOCKS_OF_FOLD, KIND, Fold, Parts, parts
from ._detail import Composition
from ._fit_result import FitResult

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
