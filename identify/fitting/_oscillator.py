"""`fit` of an oscillator: the search for its class, and what of it the result of a fit says."""

import re
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from hysteresis import (
    AbstractModel,
    BoucWenForce,
    DuhemForce,
    GeneralizedPlays,
    InputError,
    Note,
    Oscillator,
    Record,
    parameters,
)
from hysteresis._format import quantity
from hysteresis._verdict import Verdict
from hysteresis.numerics._functions import NORMAL_95

from ..dynamics._classes import CLASSES, COARSER, search
from ..dynamics._linear_approximation import LinearApproximation, linear_approximation
from ..dynamics._measured_motion import MeasuredMotion, measured_motion
from ..dynamics._output_error import (
    PLANT,
    STATE,
    Optimum,
    RecordedMotion,
    Setting,
    covariance_of,
    levenberg_marquardt,
)
from ..noise._residual_statistics import Noise, estimate_noise
from ..records._folds import QUARTERS, block_errors
from ..results._detail import Motion, digest_of
from ..results._fit_result import Candidate, FitResult, Parameter
from ..results._goodness_of_fit import Baseline, Metrics, metrics
from ._candidates import OSCILLATOR
from ._verdict import judge

NAMES = (OSCILLATOR, *(f"{OSCILLATOR}({one})" for one in CLASSES))
"""What `fit` and --model call them; without a class, all classes are tried."""


def oscillator_asked(model: Any) -> str | None:
    """The name of an oscillator out of `NAMES`, where that is what is asked for; None for other models.

    Raises `InputError` `unknown-model` for an oscillator around an unknown class, `bad-option` where other
    models are asked for beside it.
    """
    if model is Oscillator:
        return OSCILLATOR
    if isinstance(model, list | tuple) and len(model) == 1:
        (model,) = model
    if not isinstance(model, str):
        return None
    parts = [part.strip() for part in re.split(r",(?![^(]*\))", model)]
    ours = [part for part in parts if part.casefold().startswith(OSCILLATOR.casefold())]
    if not ours:
        return None
    if len(parts) > 1:
        raise InputError(
            "bad-option",
            f"{model}: an oscillator is not compared with models without a mass.",
            fix=f"fit {ours[0]} alone, and the others in a fit of their own.",
        )
    for name in NAMES:
        if name.casefold() == ours[0].replace(" ", "").casefold():
            return name
    raise InputError("unknown-model", f"No model {ours[0]!r}; have {', '.join(NAMES)}.")


def fit_oscillator(
    name: str,
    record: Record,
    test: Record | None,
    *,
    period: int | None = None,
    oversampling: int = 20,
    starts: int = 32,
    seed: int = 0,
    purpose: str = "predict",
    say: Callable[[str], None] = lambda _: None,
) -> FitResult:
    """The oscillator of a record, its class chosen by evidence where the name leaves it open.

    Raises `InputError` as `measured_motion`, `linear_approximation` and `search` do, and `bad-option` for
    an oversampling below 1.
    """
    begin = time.perf_counter()
    if oversampling < 1:
        raise InputError("bad-option", f"oversampling={oversampling}; at least 1.")
    if record.sigma is not None:
        raise InputError(
            "bad-option",
            "An oscillator has noise of one size: it cannot weigh rows by sigma.",
            fix="leave --sigma out.",
        )
    motion = measured_motion(record, period)
    linear = linear_approximation(motion)
    warnings = [*warnings_of(motion, linear, oversampling)]
    asked = name[len(OSCILLATOR) + 1 : -1] or None
    tried, chi2 = search(
        motion, linear, asked, oversampling=oversampling, starts=starts, seed=seed, say=say
    )
    best, *others = tried
    model, stages = model_of(best), best.setting.stages
    y, v, z = map(float, (best.family.T @ best.q)[PLANT:][:STATE])
    recorded = RecordedMotion(
        model, motion.dt, oversampling, stages, motion.period, (y, v, z), motion.force
    )
    detail = Motion(
        recorded, best.chi, motion.sigma, tuple(one.words for one in tried), linear,
        (digest_of(record), digest_of(test)), best.name == "BoucWen", tuple(chi2),
    )  # fmt: skip
    listed, covariance = _parameters(model, best, record)
    predicted = recorded.as_fitted(record.input)
    used = np.zeros(len(predicted), bool)
    used[motion.rows[0] : motion.rows[1]] = True
    residuals = np.where(record.mask, predicted - np.asarray(record.output, float), np.nan)
    blocks, span = _held_out(best, record), float(np.ptp(record.output[used]))
    fitted = FitResult(
        name=f"{OSCILLATOR}({best.name})",
        model=model,
        parameters=listed,
        covariance=covariance,
        residuals=residuals,
        used=used,
        metrics={"train": metrics(record.output, predicted, used), "test": None},
        success=best.converged or best.chi < motion.explained,
        score=np.nan if blocks is None else 100 * float(np.sqrt(blocks.mean())) / span,
        noise=estimate_noise([residuals[used]], len(covariance)),
        train=record,
        test=test,
        notes=_notes(best),
        blocks=blocks,
        purpose=purpose,
        detail=detail,
        seed=seed,
    )
    fitted = _tested(fitted)
    fitted = replace(fitted, baselines=(_linear_baseline(fitted, motion, linear),))
    warnings += [*misfit_of(fitted, motion, detail)]
    seconds = time.perf_counter() - begin
    fitted = replace(fitted, verdict=judge(fitted, tuple(warnings)), seconds=seconds)
    return replace(fitted, candidates=(fitted, *map(_candidate, others)))


