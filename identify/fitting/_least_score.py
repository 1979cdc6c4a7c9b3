"""The least score that any curve, or any linear viscoelastic model, can have on the rows that are held out.

    y = a + b u + c t + d integral(u) + sum_k (e_k average_k(u) + f_k exp(-t / tau_k))

fitted to the held-out rows of each fold themselves: every linear viscoelastic model has an output of this
form, with relaxation times near those of a grid. A curve is a polygon of 100 pieces.

`auto` needs not try a model that cannot be as good as one that it has found: each takes seconds to compile.
"""

import numpy as np

from hysteresis import AbstractModel, Burgers, LinearSponge, Record
from hysteresis.numerics._hats import hats_of
from hysteresis.numerics._input_memory import slow_states

from ..records._folds import held_out_errors
from ..records._latest import longest_sequence, usual_speed
from ._training_data import TrainingData

PIECES = 100
"""Of a curve."""

TIMES = 12
"""Relaxation times, from the sampling step to ten times the longest sequence."""


def least_score(kind: type[AbstractModel] | None, data: TrainingData) -> float:
    """In per cent of the output's range, as `FitResult.score`; 0 for a kind of which nothing is known."""
    record = data.record
    if kind is LinearSponge:
        u = record.input
        columns = hats_of(u, np.linspace(u[record.mask].min(), u[record.mask].max(), PIECES + 1))
    elif kind is Burgers and record.time is not None:
        columns = _linear(record)
    else:
        return 0.0
    columns = record.weights[:, None] * columns / np.maximum(np.abs(columns).max(0), 1e-300)
    y = record.weights * record.output

    def missed(_: object, test: tuple[int, ...]) -> np.ndarray:
        X, own = (x[np.isin(data.parts.label, test)] for x in (columns, y))
        return X @ np.linalg.lstsq(X, own, rcond=None)[0] - own

    blocks = held_out_errors(data.parts.folds, lambda _: None, missed)
    rms = float(np.sqrt(blocks.mean())) if len(blocks) else 0.0
    return 100 * rms / float(np.ptp(record.output[record.mask]))


def _linear(record: Record) -> np.ndarray:
    assert record.time is not None
    t, moved, slow = np.zeros(len(record)), np.zeros(len(record)), np.empty((len(record), TIMES))
    times = np.geomspace(usual_speed(record)[1], 10 * longest_sequence(record), TIMES)
    for _, rows in record.sequences():
        t[rows], u = record.time[rows] - record.time[rows.start], record.input[rows]
        moved[rows.start + 1 : rows.stop] = np.cumsum(np.diff(t[rows]) * (u[1:] + u[:-1]) / 2)
        slow_states(u, record.time[rows], times, slow[rows])
    gone = np.exp(-t[:, None] / times)
    return np.column_stack([np.ones(len(t)), record.input, t, moved, slow, gone])
