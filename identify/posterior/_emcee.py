"""emcee: independent ensembles advanced together, until they agree and are long enough."""

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from hysteresis import Note

from .._levels import FEW, PART
from ..noise._residual_statistics import autocovariance, integrated_time
from ..storage._checkpoint import Checkpoint
from ._posterior import Chains, Progress, rhat

# How the walkers of several ensembles move, side by side: emcee's interface for moves.


INDEPENDENT, JUMPS = 0.5, PART
"""Parts of the steps: proposals from about the fit, and of the whole difference of two walkers, which leads
from mode to mode (ter Braak 2006). The others are differential evolution's."""

LogProbability = Callable[[np.ndarray], np.ndarray]
"""Of many points at once: (points, parameters) -> (points,)."""

DEGREES = 5.0
"""Of freedom of the proposals from about the fit: their tails are longer than a normal posterior's."""


class SideBySide:
    """A move of emcee's, for several ensembles that do not see each other.

    Each ensemble is halved at random, and the walkers x of one half propose, all in the same way,

        x + g (1 + 1e-5 n) (a - b),      a and b two walkers of the other half, n normal,
        place + root t,                  t of a Student distribution in as many dimensions,

    with g = 2.38 / sqrt(2 parameters), sometimes 1. The first is emcee's `DEMove`; the second an
    independence sampler about the fit, whose draws are new ones where the posterior is near to normal.
    Autocorrelation times on Burgers and on a Gaussian Preisach density, 1,000 and 200 samples: stretch
    move 60 steps, 0.8 DE and 0.2 snooker 24, DE alone 19 and 20, these in equal parts 4 and 5; 28 and 14
    where the fit is a deviation off. All ensembles take one call of the log-probability and no loop over
    walkers.

    **Arguments:** `density`, of many points at once; `ensembles`; `place` (parameters,) and `root`
    (parameters, parameters): the posterior's top, and a root of Laplace's covariance.

    Source: ter Braak, A Markov chain Monte Carlo version of the genetic algorithm differential evolution,
    Statistics and Computing 16 (2006); Tierney, Markov chains for exploring posterior distributions, Annals
    of Statistics 22 (1994).
    """

    def __init__(
        self,
        density: LogProbability,
        ensembles: int,
        place: Float[np.ndarray, " parameters"],
        root: Float[np.ndarray, "parameters parameters"],
    ):
        self.density, self.ensembles, self.place, self.root = density, ensembles, place, root
        self.inverse = np.linalg.pinv(root)

    def propose(self, model: Any, state: Any) -> tuple[Any, np.ndarray]:
        """(emcee's model, its state) -> (the state after, which walkers moved)."""
        from emcee import State

        random, parameters = model.random, len(self.place)
        points = state.coords.reshape(self.ensembles, -1, parameters).copy()
        found = state.log_prob.reshape(self.ensembles, -1).copy()
        accepted = np.zeros(found.shape, bool)
        half, rows = points.shape[1] // 2, np.arange(self.ensembles)[:, None]
        order = np.argsort(random.random_sample(found.shape), axis=1)
        kind = random.random_sample()
        for turn in (0, 1):
            moving = order[:, :half] if turn else order[:, half:]
            resting = order[:, half:] if turn else order[:, :half]
            now, before = points[rows, moving], found[rows, moving]
            if kind < INDEPENDENT:
                proposed = self._about_the_fit(random, now.shape)
                factor = self._log_density(now) - self._log_density(proposed)
            else:
                length = 1.0 if kind > 1 - JUMPS else 2.38 / np.sqrt(2 * parameters)
                proposed = now + length * _differences(random, points[rows, resting])
                factor = 0.0
            # Not emcee's wrapper of it, which prints the walkers when it is interrupted.
            there = self.density(proposed.reshape(-1, parameters)).reshape(before.shape)
            takes = np.log1p(-random.random_sample(before.shape)) < there - before + factor
            points[rows, moving] = np.where(takes[..., None], proposed, now)
            found[rows, moving] = np.where(takes, there, before)
            accepted[rows, moving] = takes
        after = State(points.reshape(-1, parameters), log_prob=found.ravel())
        return after, accepted.ravel()

    def _about_the_fit(self, random: Any, shape: tuple[int, ...]) -> np.ndarray:
        scale = np.sqrt(random.chisquare(DEGREES, (*shape[:-1], 1)) / DEGREES)
        return self.place + random.standard_normal(shape) / scale @ self.root.T

    def _log_density(self, points: np.ndarray) -> np.ndarray:
        squares = (((points - self.place) @ self.inverse.T) ** 2).sum(-1)
        return -(DEGREES + len(self.place)) / 2 * np.log1p(squares / DEGREES)