def model_of(found: Optimum) -> Oscillator:
    """The oscillator of a fit in its own terms."""
    family, theta = found.family, found.family.T @ found.q
    m, c, k = theta[:PLANT]
    own = theta[PLANT + STATE :]
    hysteresis: AbstractModel
    rate, plays = family.rate, family.plays
    if rate is None:
        hysteresis = GeneralizedPlays(plays.radii, plays.reach, own, plays.knots)
    elif found.name == "BoucWen":
        alpha, gamma, delta = found.q[family.words["first"] :] * (1, -1, -1)
        hysteresis = BoucWenForce(alpha=alpha, beta_gamma=gamma, beta_delta=delta)
    else:
        rising, falling = np.split(own, 2)
        hysteresis = DuhemForce(rising, falling, rate.limit)
    c = max(c, 0.0) if c > -1e-12 else c
    return Oscillator(m, c, k, hysteresis, found.setting.substeps)


def _parameters(
    model: Oscillator, optimum: Optimum, record: Record
) -> tuple[tuple[Parameter, ...], Float[np.ndarray, "free free"]]:
    """Plant, and the coefficients of Bouc-Wen's force, with 90 % intervals; of others the plant alone.

    The covariance is that of the normal equations, times chi2: the noise is what the fit leaves.
    """
    chi2 = optimum.chi * optimum.rows / max(optimum.rows - optimum.effective, 1.0)
    covariance = covariance_of(optimum.normal) * chi2
    unit = np.eye(len(optimum.q))
    rows = [*unit[:PLANT]]
    if optimum.name == "BoucWen":
        first = optimum.family.words["first"]
        rows += [unit[first], -unit[first + 1], -unit[first + 2]]
    words = model.unit_words(record.input_unit, record.output_unit, record.time_unit)
    named = [
        (name, float(value), info.in_units(words))
        for name, info, value in parameters(model)
        if not info.fixed and np.ndim(value) == 0
    ]
    picked = np.array(rows)
    among = picked @ covariance @ picked.T
    errors = np.sqrt(np.diag(among))
    listed = tuple(
        Parameter(
            name, value, unit, float(error), "free",
            value - NORMAL_95 * float(error), value + NORMAL_95 * float(error),
        )
        for (name, value, unit), error in zip(named, errors, strict=False)
    )  # fmt: skip
    return listed, among


def _tested(fit: FitResult) -> FitResult:
    """With the figures of the test record."""
    test = fit.test
    if test is None:
        return fit
    predicted = fit.predict(test)
    return replace(
        fit,
        metrics=fit.metrics | {"test": metrics(test.output, predicted, test.mask)},
        test_blocks=np.array(block_errors((predicted - test.output)[test.mask])),
    )


