"""Several specimens fitted together: some parameters are the same in all of them, the others of each."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from hysteresis import InputError, Record

from .._levels import STEPS
from ..parameters._transform import Transform
from ..parametric._levenberg_marquardt import Found
from ..parametric._levenberg_marquardt import least_squares as levenberg_marquardt_from
from ..parametric._multistart import FEW, longer, scaled_residuals
from ..parametric._standard_errors import covariance_of
from ..records._folds import held_out_errors
from ..results._fit_result import FitResult
from ._candidates import Asked, candidates
from ._parametric import LeastSquares, ParametricCandidate, explained
from ._training_data import Options, Report, Said, training_data
from ._verdict import check_purpose, judge


def fit_shared(
    records: Sequence[Record],
    model: Asked,
    *,
    share: Sequence[str],
    tests: Sequence[Record | None] | None = None,
    parameters: Said | None = None,
    starts: int = 32,
    seed: int = 0,
    purpose: str = "predict",
    progress: Report | None = None,
) -> tuple[FitResult, ...]:
    r"""Fit a model of few parameters to several specimens, some parameters being the same in all of them:

    ```math
    \min \sum_k \sum_i w_{ki}^2 \, (f(u_k; s, p_k)_i - y_{ki})^2
    ```

    s are the shared parameters, p_k those of specimen k. Every specimen is fitted alone first. The errors
    are those of the joint Jacobian J, (J'J)^-1 J'VJ (J'J)^-1, with the size and the correlation time of
    each specimen's own residuals in V; the kind of noise is not chosen.

    **Arguments:**

    - `records`: one of each specimen, all in the same units, all or none with a sigma.
    - `model`: a name or a model to start from, of few parameters, see `fit`.
    - `share`: names of the parameters that are the same, such as ["E1"].
    - `tests`: a record of each specimen to judge on, None for none.
    - `parameters`, `starts`, `seed`, `purpose`, `progress`: as in `fit`.

    **Returns:** a `FitResult` of each specimen, in the order of the records.

    **Raises:** `InputError` as `fit` does, and `bad-option` for fewer than two records, a model of
    weights, other units, a sigma of some alone, priors, and a name that is no free parameter of each.

    **Example:**

        >>> both = identify.fit_shared([record, record], "LinearSponge", share=["K"], starts=2)
        >>> both[0]["K"].value == both[1]["K"].value
        True
    """
    begin = time.perf_counter()
    say = progress or (lambda _: None)
    check_purpose(purpose)
    (asked, *more) = candidates(model)
    if more or not isinstance(asked, ParametricCandidate):
        raise _refused(
            "The model is not one of few parameters.", "Name one such model (--model Burgers)."
        )
    weights = _weights_of(records)
    options = Options("auto", starts, seed, "gaussian", parameters or {}, True, say)
    data = [
        training_data(
            record, test, keep_conditioning=True, keep_clocks=True, may_modulate=False, say=say
        )
        for record, test in zip(records, tests or [None] * len(records), strict=True)
    ]
    joint = _Joint([asked.searched(one, options) for one in data], share, weights)
    found = joint.found(joint.start, STEPS)
    free = np.asarray(found.free)
    searches = [joint.search(k, free, bool(found.converged)) for k in range(len(data))]
    variances, rows = [], 0
    for search, weight in zip(searches, weights, strict=True):
        left = search.evidence(search.optimum.predicted[: len(search.data.record)])
        error = (search.data.record.weights * left.residuals)[left.used]
        own = float(np.mean(error**2)) * left.noise.correlation_time
        variances.append(np.full(len(search.problem.measured), own * (weight / joint.size) ** 2))
        rows += len(error)
    spent = rows / max(rows - len(free), 1)
    covariance = covariance_of(np.asarray(found.jacobian), spent * np.concatenate(variances))
    note = f"{', '.join(share)} shared by {len(data)} specimens; errors are of all their rows."
    fits = []
    for search, at, one in zip(searches, joint.places, data, strict=True):
        fit = one.tested(explained(search, None, covariance[np.ix_(at, at)]))
        fit = replace(fit, notes=(note,), baselines=one.baselines(), purpose=purpose)
        fits.append(replace(fit, verdict=judge(fit, one.warnings)))
    seconds = time.perf_counter() - begin
    return tuple(replace(fit, candidates=(fit,), seconds=seconds) for fit in fits)


def _weights_of(records: Sequence[Record]) -> list[float]:
    """By what the errors of each record are multiplied beside its own weights: sigma is one for all."""
    units = {(one.input_unit, one.output_unit, one.time_unit) for one in records}
    sizes = [1.0 if one.sigma is None else one.typical_sigma for one in records]
    for wrong, said, fix in (
        (len(records) < 2, "There is one specimen.", "Give two records or more."),
        (len(units) > 1, "Specimens have other units.", "Give them in the same units."),
        (len({one.sigma is None for one in records}) > 1, "Not all have a sigma.", "Give it to all."),
    ):  # fmt: skip
        if wrong:
            raise _refused(said, fix)
    return [min(sizes) / size for size in sizes]


def _refused(said: str, fix: str) -> InputError:
    return InputError("bad-option", f"Parameters cannot be shared. {said}", fix=fix)


class _Joint:
    """The joint problem of specimens that were searched alone.

    - `places`: of each one's free parameters among all of them; `start`: where these start.
    - `size`: of a residual, in the output's unit.
    """

    def __init__(
        self, alone: Sequence[LeastSquares], share: Sequence[str], weights: Sequence[float]
    ) -> None:
        bounds = [one.problem.bounds for one in alone]
        self.bounds, self.weights = bounds[0], weights
        names = self.bounds.names
        odd = [name for name in share if name not in names] or [""] * (not share)
        for wrong, said, fix in (
            (len({own.names for own in bounds}) > 1, "The models differ.", "Give one to start from."),
            (odd, f"{', '.join(odd)!r} is not free.", f"Share some of {', '.join(names)}."),
            (self.bounds.asked, "A parameter has a prior.", "Leave it out."),
        ):  # fmt: skip
            if wrong:
                raise _refused(said, fix)
        common = np.isin(names, share)
        # Unbounded parameters are in units of the record: here of the first one.
        each = [
            self.bounds.from_values(own.to_values(one.optimum.free))
            for own, one in zip(bounds, alone, strict=True)
        ]
        self.alone = [
            replace(one, problem=one.problem._replace(bounds=self.bounds)) for one in alone
        ]
        count, own = int(common.sum()), int((~common).sum())
        shared = np.cumsum(common) - 1
        self.places = [
            np.where(common, shared, count + own * k + np.arange(len(names)) - shared - 1)
            for k in range(len(alone))
        ]
        self.start = np.concatenate([np.mean(each, 0)[common], *(z[~common] for z in each)])
        self.arguments = [self._arguments(k, one.data.parts.all) for k, one in enumerate(alone)]
        rows = sum(np.count_nonzero(a[3]) for a in self.arguments)
        self.size = np.asarray(max(float(a[4]) for a in self.arguments) * np.sqrt(rows))

    def _arguments(self, k: int, which: tuple[int, ...]) -> tuple[Any, ...]:
        one = self.alone[k]
        record = one.data.record
        used = np.isin(one.data.parts.label, which) * self.weights[k] * record.weights
        return one.problem.arguments(longer(used))

    def found(self, z: np.ndarray, steps: int, but: Mapping[int, Any] | None = None) -> Found:
        """The joint optimum from z; `but`: other arguments of some specimens."""
        arguments = [(but or {}).get(k, own) for k, own in enumerate(self.arguments)]
        start, limit = jnp.asarray(z), np.asarray(steps)
        return _run(self.bounds, self.places, self.size, arguments, start, limit)

    def search(self, k: int, z: np.ndarray, converged: bool) -> LeastSquares:
        """The search of one specimen at the joint optimum, with the errors of its held-out parts."""
        one, at = self.alone[k], z[self.places[k]]
        y, weights = one.data.record.output, one.data.record.weights

        def solve(train: tuple[int, ...]) -> np.ndarray:
            beside = self.found(z, FEW, {k: self._arguments(k, train)}).beside
            return np.asarray(beside[k])[: len(y)]

        def error(predicted: np.ndarray, test: tuple[int, ...]) -> np.ndarray:
            rows = np.isin(one.data.parts.label, test)
            return (weights * (predicted - y))[rows]

        blocks = held_out_errors(one.data.parts.folds, solve, error)
        optimum = one.problem.refined(self.arguments[k][3], at, steps=1)
        return replace(one, blocks=blocks, optimum=optimum._replace(free=at, converged=converged))


@eqx.filter_jit
def _run(bounds: Transform, places: Any, size: Any, arguments: Any, z: Array, limit: Any) -> Found:
    def residuals(z: Array, arguments: Any) -> tuple[Array, Any]:
        each = [scaled_residuals(bounds, z[at], a) for at, a in zip(places, arguments, strict=True)]
        # Over one size for all, not the range of each and the root of its rows.
        sizes = [a[4] * jnp.sqrt((a[3] > 0).sum()) / size for a in arguments]
        whole = [s * r for s, (r, _) in zip(sizes, each, strict=True)]
        return jnp.concatenate(whole), tuple(predicted for _, predicted in each)

    rows = sum((a[3] > 0).sum() for a in arguments)
    return levenberg_marquardt_from(residuals, z, arguments, rows, limit)