def _differences(random: Any, walkers: np.ndarray) -> np.ndarray:
    """Between two different walkers of each ensemble (ensembles, half, parameters), stretched by a hair."""
    ensembles, half, _ = walkers.shape
    rows = np.arange(ensembles)[:, None]
    one = random.randint(half, size=(ensembles, half))
    other = (one + random.randint(1, half, size=(ensembles, half))) % half
    stretch = 1 + 1e-5 * random.standard_normal((ensembles, half, 1))
    return stretch * (walkers[rows, one] - walkers[rows, other])


LENGTH, AGREED = 50, 1.01
"""Autocorrelation times that an ensemble's steps have to hold, and the R-hat to fall below."""

NEXT_CHECK = 1.2
"""The rule is tried whenever the steps have grown by this factor: at the same ones however a run was cut
up."""

MOMENT = 1.0
"""Seconds of a block of steps: how often it can be interrupted, and says where it is."""


class History(NamedTuple):
    """All that a run needs to resume.

    - `points`, `log_probability`: (ensembles, steps + 1, walkers, parameters) and the same without the
      parameters, the first walkers included.
    - `accepted`: proposals taken by each walker so far.
    - `random`: the state of NumPy's Mersenne twister, as `RandomState.get_state` gives it.
    - `place`, `root`: the affine map of the proposals, see `SideBySide`.
    """

    points: Float[np.ndarray, "ensembles rows walkers parameters"]
    log_probability: Float[np.ndarray, "ensembles rows walkers"]
    accepted: Int[np.ndarray, "ensembles walkers"]
    random: tuple[Any, ...]
    place: Float[np.ndarray, " parameters"]
    root: Float[np.ndarray, "parameters parameters"]

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """As a checkpoint keeps it."""
        _, keys, *rest = self.random
        return {**self._asdict(), "random": np.array(keys), "rest": np.array(rest, float)}


def _read(arrays: dict[str, Any] | None) -> History | None:
    """The inverse of `History.arrays`."""
    if arrays is None:
        return None
    place, has_gauss, gauss = arrays.pop("rest")
    random = ("MT19937", arrays.pop("random"), int(place), int(has_gauss), float(gauss))
    return History(**arrays, random=random)


class Judgement(NamedTuple):
    """What the chains are like: steps to leave out, and of the rest the autocorrelation times, in steps,
    and R-hat; `finished`: the rule holds."""

    burn: int
    tau: Float[np.ndarray, "ensembles parameters"]
    rhat: Float[np.ndarray, " parameters"]
    finished: bool