def _held_out(optimum: Optimum, record: Record) -> Float[np.ndarray, " blocks"] | None:
    """Squared errors of the last period, or quarter, predicted from a fit to the others, in blocks; None
    of a single period."""
    y, motion = np.asarray(record.output, float), optimum.setting.motion
    coarse = max(1, optimum.setting.substeps // COARSER)
    if motion.periodic:
        first, end = motion.rows
        parts = y[first:end].reshape(-1, motion.period)
        if len(parts) < 2:
            return None
        own = replace(motion, displacement=parts[:-1].mean(0))
        whole = setting = Setting.of(own, coarse, (), max(optimum.setting.warm, 1))
        y, cut, how = parts[-1], 0, {"steps": 2, "damping": 1e-6}
    else:
        whole, how = Setting.of(motion, coarse, (), 0), {"steps": 4, "damping": 1e-4}
        y, cut = y[: len(motion.force)], len(motion.force) - len(motion.force) // QUARTERS
        part = replace(
            motion, force=motion.force[:cut], displacement=motion.displacement[:cut], rows=(0, cut)
        )
        setting = replace(whole, motion=part, force=whole.force[: (cut - 1) * coarse + 1])
    new = levenberg_marquardt(
        setting, optimum.family, optimum.q, deviations=optimum.deviations, **how
    )
    predicted, _ = whole.simulated(new.family, new.q, jacobian=False)
    return np.array(block_errors((predicted - y)[cut:]))


def _linear_baseline(
    fit: FitResult, motion: MeasuredMotion, linear: LinearApproximation
) -> Baseline:
    """The best linear oscillator on the same rows: without hysteresis."""
    none = BoucWenForce(alpha=1e-12 * linear.stiffness)
    plain = Oscillator(linear.mass, max(linear.damping, 0.0), linear.stiffness, none)
    detail = fit.detail
    assert isinstance(detail, Motion)
    own = replace(detail.recorded, model=plain)
    tested = _tested(replace(fit, model=plain, detail=replace(detail, recorded=own)))
    predicted = own.as_fitted(fit.train.input)
    figures = tested.metrics | {"train": metrics(fit.train.output, predicted, fit.used)}
    error = (predicted - fit.train.output)[fit.used]
    rows = motion.period if motion.periodic else len(error) // QUARTERS
    blocks = np.array(block_errors(error[-rows:]))
    blocks = blocks if fit.blocks is not None and len(fit.blocks) == len(blocks) else np.array([])
    span = float(np.ptp(fit.train.output[fit.used]))
    score = 100 * float(np.sqrt(blocks.mean())) / span if len(blocks) else np.nan
    return Baseline("linear oscillator", score, figures, blocks, tested.test_blocks)


def _notes(found: Optimum) -> tuple[str, ...]:
    stages, substeps = found.setting.stages, found.setting.substeps
    kept = "sampled without a filter"
    if by := " x ".join(map(str, stages)):
        kept = f"decimated by {by} with a low-pass filter of 31 taps a stage"
    return (
        *(note.text for note in found.setting.motion.notes),
        f"The motion is integrated in {substeps} steps a sample, and taken as {kept}.",
        f"chi2 per row is {found.chi:.4g}; noise alone leaves 1.",
    )


def warnings_of(
    motion: MeasuredMotion, linear: LinearApproximation, oversampling: int
) -> tuple[Note, ...]:
    """What to say before a fit: aliasing, too few steps of integration, too few samples a cycle."""
    found = []
    top = float(linear.frequencies[-1])
    rate = 1 / motion.dt
    if top > 0.45 * rate:
        text = (
            f"The force has frequencies up to {top:.4g} at a sampling rate of {rate:.4g}: what lies"
        )
        text += " between its samples is not known. Sample faster, or excite a lower band."
        found.append(Note("aliasing", text))
    resonance = linear.resonance
    if oversampling * rate < 40 * resonance:
        text = f"{oversampling * rate / max(resonance, 1e-300):.0f} steps of integration a cycle of the"
        text += " resonance are coarse. Use a larger --oversampling."
        found.append(Note("coarse-integration", text))
    elif rate < 6 * resonance:
        text = f"The record has {rate / resonance:.1f} samples a cycle of the resonance. Sample faster."
        found.append(Note("coarse-sampling", text))
    return tuple(found)


def misfit_of(fit: FitResult, motion: MeasuredMotion, detail: Motion) -> tuple[Note, ...]:
    """What its residuals and its damping say against a fit."""
    found = []
    if detail.chi2 > motion.explained:
        left = quantity(
            float(np.sqrt(max(detail.chi2 - 1, 0)) * motion.sigma), fit.train.output_unit, 3
        )
        text = f"chi2 per row is {detail.chi2:.3g} where noise alone leaves 1: the class of hysteresis is"
        text += f" wrong by {left} rms."
        if len(detail.classes) == 1:
            text += " Fit --model Oscillator, which tries other classes."
        found.append(Note("wrong-class", text))
    if float(fit.parameters[1].value) < 0:
        text = "The damping is negative: the model gains energy from its damper."
        found.append(Note("negative-damping", text))
    return tuple(found)


def _candidate(found: Optimum) -> Candidate:
    """The figures of a class that was tried, on the training rows: nothing was held out from its fit.

    A row is its mean over n periods and a rest of variance (n - 1) sigma^2, sigma that of the mean.
    """
    motion = found.setting.motion
    span = float(np.ptp(motion.displacement))
    rest = (motion.periods - 1) * motion.sigma**2
    rmse = float(np.sqrt(found.chi * motion.sigma**2 + rest))
    r2 = 1 - rmse**2 / (float(motion.displacement.var()) + rest)
    text = f"chi2 per row {found.chi:.4g}, {found.effective:.0f} effective parameters"
    text += f", BIC {found.bic:.0f}."
    return Candidate(
        name=f"{OSCILLATOR}({found.title})",
        parameters=(),
        metrics={"train": Metrics(rmse, 100 * rmse / span, float("nan"), r2), "test": None},
        success=found.converged,
        score=float("nan"),
        noise=Noise(rmse, found.rows, 1.0),
        notes=(text,),
        blocks=None,
        noise_model=None,
        noise_evidence={},
        verdict=Verdict("CAUTION", (Note("other-class", text),)),
        seconds=0.0,
        parameter_count=len(found.q),
    )
