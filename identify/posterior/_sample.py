"""`sample`: draws from the posterior of a fit, by ensembles of emcee."""

import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from hysteresis import InputError
from hysteresis._serialisation import described
from hysteresis.numerics._functions import NORMAL_95

from .._levels import FEW, SOME_ROWS, UNCERTAIN
from ..results._detail import (
    Composition,
    DiscreteSpectrum,
    FoldedState,
    GridWeights,
    Motion,
    ReversalCurves,
)
from ..results._fit_result import FitResult
from ..storage._checkpoint import Checkpoint, digest
from ..storage._file_set import versions
from ._emcee import LogProbability, first_walkers, sample_ensembles
from ._linear_weights import sample_weights
from ._log_posterior import Target, target, top_of
from ._motion_target import MotionTarget, motion_target
from ._posterior import Chains, Posterior, Progress, per_row, posterior_of

MOST_STEPS = 20_000
DOUBTFUL, WIDE, PILOT = 0.5, 1.0, 600
"""Deviation of a logarithm from which on a posterior may have long tails; that from which on the parameter
is held, if a short run shows it; steps of that run."""


def sample(
    fit: FitResult,
    steps: int | None = None,
    ensembles: int = 4,
    seed: int = 0,
    *,
    walkers: int | None = None,
    checkpoint: str | Path | None = None,
    resume: bool = False,
    every: float = 10.0,
    most: int = MOST_STEPS,
    progress: Progress | None = None,
) -> Posterior:
    """Draw from the posterior of a fit, `Target`.

    Models of few parameters: several independent ensembles of emcee's, compiled and side by side, so that
    R-hat means something. Without `steps` they go on until R-hat is below 1.01 and every ensemble holds 50
    autocorrelation times of every parameter; where that is not so after `most` steps, the notes say so.
    Burn-in is five autocorrelation times. First walkers are drawn about the fit from Laplace's covariance,
    wider, each ensemble about a place of its own. Parameters that the data leave open, by a
    deviation of a factor of e and more, keep the value of the fit, and the notes name them; of several that
    the data know together only as many as it takes. A prior of the user's keeps a parameter from that.

    Oscillators around Bouc-Wen's force: emcee on the motion's output error, see `MotionTarget`.

    Weights of a grid or a composition: the same ensembles for the size of the noise, its correlation from
    row to row and the prior's strength, the weights integrated out of the likelihood. Given those the
    weights are Gaussian; up to a hundred draws of each ensemble are projected in their own metric onto the
    models that can be (no negative weight, no falling branch), which keep the sums that the data determine.
    Sums that they leave open are named in the notes.

    **Arguments:** `steps` for each of `ensembles` (total, also when resumed); `seed`.

    **Other arguments:**

    - `walkers`: of each ensemble, even, at least twice the parameters; by default four times them, and no
      less than 16.
    - `checkpoint`: a .npz file that keeps the chains, written every so many seconds (`every`) and when
      interrupted. `resume` goes on from it, bit for bit as if nothing had been interrupted.
    - `progress(done, total, text)` is called now and then.

    After Ctrl-C the draws so far are the result, and the notes say so; before 20 steps there is none.

    Raises `InputError` for a spectrum, reversal curves, a fit without free parameters, too few steps or
    walkers, a checkpoint that belongs to something else, is damaged or cannot be written.

    **Example:**

        >>> drawn = identify.sample(grid_fit, steps=20)
        >>> drawn.names[-3:]
        ('sigma', 'phi', 'prior.strength')
        >>> drawn.draws.shape[:2]
        (4, 20)
    """
    _check(steps, ensembles, seed, most)
    detail = fit.detail
    if isinstance(detail, DiscreteSpectrum):
        raise InputError(
            "no-posterior",
            "a spectrum has no posterior to draw from.",
            fix="what its record leaves open are the errors of its parameters and the range of"
            " `Spectrum.predict` (hysid predict, hysid report).",
        )
    if isinstance(detail, ReversalCurves):
        raise InputError(
            "no-posterior",
            "a model read off reversal curves has no posterior to draw from.",
            fix="fit Preisach to the same record.",
        )
    if isinstance(detail, FoldedState):
        raise InputError(
            "no-posterior",
            "a model of butterfly loops has no posterior to draw from.",
            cause="its weights are those of a state that was not measured.",
            fix="hold out cycles: their error says what the model is worth.",
        )
    begin = time.perf_counter()
    tell = progress or (lambda done, total, text: None)
    file = None if checkpoint is None else Path(checkpoint)
    if isinstance(detail, GridWeights | Composition):
        walkers = walkers_for(walkers, 3)
        identity = _weights_identity(fit, detail, seed, ensembles, walkers)
        kept = Checkpoint(file, identity, resume, every)
        return sample_weights(fit, detail.linear, steps, most, ensembles, walkers, seed, kept, tell)
    held: tuple[str, ...] = ()
    aim: Target | MotionTarget
    if isinstance(detail, Motion):
        aim = motion_target(fit)
    else:
        aim, held = known_target(fit, ensembles, walkers, seed)
    walkers = walkers_for(walkers, len(aim.names))
    kept = Checkpoint(file, _identity(fit, aim, seed, ensembles, walkers), resume, every)
    if isinstance(aim, MotionTarget):
        density, place, root = aim.log_probability, aim.start, aim.root
    else:
        density = log_probability(aim)
        place, _, root = map(np.asarray, top_of(aim))
    first = first_walkers(density, place, root, ensembles, walkers, seed)
    chains = sample_ensembles(density, first, place, root, seed, steps, most, kept, tell)
    chains = chains._replace(notes=(*_held_in_words(fit, held), *chains.notes))
    return _posterior(aim, chains, seed, begin)