def judged(points: Float[np.ndarray, "ensembles steps walkers parameters"]) -> Judgement:
    """The rule: R-hat below 1.01 across ensembles and 50 autocorrelation times in each, of all parameters.

    Five of the longest autocorrelation times, at most half of the steps, are left out before.
    """
    steps = points.shape[1]
    burn = min(math.ceil(5 * autocorrelation_times(points).max()), steps // 2)
    kept = points[:, burn:]
    tau = autocorrelation_times(kept)
    thin = max(1, int(tau.max() / 2))
    few = kept[:, ::thin].reshape(len(points), -1, points.shape[-1])
    agreement = np.array([rhat(few[..., j]) for j in range(points.shape[-1])])
    finished = steps - burn >= LENGTH * tau.max() and agreement.max() < AGREED
    return Judgement(burn, tau, agreement, bool(finished))


def autocorrelation_times(
    points: Float[np.ndarray, "ensembles steps walkers parameters"],
) -> Float[np.ndarray, "ensembles parameters"]:
    """Integrated autocorrelation time of every ensemble, in steps, as emcee has it:

        tau = 1 + 2 sum of rho_k up to the first k >= 5 tau,    rho the mean over the walkers;

    all the steps there are where a walker does not move, or where no such k is.

    Source: Foreman-Mackey and others, emcee: the MCMC hammer, PASP 125 (2013); Sokal's window.
    """
    steps = points.shape[1]
    tau = np.empty((len(points), points.shape[-1]))
    for k, chain in enumerate(points):
        covariance = autocovariance(chain - chain.mean(axis=0))
        if not covariance[0].all():
            tau[k] = steps
            continue
        tau[k] = integrated_time((covariance / covariance[0]).mean(axis=1))
    return np.clip(tau, 1.0, steps)


def sample_ensembles(
    log_probability: LogProbability,
    first: Float[np.ndarray, "ensembles walkers parameters"],
    place: Float[np.ndarray, " parameters"],
    root: Float[np.ndarray, "parameters parameters"],
    seed: int,
    steps: int | None,
    most: int,
    checkpoint: Checkpoint,
    tell: Progress,
    least: int = FEW,
) -> Chains:
    """Advance ensembles from `first`, or from what the checkpoint kept, to their end; see `SideBySide` for
    `place` and `root`.

    Whatever stops it, the checkpoint is written once more before the error goes on. After Ctrl-C the chains
    so far are the result, from `least` steps on.

    Raises `InputError` where the checkpoint cannot be used or written.
    """
    history = _read(checkpoint.read()) or _begun(first, log_probability, seed, place, root)
    run = _Run(log_probability, history)
    checkpoint.check_length(steps, run.done)
    last, pace, begin, begun = None, 1.0, time.perf_counter(), run.done
    saved = time.monotonic()
    try:
        while True:
            if steps is None and run.done == _next_check(run.done - 1):
                last = judged(run.history.points[:, 1:])
                if last.finished:
                    tell(run.done, run.done, _words(run, last, 0.0))
                    break
            if run.done >= (end := most if steps is None else steps):
                break
            block = min(max(1, int(MOMENT / pace)), 100, end - run.done)
            if steps is None:
                block = min(block, _next_check(run.done) - run.done)
            since = time.perf_counter()
            run.advance(block)
            pace = (time.perf_counter() - since) / block
            total = steps or _expected(last, run.done, most)
            to_go = (time.perf_counter() - begin) / (run.done - begun) * (total - run.done)
            if checkpoint.is_due(time.monotonic() - saved):
                checkpoint.write(run.history.arrays, run.done)
                saved = time.monotonic()
            tell(run.done, total, _words(run, last, to_go))
    except KeyboardInterrupt:
        checkpoint.write(run.history.arrays, run.done)
        if run.done < least:
            raise
        said = f"interrupted after {run.done:,} steps; with --resume (resume=True) it goes on."
        found = _finished(run.history, checkpoint, wants_rule=False)
        return found._replace(notes=(*found.notes, Note("interrupted", said)))
    checkpoint.write(run.history.arrays, run.done)
    return _finished(run.history, checkpoint, wants_rule=steps is None)


def first_walkers(
    density: LogProbability,
    place: Float[np.ndarray, " parameters"],
    root: Float[np.ndarray, "parameters parameters"],
    ensembles: int,
    walkers: int,
    seed: int,
) -> Float[np.ndarray, "ensembles walkers parameters"]:
    """Start about the fit, every ensemble about a place of its own, so that they have to find each other.

    In Laplace's metric an ensemble's place is one and a half deviations from the fit, its walkers one from
    there. A walker that is hopeless, more than 10 + 3 per parameter below the fit in log-probability, comes
    halfway back, lest it stays there.
    """
    random = np.random.default_rng([seed, 1])
    places = 1.5 * random.normal(size=(ensembles, 1, len(place)))
    away = (places + random.normal(size=(ensembles, walkers, len(place)))) @ root.T
    away = away.reshape(2, -1, len(place))  # in two halves, as the ensembles are moved
    floor = density(np.broadcast_to(place, away[0].shape))[0] - 10 - 3 * len(place)
    for _ in range(60):
        low = np.stack([density(place + half) for half in away]) < floor
        if not low.any():
            break
        away = np.where(low[..., None], away / 2, away)
    return (place + away).reshape(ensembles, walkers, -1)


def _finished(history: History, checkpoint: Checkpoint, wants_rule: bool) -> Chains:
    points = history.points[:, 1:]
    ensembles, steps, walkers, _ = points.shape
    last = judged(points)
    kept, tau = steps - last.burn, last.tau.mean(axis=0)
    said = list(checkpoint.said)
    if wants_rule and not last.finished:
        said.append(
            f"not converged after {steps:,} steps: R-hat {last.rhat.max():.3f} (below {AGREED} is wanted),"
            f" {kept / last.tau.max():.0f} of {LENGTH} autocorrelation times."
        )
    rates = history.accepted.mean(axis=1) / steps
    return Chains(
        points=points[:, last.burn :],
        log_probability=history.log_probability[:, 1 + last.burn :],
        rhat=last.rhat,
        ess=ensembles * walkers * kept / tau,
        thin=max(1, int(tau.max() / 2)),
        autocorrelation=float(tau.max()),
        long_enough=bool(kept >= LENGTH * last.tau.max()),
        acceptance=float(rates.mean()),
        statistics={"acceptance_rate": rates},
        method=f"emcee, {ensembles} x {walkers} walkers, {steps:,} steps",
        notes=tuple(said),
    )


class _Run:
    """The ensembles in memory. What was done is one attribute, replaced when a block is whole, so that an
    interrupt at any line leaves chains that can be kept."""

    def __init__(self, log_probability: LogProbability, history: History):
        import emcee

        self._shape = ensembles, _, walkers, parameters = history.points.shape
        # One ensemble to emcee; the move keeps them apart.
        self._sampler = emcee.EnsembleSampler(
            ensembles * walkers, parameters, log_probability,
            vectorize=True, moves=SideBySide(log_probability, ensembles, history.place, history.root),
        )  # fmt: skip
        self.history = history

    @property
    def done(self) -> int:
        """Steps so far."""
        return self.history.points.shape[1] - 1

    @property
    def acceptance(self) -> float:
        """Part of the proposals that were taken."""
        return float(self.history.accepted.mean()) / max(self.done, 1)

    def advance(self, steps: int) -> None:
        """So many steps of every ensemble."""
        import emcee

        now, (ensembles, _, walkers, parameters) = self.history, self._shape
        state = emcee.State(
            now.points[:, -1].reshape(-1, parameters),
            log_prob=now.log_probability[:, -1].ravel(),
            random_state=now.random,
        )
        self._sampler.reset()
        self._sampler.run_mcmc(state, steps, skip_initial_state_check=True)
        backend: Any = self._sampler.backend
        shape = (steps, ensembles, walkers)
        points = backend.get_chain().reshape(*shape, parameters).swapaxes(0, 1)
        found = backend.get_log_prob().reshape(shape).swapaxes(0, 1)
        self.history = History(
            np.concatenate([now.points, points], axis=1),
            np.concatenate([now.log_probability, found], axis=1),
            now.accepted + backend.accepted.reshape(ensembles, walkers).astype(int),
            backend.random_state,
            now.place,
            now.root,
        )


def _begun(
    points: np.ndarray,
    log_probability: LogProbability,
    seed: int,
    place: np.ndarray,
    root: np.ndarray,
) -> History:
    ensembles, walkers, parameters = points.shape
    halves = points.reshape(2, -1, parameters)  # the shape that is compiled
    found = np.concatenate([log_probability(half) for half in halves]).reshape(
        ensembles, 1, walkers
    )
    accepted = np.zeros((ensembles, walkers), int)
    random: Any = np.random.RandomState(np.random.MT19937(np.random.SeedSequence(seed))).get_state()
    return History(points[:, None], found, accepted, random, place, root)


def _next_check(steps: int) -> int:
    """The first step after these at which the rule is tried."""
    check = LENGTH
    while check <= steps:
        check = math.ceil(check * NEXT_CHECK)
    return check


def _expected(last: Judgement | None, done: int, most: int) -> int:
    """How many steps it will be, as far as that can be told."""
    if last is None:
        return most
    wanted = last.burn + math.ceil(LENGTH * last.tau.max())
    return min(max(wanted, _next_check(done)), most)


def _words(run: _Run, last: Judgement | None, to_go: float) -> str:
    said = [f"acceptance {run.acceptance:.2f}"]
    if last is not None:
        said += [f"R-hat {last.rhat.max():.3f}", f"autocorrelation {last.tau.max():.0f} steps"]
    return ", ".join([*said, f"{to_go:.0f} s to go"])
