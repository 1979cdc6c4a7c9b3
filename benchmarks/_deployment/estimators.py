"""An error-state Kalman filter with a compensator's deviation: is its covariance right over 100 seeds?

python -m benchmarks._deployment.estimators [--quick] [--json]

A robot presses a virtual sponge to forces it plans, and misses the plan by a random walk. The filter fuses
the plan, a compensator and a motor current. How much of the error lasts is learnt from 22 runs before.
"""

import sys
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy

from compensate import calibrated, filtered
from hysteresis import Record
from hysteresis.rigs import SpongeRig
from identify import fit

from .._measure import Row, judged, noted, options, report
from .plain_filters import plain_rows

DT, SIGMA, WALK = 0.5, 0.2, 0.3
"""s; mm, of the sensor; N per root second, by which the plan is missed."""

LAGS = 20
"""Rows over which the autocorrelations of errors are fitted."""

LEAD, ROWS, FITTED, TAUGHT, RUNS = 10, 60, 14, 36, 100
"""Rows that lead to a run, and of one; runs of the fit, runs before the test, and those of the test."""


TIMES = np.geomspace(1.0, 64.0, 13)
"""Rows in which a part of the error decays to an e-th: those that the two decays are chosen from."""


class Lasting(NamedTuple):
    """The mean error in deviations, its size, the shares of it that last, and their decays in a row."""

    mean: float
    size: float
    shares: np.ndarray
    phis: np.ndarray


def estimator_rows(quick: bool) -> list[Row]:
    """NEES, its 90 per cent, and how white the innovations are."""
    random = np.random.default_rng(0)
    wear = np.tile(np.append(np.linspace(0, 20, 40, endpoint=False), np.linspace(20, 0, 40)), 3)
    runs = 40 if quick else RUNS
    force, plan = _presses(random, TAUGHT + runs)
    pressed = np.concatenate([wear, force.ravel()])
    t = DT * np.arange(len(pressed))
    y = np.asarray(SpongeRig().follow(pressed, dt=DT)) + SIGMA * random.normal(size=len(t))
    known, taught = (len(wear) + k * (LEAD + ROWS) for k in (FITTED, TAUGHT))
    rows = slice(80, known)
    fitted = fit(Record.from_arrays(pressed[rows], y[rows], t[rows]), model="Preisach")
    compensator = filtered(fitted.model, input_step=4.0, output_sigma=SIGMA)
    mask = np.arange(taught) >= known
    before = Record.from_arrays(pressed[:taught], y[:taught], t[:taught], mask=mask)
    found = calibrated(compensator, before).simulate(t, y)
    value, deviation, true = (
        np.asarray(x)[len(wear) :].reshape(-1, LEAD + ROWS)[:, LEAD:]
        for x in (found.value, found.deviation, pressed)
    )
    lasting = _lasting(((value - true) / deviation)[FITTED:TAUGHT])
    new = slice(TAUGHT, None)
    value, deviation, true, plan = value[new], deviation[new], true[new], plan[new]
    current = true + random.normal(size=true.shape)
    start = true[:, 0] + random.normal(size=runs)
    rates = np.diff(plan, prepend=plan[:, :1])
    z = value - lasting.mean * deviation
    given = (rates, z, lasting.size * deviation, current, start)
    F, variance, white = map(np.asarray, _filter(lasting, *map(jnp.asarray, given)))
    nees = (F - true) ** 2 / variance
    low, high = scipy.stats.chi2.ppf([0.025, 0.975], runs) / runs
    mean = float(nees.mean())
    lag = np.abs(
        np.mean(white[:, 1:] * white[:, :-1], axis=(0, 1)) / np.mean(white**2, axis=(0, 1))
    )
    bound = 2.576 / np.sqrt(white[:, 1:, 0].size)
    inside = 100 * float((nees < scipy.stats.chi2.ppf(0.9, 1)).mean())
    what = f"error-state filter, {runs} seeds: "
    return [
        judged(f"{what}NEES", mean, float(high)),
        judged(f"{what}NEES", mean, float(low), at_least=True),
        judged(f"{what}forces in the 90 % band, off 90 %", abs(inside - 90), 3.0),
        *(
            judged(f"{what}correlation of {name} innovations, 99 % bound", float(one), float(bound))
            for name, one in zip(("compensator", "current"), lag, strict=True)
        ),
        noted(
            f"{what}rms error of the compensator, N", float(np.sqrt(np.mean((value - true) ** 2)))
        ),
        noted(f"{what}rms error of the filter, N", float(np.sqrt(np.mean((F - true) ** 2)))),
        *plain_rows(fitted, before, y, (true, plan, current, start), LEAD, DT, WALK),
    ]


