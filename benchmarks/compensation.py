"""Exactness and speed of the compensators.

python -m benchmarks.compensation [--quick] [--json]
"""

import sys
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from compensate import invert
from hysteresis import AbstractModel, Burgers, LinearSponge, Preisach
from hysteresis.preisach import GridDensity

from ._measure import Row, interleaved, judged, noted, options, report

HISTORIES, SAMPLES = 1000, 200


def models() -> dict[str, AbstractModel]:
    """One of each, with parameters of a usual size."""
    random = np.random.default_rng(0)
    weights = np.tril(random.random((40, 40)))
    weights /= weights.sum()
    steep = np.full(40, 2.2 * (weights.sum(0) + weights.sum(1)).max())
    return {
        "LinearSponge": LinearSponge(1.298, 6.186, 1.5),
        "Burgers": Burgers(2.0, 40.0, 1.0, 5.0, 0.1),
        "Burgers, leading": Burgers(2.0, 40.0, 1.0, 5.0, 0.1, leading=True),
        "Preisach": Preisach(GridDensity(0, 20, weights), steep, 1.0),
        "Preisach, relays only": Preisach(GridDensity(0, 20, weights)),
        "Preisach, leading": Preisach(GridDensity(0, 20, weights), steep, 1.0, leading=True),
    }


def round_trip(model: AbstractModel, histories: int) -> float:
    """Largest |model(compensator(y)) - y| over the range of y, over random histories."""
    random = np.random.default_rng(1)
    t = jnp.asarray(np.cumsum(random.uniform(0.01, 1.0, SAMPLES)))
    u = np.where(
        random.random((histories, 1)) < 0.5,
        random.uniform(0, 20, (histories, SAMPLES)),
        np.clip(10 + random.normal(0, 1.5, (histories, SAMPLES)).cumsum(1), 0, 20),
    )
    compensator = invert(model)

    @jax.jit
    @jax.vmap
    def error(u: jax.Array) -> jax.Array:
        y = model.simulate(t, u)
        again = model.simulate(t, compensator.simulate(t, y).value)
        return jnp.abs(again - y).max() / (y.max() - y.min())

    return float(error(jnp.asarray(u)).max())


def main(arguments: Sequence[str] | None = None) -> None:
    """Round trips over random histories, then nanoseconds a sample."""
    chosen = options("benchmarks.compensation", __doc__, arguments)
    jax.config.update("jax_enable_x64", True)
    count = 100 if chosen.quick else HISTORIES
    rows: list[Row] = [
        judged(f"round trip, {name}, {count} histories", round_trip(model, count), 1e-9)
        for name, model in models().items()
    ]
    y = {n: m.simulate(jnp.arange(20_000.0), _walk(20_000)) for n, m in models().items()}
    calls = {n: _inverse(m, y[n]) for n, m in models().items()}
    for name, seconds in interleaved(calls, 3 if chosen.quick else 9).items():
        nanoseconds = 1e9 * seconds / 20_000
        rows.append(noted(f"{name}: ns a sample", float(np.median(nanoseconds)), nanoseconds.min()))
    report(rows, chosen.json)


def _walk(samples: int) -> np.ndarray:
    return 10 + 9 * np.sin(np.arange(samples) / 40) * np.sin(np.arange(samples) / 313)


def _inverse(model: AbstractModel, y: jax.Array):
    compensator, t = invert(model), jnp.arange(float(len(y)))
    run = jax.jit(lambda t, y: compensator.simulate(t, y).value)
    return lambda: run(t, y)


if __name__ == "__main__":
    main(sys.argv[1:])
