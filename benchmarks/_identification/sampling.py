"""How fast posteriors are drawn, beside emcee and lmfit with a good NumPy function; what a kill costs."""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import emcee
import jax.numpy as jnp
import lmfit
import numpy as np
import scipy.signal
import scipy.sparse
import scipy.special

from hysteresis import AbstractModel, Burgers, Preisach, Record
from hysteresis.preisach import GaussianDensity
from identify import FitResult, fit, load, sample, save
from identify.internal import Posterior
from identify.posterior._emcee import _begun as _first
from identify.posterior._emcee import (
    _Run,
    autocorrelation_times,
    first_walkers,
    sample_ensembles,
)
from identify.posterior._log_posterior import Target, target, top_of
from identify.posterior._posterior import Chains, Progress
from identify.posterior._sample import log_probability
from identify.storage._checkpoint import Checkpoint

from .._measure import Row, interleaved, judged

SAMPLES, NOISE, STEP = 1000, 0.01, 0.1
ENSEMBLES, WALKERS = 4, 128

Residuals = Callable[[np.ndarray], np.ndarray]

ROOT = Path(__file__).resolve().parents[2]

CHILD = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
from benchmarks._identification.sampling import kept_on_disk

kept_on_disk(sys.argv[1], sys.argv[2], lambda *said: print("sampling", flush=True))
"""
KILLED_STEPS = 1000

AGAINST_EMCEE = f"{{}}, {SAMPLES} samples: draws a second over plain emcee with NumPy"


class Case(NamedTuple):
    """A fitted model, and its residuals by NumPy: a function of the model's parameters."""

    name: str
    fit: FitResult
    residuals: Residuals


@cache
def cases() -> list[Case]:
    """Burgers and a Gaussian Preisach density, a record of each with a per cent of white noise."""
    random = np.random.default_rng(0)
    t = STEP * np.arange(SAMPLES)
    levels = np.tile([0.0, 5.0, 5.0, 5.0, 1.0, 1.0, 3.0, 3.0], 3)[:17]
    u = np.interp(t, np.linspace(0, t[-1], 17), levels)
    burgers = _fitted(Burgers(2.0, 100.0, 1.0, 8.0, 0.3), t, u, random)
    sizes = np.array([0, 1, 0.1, 0.85, 0.25, 0.7, 0.4, 0.6, 0.3, 0.9, 0, 1])
    v = 2 * np.interp(np.linspace(0, 11, SAMPLES), np.arange(12), sizes) - 1
    density = GaussianDensity(-1.0, 1.0, 1.0, 0.3, 0.12, 0.1, 0.2)
    preisach = _fitted(Preisach(density, offset=0.3), None, v, random)
    return [
        Case("Burgers", burgers, burgers_residuals(t, u, burgers.train.output)),
        Case("Preisach, GaussianDensity", preisach, preisach_residuals(v, preisach.train.output)),
    ]


def _fitted(
    truth: AbstractModel, t: np.ndarray | None, u: np.ndarray, random: np.random.Generator
) -> FitResult:
    y = np.asarray(truth.simulate(t, u))
    y = y + random.normal(0, NOISE * np.ptp(y), len(y))
    record = Record.from_arrays(u, y, t)
    # White noise, as the peers have it.
    return fit(record, truth, starts=4, conditioning="keep", clocks="keep", noise="gaussian")


def burgers_residuals(t: np.ndarray, u: np.ndarray, y: np.ndarray) -> Residuals:
    """Residuals of (E1, eta1, E2, eta2, offset): exact steps at an even clock, by one call of `lfilter`."""
    dt = float(t[1] - t[0])
    flow = np.append(0.0, np.cumsum((u[1:] + u[:-1]) / 2 * dt))

    def residuals(p: np.ndarray) -> np.ndarray:
        E1, eta1, E2, eta2, offset = p
        a = np.exp(-dt * E2 / eta2)
        w = eta2 / E2 / dt * (1 - a)
        delayed = scipy.signal.lfilter([(1 - w) / E2, (w - a) / E2], [1.0, -a], u)
        return u / E1 + flow / eta1 + delayed + offset - y

    return residuals


