"""`hysid.invert`: the compensator of a fit, guarded by what the fit has seen, with its error."""

import hashlib
import json
from dataclasses import replace
from typing import Any

import numpy as np

import identify
from compensate import AbstractCompensator, calibrated
from compensate import invert as invert_model
from compensate.guards._guarded import longest_step
from compensate.guards._run_in import Past
from compensate.uncertainty._band_words import in_words, of_words
from compensate.uncertainty._calibrated import CalibratedCompensator, LeftOut, checked
from hysteresis import AbstractModel, Record
from hysteresis._precision import in_own_precision
from hysteresis._serialisation import described
from identify import FitResult


@in_own_precision
def invert(
    fit_or_model: FitResult | AbstractModel, *arguments: Any, **options: Any
) -> AbstractCompensator:
    """`compensate.invert` of a model; or of a fit, limited to the trained inputs and with a deviation.

    ```math
    \\hat u = \\mathrm{clip}(\\hat u_\\text{inverse}, low, high)
    ```

    where low and high are the least and the greatest input of the training rows. A step in time longer than
    a thousand times the record is taken for that long and EXTRAPOLATED, as in exports.

    The deviation of an estimate is the error by level and branch of models that were fitted without one
    cycle, or sequence, each, on the cycle that they have not seen, see `calibrated`. Of a record without
    two cycles it is the error of the model, times that on held-out parts of the training rows over that on
    fitted ones. It grows where the last reversals or the speed are unlike those of the training rows. Where
    it holds fewer than 0.8 of the test rows, it is scaled so that it holds nine tenths of them;
    `coverage_before` is what it held. Value +- 1.645 deviations should hold nine of ten inputs; `coverage`
    is the part of the test rows that they do hold, NaN without test rows. Draws of a posterior,
    `invert(posterior.model)`, tell what the parameters alone leave open, which is less.

    The band is learnt once, and saved with the fit: whatever uses it shows the same one.

    With `start="unknown"`, as `hysid export` writes it, the status is RUN_IN until estimates that begin
    where the training may have left a specimen agree to the usual deviation, see `GuardedCompensator`.

    **Arguments:** a fit of one input, or a model; the others are those of `compensate.invert`. `beyond` and
    `start` choose another guard, `trained` and `longest` other limits.

    **Raises:** `InputError` where the model has no inverse, see `compensate.invert`.

    **Example:**

        >>> found = hysid.invert(fit).simulate(None, [30.0, 1e9])
        >>> [compensate.Status(int(s)).name for s in found.status]
        ['OK', 'EXTRAPOLATED']
    """
    if not isinstance(fit_or_model, FitResult):
        return invert_model(fit_or_model, *arguments, **options)
    fit = fit_or_model
    learnt = error_of(fit)
    guarded = invert_model(fit.model, *arguments, **(guard_of(fit, learnt) | options))
    learnt = replace(learnt, has_draws=False, units=guarded.units)
    return learnt.around(guarded)


def exported(fit: FitResult) -> AbstractCompensator:
    """The compensator as `hysid export` writes it: switched on at any time."""
    return invert(fit, start="unknown")


def guard_of(fit: FitResult, error: CalibratedCompensator) -> dict[str, Any]:
    """What a fit's compensator is guarded by: options of `compensate.invert`."""
    used = fit.train.mask & np.isfinite(fit.train.output)
    rows, time = longest_sequence(fit.train, used), fit.train.time
    return {
        "trained": fit.trained,
        "longest": None if time is None else longest_step(time[rows][used[rows]]),
        "past": past_of(fit),
        "deviation": float(np.median(np.asarray(error.error))),
        "seen": (float(fit.train.output[used].min()), float(fit.train.output[used].max())),
    }


def past_of(fit: FitResult) -> Past:
    """What the fitted specimen has been through: the longest sequence of the training rows."""
    rows = longest_sequence(fit.train, fit.train.mask & np.isfinite(fit.train.output))
    return Past(None if fit.train.time is None else fit.train.time[rows], fit.train.input[rows])


def error_of(fit: FitResult) -> CalibratedCompensator:
    """The compensator of a fit, limited to the trained inputs, with the error that `invert` shows.

    It is learnt at its first use, and then kept with the fit.
    """
    digest, kept = _digest(fit), fit.compensator or {}
    is_kept = kept.get("band_of") == digest
    known = invert_model(fit.model, trained=fit.trained, past=None if is_kept else past_of(fit))
    if not is_kept:
        left_out = [
            LeftOut(rows, invert_model(model, trained=fit.trained))
            for rows, model in identify.internal.models_without_groups(fit)
        ]
        ahead, own = 1.0, fit.metrics["train"]
        if not left_out and own is not None and own.nrmse_percent > 0 and np.isfinite(fit.score):
            ahead = max(1.0, fit.score / own.nrmse_percent) ** 2  # held-out parts over fitted ones
        learnt = calibrated(known, fit.train, ahead=ahead, left_out=left_out)
        if fit.test is not None:
            learnt = checked(learnt, fit.test)
        kept = kept | {"band": in_words(learnt), "band_of": digest}
        # What is kept is no part of the fit: it only need not be computed again.
        object.__setattr__(fit, "compensator", kept)
    return of_words(kept["band"], known)


def _digest(fit: FitResult) -> str:
    """Of what a band is learnt from: the model, and the rows of both records."""
    structure, arrays = described(fit.model, for_file=False)
    code = hashlib.sha256(json.dumps(structure, sort_keys=True, default=str).encode())
    for name in sorted(arrays):
        code.update(np.ascontiguousarray(arrays[name]).tobytes())
    for record in (fit.train, fit.test):
        code.update(b"-" if record is None else record.digest().encode())
    return code.hexdigest()


def longest_sequence(record: Record, used: np.ndarray) -> slice:
    """The rows of the sequence of which most are used: others may be held out as a whole."""
    return max((rows for _, rows in record.sequences()), key=lambda rows: int(used[rows].sum()))
