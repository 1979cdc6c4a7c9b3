"""What a filter in an inverse buys against noise, and what it costs in lag."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from compensate import filtered, invert
from hysteresis import AbstractModel, Burgers, Preisach
from hysteresis.preisach import GridDensity

from .._measure import Row, noted

SAMPLES, CYCLES, NOISE = 2000, 4, 0.01
"""Of a slow sine, and the noise in parts of the output's range."""


class Trade(NamedTuple):
    """One model and one way to invert it; errors in per cent of the input's range.

    - `error`: rms, under noise. `noise`: how far the noise alone moves the estimates, rms.
    - `lag`: in samples, without noise: the delay of the input that is nearest to the estimates.
    """

    model: str
    compensator: str
    error: float
    noise: float
    lag: float


def noise_rows(quick: bool) -> list[Row]:
    """The trade as rows of a table; the same for `quick`."""
    return [
        noted(f"{row.model}, {row.compensator}: {name}", value)
        for row in noise_trade()
        for name, value in (
            ("error under noise, % of the range", row.error),
            ("of that by noise, %", row.noise),
            ("lag, samples", row.lag),
        )
    ]


def noise_trade() -> list[Trade]:
    """Raw, and filters for inputs half, once and twice as fast."""
    return [row for name, model in _models().items() for row in _rows(name, model)]


def _models() -> dict[str, AbstractModel]:
    random = np.random.default_rng(0)
    weights = np.tril(random.random((20, 20)))
    increments = np.full(20, weights.sum() / 20)
    return {
        "Preisach": Preisach(GridDensity(-1.0, 1.0, weights), increments),
        "Burgers": Burgers(2.0, 40.0, 1.0, 5.0),
    }


def _rows(name: str, model: AbstractModel) -> list[Trade]:
    t = 0.01 * np.arange(SAMPLES)
    u = 0.9 * np.sin(2 * np.pi * CYCLES * np.arange(SAMPLES) / SAMPLES)
    clean = np.asarray(model.simulate(t, u))
    sigma = NOISE * float(np.ptp(clean))
    noisy = clean + np.random.default_rng(1).normal(0, sigma, SAMPLES)
    step = float(np.sqrt(np.mean(np.diff(u) ** 2)))
    ways: dict[str, Any] = {"raw": invert(model)}
    ways |= {
        f"filtered, {part:g} input steps": filtered(model, part * step, sigma)
        for part in (0.5, 1.0, 2.0)
    }
    rows = []
    for way, compensator in ways.items():
        quiet, found = (
            np.asarray(compensator.simulate(jnp.asarray(t), jnp.asarray(y)).value)
            for y in (clean, noisy)
        )
        slope, percent = np.gradient(u), 100 / float(np.ptp(u))
        lag = float((u - quiet) @ slope / (slope @ slope))
        moved = float(np.sqrt(np.mean((found - quiet) ** 2)))
        error = float(np.sqrt(np.mean((found - u) ** 2)))
        rows.append(Trade(name, way, percent * error, percent * moved, lag))
    return rows
