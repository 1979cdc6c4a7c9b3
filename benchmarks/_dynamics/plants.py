"""Records of oscillators whose hysteresis is known, as the Bouc-Wen benchmark prescribes them.

Noël and Schoukens 2016: Newmark's average acceleration with 20 steps a sample, multisines decimated in
stages of 2, 2 and 5, sweeps in one stage of 20, as MATLAB's decimate(x, r, 'fir') does. This is an
implementation of its own, with loops, filters and hysteresis that are not those of the package under test:
fixed-point iterations where that has Newton's method, single stops and hysterons where that has plays.
"""

from dataclasses import dataclass
from typing import Any, TypeAlias

import numba
import numpy as np
from scipy import signal

RATE, FINE, PERIOD = 750, 20, 8192
"""Samples a second, steps of integration to a sample, samples of a period."""

NOISE = 8e-6
"""Standard deviation of the displacement's noise, in m."""

KINDS = ("boucwen", "drawn", "iwan", "preisach")

Array: TypeAlias = Any


@numba.njit(cache=True)
def _bouc_wen(m, c, k, p, u, h, out):
    alpha, beta, gamma, delta, nu = p
    y, v, z = 0.0, 0.0, 0.0
    a = u[0] / m
    for i in range(len(u)):
        out[i] = y
        if i + 1 == len(u):
            break
        before = alpha * v - beta * (
            gamma * abs(v) * abs(z) ** (nu - 1) * z + delta * v * abs(z) ** nu
        )
        new, y1, v1, z1 = a, y, v, z + h * before
        for _ in range(80):
            y1 = y + h * v + h * h / 4 * (a + new)
            v1 = v + h / 2 * (a + new)
            for _ in range(40):
                rate = alpha * v1 - beta * (
                    gamma * abs(v1) * abs(z1) ** (nu - 1) * z1 + delta * v1 * abs(z1) ** nu
                )
                again = z + h / 2 * (before + rate)
                apart, z1 = abs(again - z1), again
                if apart < 1e-14 * (1 + abs(again)):
                    break
            wanted = (u[i + 1] - c * v1 - k * y1 - z1) / m
            apart, new = abs(wanted - new), wanted
            if apart < 1e-14 * (1 + abs(wanted)):
                break
        y, v, z, a = y1, v1, z1, new


@numba.njit(cache=True)
def _elements(m, c, k, kind, lower, upper, weight, ramp, u, h, out):
    """kind 0: stops of the thresholds `upper`; kind 1: hysterons that switch over a ramp, at `upper` on the
    way up and at `lower` on the way down."""
    n = len(weight)
    state, new_state = np.zeros(n), np.zeros(n)
    force = 0.0
    for j in range(n):
        if kind == 1:
            state[j] = 1.0 if lower[j] + upper[j] < 0 else -1.0
        force += weight[j] * state[j]
    y, v = 0.0, 0.0
    a = (u[0] - force) / m
    for i in range(len(u)):
        out[i] = y
        if i + 1 == len(u):
            break
        new, y1, v1 = a, y, v
        for _ in range(80):
            y1 = y + h * v + h * h / 4 * (a + new)
            v1 = v + h / 2 * (a + new)
            force = 0.0
            for j in range(n):
                if kind == 0:
                    s = state[j] + y1 - y
                    s = min(max(s, -upper[j]), upper[j])
                elif y1 > y:
                    s = max(state[j], min(max((y1 - upper[j]) / ramp, -1.0), 1.0))
                elif y1 < y:
                    s = min(state[j], min(max((y1 - lower[j]) / ramp, -1.0), 1.0))
                else:
                    s = state[j]
                new_state[j] = s
                force += weight[j] * s
            wanted = (u[i + 1] - c * v1 - k * y1 - force) / m
            apart, new = abs(wanted - new), wanted
            if apart < 1e-14 * (1 + abs(wanted)):
                break
        state[:] = new_state
        y, v, a = y1, v1, new