def _presses(random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Forces with their lead, and plans without."""
    force, plan, last = [], [], 0.0
    for _ in range(count):
        planned = np.interp(np.arange(ROWS), np.linspace(0, ROWS, 4), random.uniform(4, 16, 4))
        missed = np.cumsum(WALK * np.sqrt(DT) * random.normal(size=ROWS))
        reached = np.clip(planned + missed, 0.5, 25)
        force.append(np.append(np.linspace(last, reached[0], LEAD, endpoint=False), reached))
        plan.append(planned)
        last = reached[-1]
    return np.array(force), np.array(plan)


def _lasting(score: np.ndarray) -> Lasting:
    """Two decays whose sum is nearest to the autocorrelations of the errors, none of them negative."""
    mean, size = score.mean(), score.std()
    lags, apart = np.arange(1, LAGS + 1), (score - mean) / size
    rho = np.array([np.mean(apart[:, k:] * apart[:, :-k]) for k in lags])
    # A mean over fewer products is less certain.
    sure = np.sqrt(ROWS - lags)
    fits = []
    for pair in combinations(np.exp(-1 / TIMES), 2):
        shares, off = scipy.optimize.nnls(
            sure[:, None] * np.asarray(pair) ** lags[:, None], sure * rho
        )
        fits.append((off, shares / max(1.0, shares.sum()), np.asarray(pair)))
    _, shares, phis = min(fits, key=lambda one: one[0])
    return Lasting(mean, size, shares, phis)


@jax.jit
def _filter(
    lasting: Lasting,
    rates: jax.Array,
    z: jax.Array,
    d: jax.Array,
    current: jax.Array,
    start: jax.Array,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Force, its variance, and whitened innovations, of every run."""
    shares, phis = lasting.shares, lasting.phis
    n = 1 + len(phis)
    move = jnp.diag(jnp.concatenate([jnp.ones(1), phis]))
    walk = jnp.full(1, WALK**2 * DT)
    grown = jnp.diag(jnp.concatenate([walk, shares * (1 - phis**2)]))

    def step(carry, now):
        nominal, e, P = carry
        rate, z, d, current = now
        nominal, e, P = nominal + rate, move @ e, move @ P @ move.T + grown
        H = jnp.zeros((2, n)).at[:, 0].set(1.0).at[0, 1:].set(d)
        S = H @ P @ H.T + jnp.diag(jnp.stack([(1 - shares.sum()) * d**2, jnp.ones(())]))
        K = P @ H.T @ jnp.linalg.inv(S)
        innovation = jnp.stack([z, current]) - nominal - H @ e
        e, P = e + K @ innovation, (jnp.eye(n) - K @ H) @ P
        nominal, e = nominal + e[0], e.at[0].set(0.0)
        white = jax.scipy.linalg.solve_triangular(jnp.linalg.cholesky(S), innovation, lower=True)
        return (nominal, e, P), (nominal, P[0, 0], white)

    def run(rates, z, d, current, start):
        first = start, jnp.zeros(n), jnp.diag(jnp.concatenate([jnp.ones(1), shares]))
        return jax.lax.scan(step, first, (rates, z, d, current))[1]

    return jax.vmap(run)(rates, z, d, current, start)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run all seeds and print the table."""
    chosen = options("benchmarks._deployment.estimators", __doc__, arguments)
    jax.config.update("jax_enable_x64", True)
    report(estimator_rows(chosen.quick), chosen.json)


if __name__ == "__main__":
    main(sys.argv[1:])
