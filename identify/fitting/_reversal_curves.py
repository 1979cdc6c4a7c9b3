"""A Preisach model from a record that consists of first-order reversal curves, without a solver."""

from dataclasses import replace

import numpy as np

from hysteresis import InputError, Preisach, Record
from hysteresis.preisach import GridDensity

from ..forc._curves import Forc, forc_curves
from ..forc._everett import everett_surface
from ..records._folds import held_out_errors
from ..records._run_model import predict
from ..results._detail import ReversalCurves
from ..results._fit_result import FitResult, Parameter
from ..results._goodness_of_fit import evidence
from ._candidate import Candidate, Options, Trial
from ._training_data import TrainingData

FEWEST = 10
"""Curves from different reversals that such a record has."""

SHARE = 0.4
"""Of the rows, on the curves: half of those that also show the ways to the reversals."""

APART = 0.05
"""Reversals closer than this part of their mean distance are taken for one, measured twice."""


class SurfaceCandidate(Candidate):
    """The Everett function of first-order reversal curves; `"auto"` tries it where a record consists of
    them."""

    def suits(self, data: TrainingData, purpose: str) -> bool:
        # What such curves show best may have no inverse, because noise makes some of its masses negative.
        bars = data.falls or data.condition is not None or purpose == "compensate"
        return not bars and consists_of_curves(data.record)

    def fitted(self, data: TrainingData, options: Options) -> list[Trial]:
        return [Trial(fit_surface(self.name, data))]


def consists_of_curves(record: Record) -> bool:
    """Whether a record consists of first-order reversal curves of an output that rises."""
    try:
        curves = _curves(record)
    except InputError:
        return False
    rows = sum(len(curve.input) for curve in curves)
    return len(curves) >= FEWEST and rows > SHARE * int(record.mask.sum())


def fit_surface(name: str, data: TrainingData) -> FitResult:
    """The Everett function of the curves as a model, see `everett_surface`; held-out curves judge it.

    Raises `InputError` `too-few-curves`, and `not-increasing` where the output falls.
    """
    record, parts = data.record, data.parts
    if data.falls:
        raise InputError(
            "not-increasing",
            "the output falls as the input rises; a surface is made of rising curves.",
        )

    def model_of(which: tuple[int, ...]) -> Preisach:
        return everett_surface(_curves(replace(record, mask=np.isin(parts.label, which)))).model

    def error(model: Preisach, which: tuple[int, ...]) -> np.ndarray:
        rows = np.isin(parts.label, which)
        return record.weights[rows] * (predict(model, record)[rows] - record.output[rows])

    blocks = held_out_errors(parts.folds, model_of, error)
    model = model_of(parts.all)
    judged = evidence(record, parts, predict(model, record), False, float(blocks.mean()))
    assert model.reversible is not None
    assert isinstance(model.density, GridDensity)
    sums = {
        "offset": float(model.offset), "reversible.rise": float(np.sum(model.reversible)),
        "density.mass": float(np.sum(model.density.weights)),
    }  # fmt: skip
    unit, count = record.output_unit, len(_curves(record))
    note = f"Interpolated between {count} first-order reversal curves; nothing was smoothed."
    return FitResult(
        name=name,
        model=model,
        parameters=tuple(
            Parameter(name, value, unit, None, "inseparable") for name, value in sums.items()
        ),
        covariance=np.zeros((0, 0)),
        **judged._asdict(),
        success=True,
        blocks=blocks,
        notes=(note,),
        detail=ReversalCurves(count),
        **data.shown,
    )


def _curves(record: Record) -> tuple[Forc, ...]:
    """One curve for each reversal."""
    curves = forc_curves(record)
    least = APART * (curves[-1].reversal - curves[0].reversal) / len(curves)
    kept = list(curves[:1])
    for curve in curves[1:]:
        if curve.reversal > kept[-1].reversal + least:
            kept.append(curve)
    return tuple(kept)
