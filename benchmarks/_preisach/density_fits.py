"""Fits of Preisach weights: their time, their exactness, and what they predict of other histories.

python -m benchmarks._preisach.density_fits NAME prints the figures of one fit as JSON: each
runs in a process of its own, on one BLAS thread, so that time and peak memory are its own.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize

from compensate import invert
from hysteresis import Preisach, Record
from hysteresis.preisach import GridDensity
from hysteresis.rigs import SpongeRig
from identify import everett_surface, fit, fit_density, forc_curves
from identify.linear._preisach_design_matrix import design_rows
from identify.linear._preisach_fit import PreisachProblem
from identify.linear._preisach_unknowns import GridUnknowns
from identify.records._folds import Parts

from .._measure import Row, judged, noted
from ..accuracy import data_folder
from .growth import peak_memory

NOISE = 0.002
FIT_FORC = 0.226
"""Held-out error, in per cent, of a 40 x 40 fit to the curves of nanowires: the one to be halved."""


def rows(quick: bool) -> list[Row]:
    """All figures; `quick` leaves out the fit of measured curves by cross-validation."""
    small, large, sponge = _alone("small"), _alone("large"), _alone("sponge")
    found = [
        judged("NNLS fit of 1,000 samples, 50x50 grid, s", small["seconds"], 0.3),
        judged("its objective away from scipy's nnls, relative", small["excess"], 1e-9),
        judged("NNLS fit of 10,000 samples, 100x100 grid, s", large["seconds"], 3.0),
        judged("its peak memory, GB", large["gigabytes"], 1.0),
        judged("its duality gap over its objective", large["excess"], 1e-9),
        judged("held-out NRMSE, 1,000-sample FORC of 80,200 relays", small["held out"], 0.0035),
        judged("virtual sponge, force -> displacement, %", sponge["forward"], 0.5),
        judged("virtual sponge, displacement -> force, %", sponge["inverse"], 0.6),
    ]
    halved = ("measured FORC, surface of the odd curves, even ones, %", "the same by `fit`, %")
    if not _nanowires().is_file():
        return found + [
            noted(what, float("nan"), reason="the data are not here") for what in halved
        ]
    found.append(judged(halved[0], _alone("surface")["held out"], FIT_FORC / 2))
    if quick:
        return [*found, noted(halved[1], float("nan"), reason="in the full run alone")]
    return [*found, judged(halved[1], _alone("curves")["held out"], FIT_FORC / 2)]


def reversal_curves(curves: int, samples: int) -> np.ndarray:
    """First-order reversal curves in [0, 1] as one history: down to ever lower inputs and back to 1."""
    down = np.linspace(0.98, 0.0, curves)
    turns = np.concatenate([[0.0, 1.0], np.ravel([down, np.ones(curves)], "F")])
    return _path(turns, np.abs(np.diff(turns)).sum() / samples)


def small() -> dict[str, float]:
    """Sharp relays with a linear term, 0.2 per cent of noise: 50 x 50 cells."""
    u, other = reversal_curves(20, 1000), _walk(120, 2000, seed=1)
    y, truth = _sharp_relays(u), _sharp_relays(other)
    record = _noisy(u, y)
    seconds = _seconds(lambda: fit_density(record, 50, strength=1e-2), 5)
    chosen = fit_density(record, 50)
    error = np.asarray(chosen.model.simulate(None, other)) - truth
    return {
        "seconds": seconds,
        "excess": _over_scipy(record, 50, 1e-2),
        "held out": float(np.sqrt(np.mean(error**2)) / np.ptp(truth)),
    }


def large() -> dict[str, float]:
    """A smooth density, 0.2 per cent of noise: 100 x 100 cells, 5,050 weights."""
    u = reversal_curves(50, 10_000)
    model = Preisach(GridDensity(0.0, 1.0, _bump(100)), jnp.full(100, 0.003))
    record = _noisy(u, np.asarray(model.simulate(None, u)))
    seconds = _seconds(lambda: fit_density(record, 100, strength=1e-2), 3)
    found = fit_density(record, 100, strength=1e-2)
    peak = peak_memory() / 1e9
    problem = _problem(
        record, 100
    )  # after the peak: the normal matrix is for the certificate alone
    H, b = problem.objective((0,), 1e-2)
    return {
        "seconds": seconds,
        "gigabytes": peak,
        "excess": _duality_gap(H, b, found.unknowns) / _objective(problem, H, b, found.unknowns),
    }


def sponge() -> dict[str, float]:
    """Two major loops and reversal curves with 0.1 mm of noise; then 800 samples of a random walk.

    Steps of 0.5 N every 6 s. The first loop conditions the foam and is left out of fit and judgement;
    so are forces below 1.5 N. Errors in per cent of the test's range.
    """
    rig, step = SpongeRig(), 0.5
    turns = np.ravel([np.arange(18.0, -1.0, -2.0), np.full(10, 20.0)], "F")
    force = _path(np.concatenate([[0.0, 20.0, 0.0, 20.0, 0.0, 20.0], turns]), step)
    noise = np.random.default_rng(0).normal(0.0, 0.1, len(force))
    record = Record.from_arrays(force, rig.follow(force) + noise)
    conditioning = np.arange(len(force)) < 2 * 20 / step
    model = fit_density(replace(record, mask=~conditioning), 40).model

    before = _path(np.array([0.0, 20.0, 0.0, 20.0, 0.0]), step)
    walk = _path(np.append(0.0, np.random.default_rng(1).uniform(0.0, 20.0, 400)), step)[1:801]
    force = np.concatenate([before, walk])
    judge = (np.arange(len(force)) >= len(before)) & (force >= 1.5)
    depth = rig.follow(force)
    forward = np.asarray(model.simulate(None, force))
    inverse = np.asarray(invert(model).simulate(None, depth).value)
    return {
        "forward": _percent(forward[judge], depth[judge]),
        "inverse": _percent(inverse[judge], force[judge]),
    }


def surface() -> dict[str, float]:
    """The Everett surface of the odd curves, judged on the even ones."""
    odd, even = _curves(1), _curves(0)
    model = everett_surface(forc_curves(odd)).model
    found = model.evaluate(model.prepare(None, even.input, starts=tuple(even.starts.tolist())))
    return {"held out": _percent(np.asarray(found), even.output)}


def curves() -> dict[str, float]:
    """The same by `fit`, which chooses grid and prior on held-out curves."""
    odd, even = _curves(1), _curves(0)
    found = fit(odd, "Preisach", test=even, initial="positive").metrics["test"]
    assert found is not None
    return {"held out": found.nrmse_percent}


FITS: dict[str, Callable[[], dict[str, float]]] = {
    f.__name__: f for f in (small, large, sponge, surface, curves)
}


def _alone(name: str) -> dict[str, float]:
    """The figures of one fit, from a process of its own."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    said = subprocess.run(
        [sys.executable, "-m", "benchmarks._preisach.density_fits", name],
        check=True, capture_output=True, text=True, env=environment,
    ).stdout  # fmt: skip
    return json.loads(said)


