"""Speed of the forward models: time a sample, and what it depends on.

python -m benchmarks.preisach [--quick] [--json]
"""

import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import AbstractModel, Burgers, Preisach
from hysteresis.preisach import GridDensity

from ._measure import Row, interleaved, judged, noted, options, report

SAMPLES = 56_708
CELLS = 100


def modulated_sine(samples: int = SAMPLES) -> np.ndarray:
    """A sine in [0, 1] of 250 samples a period, modulated in frequency and amplitude."""
    k = np.arange(samples)
    knots = np.arange(0, samples + 250, 250)
    amplitude = np.interp(k, knots, np.random.default_rng(0).uniform(0.2, 1.0, len(knots)))
    wave = np.sin(2 * np.pi * k / 250 * (1 + 0.3 * np.sin(k / 3000)))
    return np.clip(0.5 + 0.5 * wave * amplitude, 0.0, 1.0)


def model(cells: int) -> Preisach:
    """Random masses on a grid over [0, 1]."""
    return Preisach(
        GridDensity(0.0, 1.0, jnp.asarray(np.random.default_rng(1).random((cells,) * 2)))
    )


@jax.jit
def _evaluate(model: AbstractModel, prepared: Any) -> jax.Array:
    return model.evaluate(prepared)


@jax.jit
@partial(jax.value_and_grad, argnums=0)
def _value_and_gradient(model: AbstractModel, prepared: Any, y: jax.Array) -> jax.Array:
    return ((model.evaluate(prepared) - y) ** 2).sum()


def calls() -> dict[str, Callable[[], Any]]:
    """What is timed. Model and history are arguments: nothing is folded into the program."""
    smooth, white = modulated_sine(), np.random.default_rng(2).random(SAMPLES)
    E1, eta1, E2, eta2 = map(jnp.asarray, (2.0, 40.0, 1.0, 5.0))
    burgers = Burgers(E1, eta1, E2, eta2)
    t = jnp.cumsum(jnp.asarray(np.random.default_rng(3).uniform(0.5, 1.5, SAMPLES)))
    grids = {n: model(n) for n in (50, CELLS, 200)}
    history = {n: grid.prepare(None, smooth) for n, grid in grids.items()}
    noise, held = grids[CELLS].prepare(None, white), burgers.prepare(t, jnp.asarray(smooth))
    blocks = [np.random.default_rng(k).random(SAMPLES) for k in range(5)]
    target = [np.empty_like(block) for block in blocks]

    def floor() -> None:
        for out, block in zip(target, blocks, strict=True):
            np.copyto(out, block)

    zeros = jnp.zeros(SAMPLES)
    return {
        "50": partial(_evaluate, grids[50], history[50]),
        "100": partial(_evaluate, grids[CELLS], history[CELLS]),
        "200": partial(_evaluate, grids[200], history[200]),
        "gradient": partial(_value_and_gradient, grids[CELLS], history[CELLS], zeros),
        "white": partial(_evaluate, grids[CELLS], noise),
        "floor": floor,
        "prepare": partial(grids[CELLS].prepare, None, smooth),
        "prepare white": partial(grids[CELLS].prepare, None, white),
        "burgers": partial(_evaluate, burgers, held),
    }


def rows(quick: bool) -> list[Row]:
    """All figures; `quick` has fewer rounds."""
    every, rounds = calls(), 40 if quick else 200
    # What makes a ratio shares rounds; more calls in a round would only empty the caches for it.
    grids = interleaved({name: every[name] for name in ("50", "200")}, rounds)
    others = [name for name in every if name not in grids]
    seconds = grids | interleaved({name: every[name] for name in others}, rounds)

    def per_sample(name: str) -> tuple[float, float]:
        ns = 1e9 * seconds[name] / SAMPLES
        return float(np.median(ns)), float(ns.min())

    def ratio(one: str, other: str) -> float:
        return float(np.median(seconds[one] / seconds[other]))

    def ratio_of_least(one: str, other: str) -> float:
        return float(seconds[one].min() / seconds[other].min())

    value, least = per_sample("100")
    return [
        judged(f"evaluate, {CELLS}x{CELLS} grid, ns a sample", value, 25.0, least),
        judged(
            "evaluate, 200x200 over 50x50", ratio("200", "50"), 2.0, ratio_of_least("200", "50")
        ),
        noted(
            "value and gradient over evaluate",
            ratio("gradient", "100"),
            ratio_of_least("gradient", "100"),
        ),
        noted(
            "white noise over modulated sine", ratio("white", "100"), ratio_of_least("white", "100")
        ),
        noted("prepare, modulated sine, ns a sample", *per_sample("prepare")),
        noted("prepare, white noise, ns a sample", *per_sample("prepare white")),
        noted(
            "evaluate over copying 5 arrays of its length",
            ratio("100", "floor"),
            ratio_of_least("100", "floor"),
        ),
        noted("Burgers evaluate, uneven steps, ns a sample", *per_sample("burgers")),
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; the exit status."""
    chosen = options("benchmarks.preisach", __doc__, arguments)
    jax.config.update("jax_enable_x64", True)
    report(rows(chosen.quick), chosen.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