def known_target(
    fit: FitResult, ensembles: int, walkers: int | None, seed: int
) -> tuple[Target, tuple[str, ...]]:
    """The log-posterior of the parameters that the data know, and the others, which keep their values.

    Where the fit or Laplace's covariance leaves a bounded parameter uncertain by more than `DOUBTFUL` in
    the free space, a short run shows how wide the posterior is, because a ridge that bends has long tails.
    The parameter that is known worst is held if its deviation is above `UNCERTAIN`, or in the short run
    above `WIDE`, until all others are known. Parameters with a prior of the user's are never held.
    """
    held: tuple[str, ...] = ()
    while True:
        aim = target(fit, held)
        bounds = aim.bounds
        bounded = np.isfinite(bounds.low) | np.isfinite(bounds.high)
        default = np.array([prior.default for prior in bounds.priors])
        may = np.flatnonzero(bounded & default)
        lost = {p.name for p in fit.parameters if p.status == "unidentified"}
        place, _, root = map(np.asarray, top_of(aim))
        sd = np.sqrt((root**2).sum(1))[may]
        if not len(may) or len(bounds.names) < 2 or not (held or lost or (sd > DOUBTFUL).any()):
            return aim, held
        if sd.max() <= UNCERTAIN:
            count, density = walkers_for(walkers, len(aim.names)), log_probability(aim)
            first = first_walkers(density, place, root, ensembles, count, seed)
            nowhere = Checkpoint(None)
            short = sample_ensembles(
                density, first, place, root, seed, PILOT, PILOT, nowhere, lambda *_: None, PILOT
            )
            points = short.points.reshape(-1, len(aim.names))
            low, high = np.quantile(points[:, may], [0.05, 0.95], axis=0)
            sd = np.maximum(points[:, may].std(0), (high - low) / (2 * NORMAL_95))
            if sd.max() <= WIDE:
                return aim, held
        held = (*held, bounds.names[may[int(sd.argmax())]])


def _held_in_words(fit: FitResult, held: tuple[str, ...]) -> tuple[str, ...]:
    said = [f"{p.name} = {p.value:.4g} {p.unit}" for p in fit.parameters if p.name in held]
    if not said:
        return ()
    return (
        f"the data do not determine {', '.join(held)}, so the posterior holds {', '.join(said)}: it is"
        " that of the other parameters given them.",
    )


def log_probability(aim: Target) -> LogProbability:
    """The log-posterior of many points at once, compiled: (points, parameters) -> (points,)."""
    leaves, structure = jax.tree.flatten(aim)
    is_array = [isinstance(leaf, np.ndarray | Array) for leaf in leaves]
    # Split by hand, once: equinox's `filter_jit` does it in every call, which takes as long as the call.
    arrays = [leaf if yes else None for leaf, yes in zip(leaves, is_array, strict=True)]
    rest = tuple(None if yes else leaf for leaf, yes in zip(leaves, is_array, strict=True))
    return lambda points: np.asarray(_log_probability((structure, rest), arrays, points))