def _seconds(call: Callable[[], Any], rounds: int) -> float:
    """The fastest of some rounds, the first of which, with its compiling, is not counted."""
    found = []
    for _ in range(rounds + 1):
        begin = time.perf_counter()
        call()
        found.append(time.perf_counter() - begin)
    return min(found[1:])


def _noisy(u: np.ndarray, y: np.ndarray) -> Record:
    noise = np.random.default_rng(0).normal(0.0, NOISE * np.ptp(y), len(y))
    return Record.from_arrays(u, y + noise)


def _path(turns: np.ndarray, step: float) -> np.ndarray:
    """Samples about `step` apart along a path through the turns."""
    counts = np.maximum(1, np.round(np.abs(np.diff(turns)) / step).astype(int))
    legs = [
        np.linspace(a, b, k, endpoint=False)
        for a, b, k in zip(turns[:-1], turns[1:], counts, strict=True)
    ]
    return np.concatenate([*legs, turns[-1:]])


def _walk(turns: int, samples: int, seed: int) -> np.ndarray:
    at = np.append(0.0, np.random.default_rng(seed).random(turns))
    return np.interp(np.linspace(0, turns, samples), np.arange(turns + 1), at)


def _bump(cells: int) -> np.ndarray:
    """Masses of a density with one maximum away from the diagonal, 1 in all."""
    middle = (np.arange(cells) + 0.5) / cells
    alpha, beta = np.meshgrid(middle, middle, indexing="ij")
    density = np.exp(-(((alpha - beta - 0.25) / 0.15) ** 2) - ((alpha + beta - 1) / 0.3) ** 2)
    return np.tril(density) / np.tril(density).sum()