@dataclass(frozen=True)
class Plant:
    """An oscillator: the published one, or one drawn by a seed.

    - `kind`: "boucwen" has the published parameters; "drawn" others of the same class; "iwan" 24 stops;
      "preisach" hysterons whose density is not symmetric.
    """

    kind: str = "boucwen"
    seed: int = 0

    def moved(self, force: Array, h: float = 1 / (RATE * FINE)) -> Array:
        """The displacement at every step of the force, from rest."""
        random = np.random.default_rng([self.seed, 7])
        m, c, k = 2.0, 10.0, 5e4
        law = [5e4, 1e3, 0.8, -1.1, 1.0]
        if self.kind != "boucwen":
            m, c, k = (x * float(np.exp(random.uniform(-0.3, 0.3))) for x in (m, c, k))
        out = np.empty(len(force))
        if self.kind == "drawn":
            for i in (0, 2, 3):
                law[i] *= float(np.exp(random.uniform(-0.4, 0.4)))
        if self.kind in ("boucwen", "drawn"):
            _bouc_wen(m, c, k, np.array(law), np.ascontiguousarray(force), h, out)
            return out
        if self.kind == "iwan":
            limits, weight = np.geomspace(3e-5, 2.5e-3, 24), random.gamma(2.0, 1.0, 24)
            parts = (0, -limits, limits, weight * 5e4 / weight.sum(), 1.0)
        else:
            edge = np.linspace(-2.2e-3, 2.2e-3, 16)
            pairs = np.array([(a, b) for a in edge for b in edge if a <= b])
            low, high = pairs.T.copy()
            centre = random.uniform(-3e-4, 3e-4)
            decay = random.uniform(8e-4, 1.4e-3)
            weight = np.exp(-((((low + high) / 2 - centre) / 9e-4) ** 2) - (high - low) / decay)
            weight *= random.gamma(4.0, 0.25, len(low))
            k += 4e4
            parts = (1, low, high, -45.0 * weight / weight.sum(), 1.5e-4)
        _elements(m, c, k, *parts, np.ascontiguousarray(force), h, out)
        return out


def multisine(
    random: np.random.Generator, samples: int = PERIOD, rms: float = 50.0, low: float = 5.0,
    high: float = 150.0,
) -> Array:  # fmt: skip
    """One period at the fine steps: all lines from `low` to `high` Hz alike, random phases, in N."""
    n = samples * FINE
    lines = np.arange(int(low * n / (RATE * FINE)), int(np.ceil(high * n / (RATE * FINE))) + 1)
    spectrum = np.zeros(n // 2 + 1, complex)
    spectrum[lines] = np.exp(2j * np.pi * random.random(len(lines)))
    x = np.fft.irfft(spectrum, n)
    return rms * x / x.std()


def decimated(x: Array, factor: int) -> Array:
    """As MATLAB's decimate(x, r, 'fir'): order 30, delay taken out, ends mirrored through themselves."""
    taps = signal.firwin(31, 1 / factor)
    wide = np.r_[2 * x[0] - x[30:0:-1], x, 2 * x[-1] - x[-2:-32:-1]]
    return signal.lfilter(taps, 1, wide)[45 : 45 + len(x)][::factor]


def steady(plant: Plant, period: Array, keep: int) -> tuple[Array, Array]:
    """Force and displacement of `keep` periods; one before and one after are dropped."""
    y = plant.moved(np.tile(period, keep + 2))
    for factor in (2, 2, 5):
        y = decimated(y, factor)
    samples = len(period) // FINE
    return np.tile(period[::FINE], keep), y[samples : samples * (keep + 1)]


def training(
    seed: int,
    kind: str = "boucwen",
    periods: int = 5,
    rows: int | None = None,
    samples: int = PERIOD,
) -> tuple[Array, Array]:
    """Force and noisy displacement of the record that a fit sees."""
    random = np.random.default_rng(seed)
    u, y = steady(Plant(kind, seed), multisine(random, samples), periods)
    u, y = u[:rows], y[:rows]
    return u, y + NOISE * random.standard_normal(len(y))


def unseen_multisine(seed: int, kind: str = "boucwen") -> tuple[Array, Array]:
    """One period in steady state, without noise, of phases that no training record has."""
    return steady(Plant(kind, seed), multisine(np.random.default_rng([seed, 11])), 1)


def unseen_sweep(seed: int, kind: str = "boucwen", samples: int = 153000) -> tuple[Array, Array]:
    """From rest, 18 to 52 Hz at 10 Hz a minute and 40 N, without noise."""
    t = np.arange(samples * FINE) / (RATE * FINE)
    u = 40 * np.sin(2 * np.pi * (18 * t + 0.5 * (10 / 60) * t * t))
    return u[::FINE], decimated(Plant(kind, seed).moved(u), FINE)