@partial(jax.jit, static_argnums=0)
def _log_probability(
    static: Any, arrays: list[Any], points: Float[Array, "points parameters"]
) -> Array:
    structure, rest = static
    leaves = [one if array is None else array for array, one in zip(arrays, rest, strict=True)]
    return jax.vmap(jax.tree.unflatten(structure, leaves).log_probability)(points)


def _check(steps: int | None, ensembles: int, seed: int, most: int) -> None:
    longest = most if steps is None else steps
    if ensembles < 2 or longest < FEW:
        raise InputError(
            "bad-option",
            f"{longest} steps in {ensembles} ensembles say nothing about convergence.",
            fix=f"take at least {FEW} steps and 2 ensembles.",
        )
    if seed < 0:
        raise InputError("bad-option", f"the seed is {seed}.", fix="take a whole number from 0 on.")


def walkers_for(walkers: int | None, parameters: int) -> int:
    if walkers is None:
        return max(4 * parameters, 16)
    if walkers < 2 * parameters or walkers % 2:
        raise InputError(
            "bad-option",
            f"{walkers} walkers for {parameters} parameters.",
            cause="the two halves of an ensemble move by each other's differences, which have to span all"
            " parameters.",
            fix=f"take an even number from {2 * parameters} on.",
        )
    return walkers


def _identity(fit: FitResult, aim: Target | MotionTarget, *run: int) -> dict[str, str]:
    def of(module: Any) -> str:
        structure, arrays = described(module, for_file=False)
        return digest(structure, *arrays.values())

    bounds = aim.bounds
    priors = bounds[:3], bounds[4:], np.asarray(bounds.scale), aim.noise_bounds.priors
    return {
        "model": of(aim.template),
        "data": digest(*_columns(fit), np.asarray(aim.start)),
        "noise": digest(of(aim.noise_template), aim.weight),
        "priors": digest(*priors),
    } | _run_identity("jax", *run)


def _weights_identity(
    fit: FitResult, detail: GridWeights | Composition, *run: int
) -> dict[str, str]:
    return {
        "model": digest(detail.words(), detail.linear.unknowns),
        "data": digest(*_columns(fit), *fit.train.columns.values()),
        "noise": "AR(1)",
        "priors": "of the strength",
    } | _run_identity("scipy", *run)


def _run_identity(library: str, seed: int, ensembles: int, walkers: int) -> dict[str, str]:
    used = sorted(("emcee", library, "numpy"))
    said = ", ".join(f"{name} {versions(used)[name]}" for name in used)
    return {
        "seed": str(seed), "ensembles": str(ensembles), "walkers": str(walkers), "versions": said,
    }  # fmt: skip


def _columns(fit: FitResult) -> tuple[Any, ...]:
    """The data of a fit."""
    record = fit.train
    return record.input, record.output, record.time, record.starts, record.mask, fit.used


def _posterior(aim: Target | MotionTarget, chains: Chains, seed: int, begin: float) -> Posterior:
    """Of a fit: with its prior, and what the draws say of each row."""
    values, free = _prior(aim, seed)
    models = eqx.filter_jit(lambda points: jax.vmap(aim.model)(points))
    found = posterior_of(aim.names, chains, aim.values, models, free.var(0), begin)
    rows = per_row(aim, chains.thinned, seed) if isinstance(aim, Target) else None
    return replace(found, prior=values, per_row=rows)


def _prior(aim: Target | MotionTarget, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Independent draws of the priors, cut off at the bounds: in their units, and in the free space."""
    random, values, free = np.random.default_rng([seed, 2]), [], []
    for bounds in (aim.bounds, aim.noise_bounds):
        columns = [prior.draws(random, SOME_ROWS) for prior in bounds.priors]
        values.append(np.stack(columns, 1))
        free.append(bounds.from_values(values[-1]))
    inside = np.isfinite(np.hstack(free)).all(1)
    return np.hstack(values)[inside], np.hstack(free)[inside]