def _sharp_relays(u: np.ndarray) -> np.ndarray:
    """80,200 relays at the middles of 400 x 400 cells, and a line: a loop over the samples."""
    weights, middle = _bump(400), (np.arange(400) + 0.5) / 400
    state, y = -np.ones_like(weights), np.empty(len(u))
    for k, x in enumerate(u):
        state[middle <= x] = 1.0
        state[:, middle >= x] = -1.0
        y[k] = (weights * state).sum()
    return y + 0.3 * u


def _problem(record: Record, cells: int) -> PreisachProblem:
    u, y = record.input, record.output
    low, high, scale = float(u.min()), float(u.max()), float(np.ptp(y))
    whole = Parts(np.zeros(len(u), int), (), None, "")
    return PreisachProblem(record, whole, GridUnknowns(cells, low, high, False, "negative", scale))


def _objective(problem: PreisachProblem, H: np.ndarray, b: np.ndarray, x: np.ndarray) -> float:
    total = problem.total((0,))
    return float(x @ H @ x / 2 - b @ x + total.yy / total.rows / 2)


def _over_scipy(record: Record, cells: int, strength: float) -> float:
    """How far our objective is from that of scipy.optimize.nnls on the stacked system, relative."""
    problem = _problem(record, cells)
    H, b = problem.objective((0,), strength)
    A = problem.meaning.space.to_unknowns(
        design_rows(problem.template, problem.prepared).toarray().T
    ).T / np.sqrt(len(problem.y))
    values, vectors = np.linalg.eigh(strength * problem.prior)
    root = np.sqrt(np.maximum(values, 0))[:, None] * vectors.T
    stacked = np.vstack([A, root])
    stacked = np.hstack([stacked, -stacked[:, :1]])  # the offset may be negative: two of them
    right = np.concatenate([problem.y / np.sqrt(len(problem.y)), np.zeros(len(b))])
    split, _ = scipy.optimize.nnls(stacked, right, maxiter=100 * len(b))
    theirs = split[:-1].copy()
    theirs[0] -= split[-1]
    ours = fit_density(record, cells, strength=strength).unknowns
    return abs(_objective(problem, H, b, ours) / _objective(problem, H, b, theirs) - 1)


def _duality_gap(H: np.ndarray, b: np.ndarray, x: np.ndarray) -> float:
    """How far x can be above the least objective, whatever that is.

    With any multipliers s >= 0, 0 for the offset, and e = s - (Hx - b), the dual objective lies
    x's + e'H^-1 e / 2 below that of x; the best s are the slopes where x is zero.
    """
    slope = H @ x - b
    s = np.where(x == 0, np.maximum(slope, 0.0), 0.0)
    e = s - slope
    return float(e @ np.linalg.solve(H, e) / 2)


def _percent(found: np.ndarray, truth: np.ndarray) -> float:
    return float(100 * np.sqrt(np.mean((found - truth) ** 2)) / np.ptp(truth))


def _nanowires() -> Path:
    return data_folder() / "forc-magnetic" / "tidy_feco_nanowires.csv"


def _curves(remainder: int) -> Record:
    """Every other measured curve."""
    table = np.genfromtxt(_nanowires(), delimiter=",", names=True)
    table = table[table["curve"] % 2 == remainder]
    return Record.from_arrays(table["field_Oe"], table["moment_emu"], groups=table["curve"])


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    print(json.dumps(FITS[sys.argv[1]]()))
