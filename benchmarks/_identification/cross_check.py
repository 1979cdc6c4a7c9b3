"""Optima and profile intervals against lmfit and iminuit, which see our residuals and nothing else."""

import warnings
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import AbstractModel, BoucWen, Burgers, Record
from identify import FitResult, fit
from identify.internal import profiles, target

from .._measure import Row, judged

LEVEL = 0.9
SAME, SAME_END = 1e-6, 0.01
"""Relative differences of optima, and of an interval's ends in parts of its width."""

UNIT = 1e6


class Agreement(NamedTuple):
    """Largest relative differences from lmfit's and iminuit's optimum, and from MINOS' ends, in parts of
    its width."""

    lmfit: float
    iminuit: float
    minos: float


def cross_check_rows(quick: bool) -> list[Row]:
    """The worst over a Burgers element and a Bouc-Wen loop; `quick` asks two profiles of each."""
    found = [agreement(made, 2 if quick else None) for made in (burgers(), bouc_wen())]
    worst = Agreement(*np.max(found, axis=0))
    return [
        judged("optimum against lmfit", worst.lmfit, SAME),
        judged("optimum against iminuit", worst.iminuit, SAME),
        judged("profile interval against MINOS", worst.minos, SAME_END),
    ]


def burgers() -> FitResult:
    """Three triangles of force, creep beside it, noise of a per cent."""
    t = 0.2 * np.arange(300)
    return _fitted(Burgers(2.0, 40.0, 1.0, 5.0), t, 10 * np.abs((t / 10 + 1) % 2 - 1))


def bouc_wen() -> FitResult:
    """Two loops of rising width."""
    t = 0.05 * np.arange(200)
    truth = BoucWen(2.0, 0.2, 0.5, 1.5, 0.3, 0.1)
    return _fitted(truth, None, (0.5 + 0.1 * t) * np.sin(2 * np.pi * t / 5))


def _fitted(truth: AbstractModel, t: np.ndarray | None, u: np.ndarray) -> FitResult:
    y = np.asarray(truth.simulate(t, u))
    y = y + 0.01 * np.ptp(y) * np.random.default_rng(0).normal(size=len(u))
    record = Record.from_arrays(u, y, t)
    return fit(record, truth, conditioning="keep", clocks="keep", noise="gaussian", starts=4)


def agreement(made: FitResult, most: int | None = None) -> Agreement:
    """Of the parameters of a fit with Gaussian noise, and of the first `most` profiles.

    lmfit minimises the sum of squares, iminuit -log L with the noise's logarithm as a number more, both in
    the parameters' own units. A parameter near 0 is measured in its standard error.
    """
    import iminuit
    import lmfit

    aim = target(made)
    bounds, names = aim.bounds, list(aim.bounds.names)

    @jax.jit
    def residuals(values: jax.Array) -> jax.Array:
        predicted = bounds.insert(aim.template, values).evaluate(aim.prepared)
        return predicted - aim.measured

    @jax.jit
    def cost(numbers: jax.Array) -> jax.Array:
        r, log_sigma = residuals(numbers[:-1]), numbers[-1]
        # MIGRAD is content 3e-8 above the minimum, whatever it is asked: hence a larger unit.
        return UNIT * (jnp.sum(r**2) / (2 * jnp.exp(2 * log_sigma)) + len(r) * log_sigma)

    ours = bounds.values(made.model)
    error = np.sqrt(np.diagonal(made.covariance))
    begin = ours + 0.3 * error  # their own way down
    asked = lmfit.Parameters()
    for name, value in zip(names, begin, strict=True):
        asked.add(name.replace(".", "_"), value)

    def of_lmfit(p: lmfit.Parameters) -> np.ndarray:
        return np.asarray(residuals(jnp.asarray([x.value for x in p.values()])))

    tight = {"ftol": 1e-15, "xtol": 1e-15, "gtol": 1e-15}
    theirs = lmfit.minimize(of_lmfit, asked, **tight).params  # type: ignore[attr-defined]
    by_lmfit = np.array([x.value for x in theirs.values()])

    slope = jax.jit(jax.grad(cost))
    log_sigma = float(np.log(made.noise.sigma))
    at: Any = lambda x: float(cost(jnp.asarray(x)))  # noqa: E731
    way: Any = lambda x: np.asarray(slope(jnp.asarray(x)))  # noqa: E731
    minuit = iminuit.Minuit(at, np.append(begin, log_sigma), grad=way, name=[*names, "log sigma"])
    minuit.errordef, minuit.strategy, minuit.tol = UNIT / 2, 2, 1e-6
    minuit.errors = [*error, 0.1]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # MIGRAD doubts its own tolerance
        for _ in range(3):
            minuit.migrad()
        by_iminuit = np.array(minuit.values)[:-1]
        chosen = names[:most]
        minuit.minos(*chosen, cl=LEVEL)
    off = []
    for found in profiles(made, chosen, level=LEVEL):
        end = minuit.merrors[found.name]
        value = minuit.values[found.name]
        ends = ((found.low, value + end.lower), (found.high, value + end.upper))
        for ours_end, their_end in ends:
            assert ours_end is not None
            off.append(abs(ours_end - their_end) / (end.upper - end.lower))
    size = np.maximum(np.abs(ours), error)
    return Agreement(
        float(np.max(np.abs(by_lmfit - ours) / size)),
        float(np.max(np.abs(by_iminuit - ours) / size)),
        float(np.max(off)),
    )
