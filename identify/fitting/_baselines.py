"""The baselines of a fit, on the folds and rows on which its candidates are judged."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from hysteresis import Record

from ..baselines._contract import AbstractBaseline, Scored, scored
from ..baselines._curves import MonotoneBaseline, replay
from ..baselines._holds import of_holds
from ..baselines._input_memory import branches_of
from ..baselines._linear import constant, cubic_per_branch, ridges, straight_line
from ..records._folds import Parts, block_errors
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
    found = [_figures(scored(one, record, parts), record, test) for one in single]
    best = _best(scored(one, record, parts) for one in ridges(record, columns))
    return (*found, _figures(best, record, test))


def baselines_of_hold(record: Record, parts: Parts, test: Record | None) -> tuple[Baseline, ...]:
    """Those of creep or relaxation under a constant input, the simplest first."""
    return tuple(
        _figures(scored(one, record, parts), record, test)
        for one in of_holds(not record.sigma_name)
    )


def _best(tried: Iterable[Scored]) -> Scored:
    return min(tried, key=lambda one: one.blocks.mean() if len(one.blocks) else 0.0)


def _figures(one: Scored, record: Record, test: Record | None) -> Baseline:
    figures: dict[str, Any] = {"test": None}
    figures["train"] = metrics(record.output, one.output, one.used, record.weights)
    test_blocks = None
    if test is not None:
        baseline: AbstractBaseline = one.baseline
        predicted = baseline.predicted(baseline.prepared(test), one.unknowns)
        figures["test"] = metrics(test.output, predicted, test.mask, test.weights)
        error = test.weights * (predicted - test.output)
        test_blocks = np.array(block_errors(error[test.mask]))
    held_out = float(one.blocks.mean()) if len(one.blocks) else np.nan
    score = 100 * float(np.sqrt(held_out)) / float(np.ptp(record.output[record.mask]))
    residuals = np.where(one.used, one.output - record.output, np.nan)
    return Baseline(one.baseline.name, score, figures, one.blocks, test_blocks, residuals)