def preisach_residuals(u: np.ndarray, y: np.ndarray) -> Residuals:
    """Residuals of (total, coercivity, its width, bias, its width, offset) over [-1, 1].

    The memory is worked out once: the output is linear in the Everett function at a few more pairs of
    inputs than there are samples. Those come from one call over all pairs and nodes, by an integral over
    the coercivity that leaves 1e-13, without its pieces that are empty. (`GaussianDensity` has it from
    bivariate normal integrals, which SciPy has not for arrays.)
    """
    pairs, signs = _memory(u)
    a, b = np.append(pairs[:, 0], 1.0), np.append(pairs[:, 1], -1.0)
    half = (a - b) / 2
    nodes, rule = np.polynomial.legendre.leggauss(24)
    nodes, rule = (nodes + 1) / 2, rule / 2

    def residuals(p: np.ndarray) -> np.ndarray:
        total, centre, width, bias, bias_width, offset = p
        jump = np.clip(np.minimum(a - bias, bias - b), 0.0, half)
        begin, jump, end = (
            np.clip((h - centre) / width, -8.5, 8.5) for h in (np.zeros_like(half), jump, half)
        )
        peak = np.clip(0.0, begin, end)
        cuts = np.stack([begin, np.minimum(jump, peak), np.maximum(jump, peak), end])
        piece, pair = np.nonzero(np.diff(cuts, axis=0) > 0)
        left, length = cuts[piece, pair], cuts[piece + 1, pair] - cuts[piece, pair]
        z = left[:, None] + length[:, None] * nodes
        h = centre + width * z
        scale = 1 / (bias_width * np.sqrt(2))
        share = scipy.special.erf((a[pair, None] - bias - h) * scale)
        share -= scipy.special.erf((b[pair, None] - bias + h) * scale)
        integral = np.bincount(pair, (share * np.exp(-z * z / 2)) @ rule * length, len(a))
        return signs @ (integral[:-1] * (total / integral[-1])) + (offset - total) - y

    return residuals


def _memory(u: np.ndarray) -> tuple[np.ndarray, scipy.sparse.csr_array]:
    """Pairs of inputs (pairs, 2), and of every sample the signs, times 2, that their Everett values have:
    the open loops of a path that starts in negative saturation at -1."""
    numbers: dict[tuple[float, float], int] = {}
    rows, columns, values = [], [], []
    extrema, before, rising = [-1.0], -1.0, True
    for row, x in enumerate(u.tolist()):
        if x != before and (x > before) != rising:
            extrema.append(before)
            rising = not rising
        while len(extrema) > 2 and (x >= extrema[-2] if rising else x <= extrema[-2]):
            del extrema[-2:]
        before = x
        path = [*extrema, x]
        for start, end in pairwise(path):
            pair = (max(start, end), min(start, end))
            rows.append(row)
            columns.append(numbers.setdefault(pair, len(numbers)))
            values.append(2.0 if end > start else -2.0)
    shape = (len(u), len(numbers))
    return np.array([*numbers]), scipy.sparse.csr_array((values, (rows, columns)), shape)


def sampling_rows(quick: bool) -> list[Row]:
    """Draws a second beside plain emcee, `quick` of Burgers alone; effective ones beside lmfit's."""
    found = cases()
    judge = found[:1] if quick else found
    rows = [_against_emcee(case, 4 if quick else 30) for case in judge]
    left = [_unjudged(case) for case in found[len(judge) :]]
    return [*rows, *left, _against_lmfit(found[0], 300 if quick else 2000)]


def _unjudged(case: Case) -> Row:
    return judged(AGAINST_EMCEE.format(case.name), np.nan, 8.0, at_least=True)._replace(
        met=None, reason="left to the full study: compiling takes half a minute"
    )


def _against_emcee(case: Case, rounds: int) -> Row:
    """Draws alone on both sides: neither judges its chains."""
    aim = target(case.fit)
    point, first, _ = _begun(aim)
    place, _, root = map(np.asarray, top_of(aim))
    ours = _Run(density := log_probability(aim), _first(first, density, 0, place, root))
    plainly = function_of(case, aim)
    # The same function, but for a constant, the priors and the weight 1 of white noise.
    again = float(aim.log_likelihood(jnp.asarray(point))) + SAMPLES / 2 * np.log(2 * np.pi)
    assert aim.weight == 1.0
    assert np.isclose(plainly(point), again, rtol=1e-9)
    plain = emcee.EnsembleSampler(first.shape[1], len(point), plainly)
    theirs = lambda: plain.run_mcmc(first[0], 10)  # noqa: E731
    seconds = interleaved({"plain": theirs, "ours": lambda: ours.advance(50)}, rounds)
    ratio = 50 * ENSEMBLES / 10 * seconds["plain"].min() / seconds["ours"].min()
    return judged(AGAINST_EMCEE.format(case.name), float(ratio), 8.0, at_least=True)


