"""The baselines of a fit, on the folds and rows on which its candidates are judged."""

from typing import Any

import numpy as np

from hysteresis import Record

from .._levels import ENOUGH_ROWS
from ..baselines._contract import AbstractBaseline
from ..baselines._curves import MonotoneBaseline, of_holds, replay
from ..baselines._input_memory import branches_of
from ..baselines._linear import constant, cubic_per_branch, ridges, straight_line
from ..records._folds import Parts, block_errors, held_out_errors, thinned
from ..results._goodness_of_fit import Baseline, metrics


def baselines_of(
    record: Record,
    parts: Parts,
    test: Record | None,
    columns: tuple[str, ...] = (),
    combined: bool = False,
) -> tuple[Baseline, ...]:
    """Every baseline of a record, as its models see it, the simplest first.

    **Arguments:**

    - `parts`: on whose folds the models were ranked.
    - `test`: the record that they are judged on, prepared like `record`.
    - `columns`: further columns of both records, such as channels and conditions, for plain regressors.
    - `combined`: whether the input is made of such columns.
    """
    branches = branches_of(record)
    single = (
        constant(), straight_line(columns, combined), MonotoneBaseline(),
        cubic_per_branch(record, branches), replay(record, branches),
    )  # fmt: skip
    found = [_judged(one, record, parts, test) for one in single]
    of_ridges = (_judged(one, record, parts, test) for one in ridges(record, columns))
    best = min(of_ridges, key=lambda one: one.blocks.mean() if len(one.blocks) else 0.0)
    return (*found, best)


def baselines_of_hold(record: Record, parts: Parts, test: Record | None) -> tuple[Baseline, ...]:
    """Those of creep or relaxation under a constant input, the simplest first."""
    single = of_holds(not record.sigma_name)
    return tuple(_judged(one, record, parts, test) for one in single)


def _judged(
    baseline: AbstractBaseline, record: Record, parts: Parts, test: Record | None
) -> Baseline:
    """Cross-validated on the folds on which models are ranked, then fitted to all counted rows.

    A model may leave some out, a baseline never does.
    """
    seen, y = baseline.prepared(record), record.output

    def fitted(which: tuple[int, ...]) -> Any:
        rows = thinned(np.flatnonzero(np.isin(parts.label, which)), ENOUGH_ROWS)
        return baseline.fitted(seen, y, rows, record.weights)

    def error(unknowns: Any, test: tuple[int, ...]) -> np.ndarray:
        rows = np.isin(parts.label, test)
        return (baseline.predicted(seen, unknowns)[rows] - y[rows]) * record.weights[rows]

    blocks, unknowns = held_out_errors(parts.folds, fitted, error), fitted(parts.all)
    used, output = parts.label >= 0, baseline.predicted(seen, unknowns)
    figures: dict[str, Any] = {"test": None, "train": metrics(y, output, used, record.weights)}
    test_blocks = None
    if test is not None:
        predicted = baseline.predicted(baseline.prepared(test), unknowns)
        figures["test"] = metrics(test.output, predicted, test.mask, test.weights)
        error_there = test.weights * (predicted - test.output)
        test_blocks = np.array(block_errors(error_there[test.mask]))
    held_out = float(blocks.mean()) if len(blocks) else np.nan
    score = 100 * float(np.sqrt(held_out)) / float(np.ptp(y[record.mask]))
    residuals = np.where(used, output - y, np.nan)
    return Baseline(baseline.name, score, figures, blocks, test_blocks, residuals)