def _against_lmfit(case: Case, steps: int) -> Row:
    aim = target(case.fit)
    point, first, run = _begun(aim)
    names, values = aim.bounds.names, to_values(aim)
    parameters = lmfit.Parameters()
    for name, value in zip(names, values(point[:-1]), strict=True):
        parameters.add(name, float(value), min=-np.inf if name == "offset" else 0.0)
    parameters.add("__lnsigma", float(point[-1]))
    places = np.array([[*values(z[:-1]), z[-1]] for z in first[0]])
    minimizer = lmfit.Minimizer(
        lambda p: case.residuals(np.array([p[name].value for name in names])), parameters
    )
    begin = time.perf_counter()
    theirs = minimizer.emcee(
        steps=steps, nwalkers=len(places), pos=places, is_weighted=False, progress=False, seed=0
    )
    taken = time.perf_counter() - begin
    chain = theirs.chain[steps // 4 :]
    effective = chain[..., 0].size / autocorrelation_times(chain[None]).max() / taken
    begin = time.perf_counter()
    ours = run(1000).ess.min() / (time.perf_counter() - begin)
    what = f"{case.name}, {SAMPLES} samples: effective draws a second over lmfit's emcee"
    return judged(what, float(ours / effective), 20.0, at_least=True)


def _begun(aim: Target) -> tuple[np.ndarray, np.ndarray, Callable[[int], Chains]]:
    """The top, first walkers (ensembles, walkers, parameters), and a call that draws so many steps."""
    (place, _, root), density = map(np.asarray, top_of(aim)), log_probability(aim)
    first = first_walkers(density, place, root, ENSEMBLES, WALKERS, 0)
    nothing = Checkpoint(None)

    def run(steps: int) -> Chains:
        return sample_ensembles(
            density, first, place, root, 0, steps, steps, nothing, lambda *_: None
        )

    run(20)  # compiled now
    return place, first, run


def to_values(aim: Target) -> Callable[[np.ndarray], np.ndarray]:
    """From the free space to parameters: the logarithm of the positive ones, else in units of a scale."""
    positive, scale = np.isfinite(aim.bounds.low), np.asarray(aim.bounds.scale)
    return lambda z: np.where(positive, np.exp(np.where(positive, z, 0.0)), scale * z)


def function_of(case: Case, aim: Target) -> Callable[[np.ndarray], float]:
    """The log-likelihood of one point of the free space, as a user of emcee writes it, without priors."""
    values = to_values(aim)

    def log_likelihood(point: np.ndarray) -> float:
        r = case.residuals(values(point[:-1]))
        return float(-0.5 * (r @ r) * np.exp(-2 * point[-1]) - SAMPLES * point[-1])

    return log_likelihood


def _seconds(call: Callable[[], Any]) -> float:
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def kill_rows(quick: bool) -> list[Row]:
    """Processes killed at random moments while they draw, and resumed: how many end as if uninterrupted."""
    kills = 2 if quick else 20
    random = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        save(cases()[0].fit, Path(folder) / "fit")
        begin = time.perf_counter()
        whole = kept_on_disk(folder, "whole")
        longest = time.perf_counter() - begin
        same = 0
        for k in range(kills):
            _killed(folder, f"{k}", random.uniform(0, 0.6 * longest))
            again = kept_on_disk(folder, f"{k}")
            same += bool(
                np.array_equal(again.draws, whole.draws)
                and np.array_equal(again.log_probability, whole.log_probability)  # type: ignore[arg-type]
            )
    what = f"killed while sampling, {kills} times: resumed chains that are the uninterrupted ones"
    return [judged(what, same, kills, at_least=True)]


def kept_on_disk(folder: str, name: str, progress: Progress | None = None) -> Posterior:
    """Draw from the saved fit, written to disk after every block, going on from what is there."""
    return sample(
        load(Path(folder) / "fit"), KILLED_STEPS, checkpoint=Path(folder) / f"{name}.h5",
        resume=True, every=0.0, progress=progress,
    )  # fmt: skip


def _killed(folder: str, name: str, after: float) -> None:
    """A process that draws, killed so many seconds after its first block."""
    command = [sys.executable, "-c", CHILD, folder, name]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as child:
        assert child.stdout is not None
        child.stdout.readline()
        time.sleep(after)
        child.kill()
