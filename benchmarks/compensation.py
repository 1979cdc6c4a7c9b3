"""Exactness and speed of the compensators.

python -m benchmarks.compensation [--quick] [--json] [--only TEXT]

Parts: round (model and inverse one after the other), exported (Python without JAX, C99), removed and bands
(measured sensors, need the data: twenty minutes), default (the band of `hysid.invert`, two minutes), noise
(lag against noise), speed.
"""

import sys
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from compensate import Status, invert
from hysteresis import AbstractModel, Burgers, LinearSponge, Preisach
from hysteresis.preisach import GridDensity
from tests.problems import INVERTIBLE, SAMPLES, Problem, clock, random_histories

from ._compensation.bands import band_rows
from ._compensation.default_bands import default_rows
from ._compensation.exported import exported_rows
from ._compensation.noise_trade import noise_rows
from ._compensation.removed import removed_rows
from ._measure import Row, interleaved, judged, noted, run_parts

HISTORIES = 10_000


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


def round_trips(quick: bool) -> list[Row]:
    """Of every model that the tests know: largest errors of the way back and forth, over their ranges."""
    count = 100 if quick else HISTORIES
    found = {problem.name: _errors(problem, count) for problem in INVERTIBLE}
    worst = {k: max(found, key=lambda name, k=k: found[name][k]) for k in range(3)}
    what = f"of the range, {len(found)} models, {count:,} histories each"
    bars = (
        ("forward(inverse(y)) - y", 1e-9),
        ("inverse(forward(u)) - u where y rises by a thousandth of its mean slope or more", 1e-9),
        ("inverse(forward(u)) - u elsewhere, where OK", 1e-7),
    )
    return [
        judged(f"{name}, {what} (worst: {worst[k]})", found[worst[k]][k], bar)
        for k, (name, bar) in enumerate(bars)
    ]


def _errors(problem: Problem, histories: int) -> tuple[float, float, float]:
    """In y; in u on steep steps; in u on others whose status is OK."""
    model, random = problem.model(), np.random.default_rng(1)
    u = random_histories(random, problem.low, problem.high, (histories, SAMPLES))
    steps = np.diff(clock(0), prepend=0.0)
    if isinstance(model, Burgers) and model.hold == "constant":
        steps = np.minimum(steps, 0.9 * model.largest_stable_step())
    t, compensator = jnp.asarray(np.cumsum(steps)), invert(model)

    @jax.jit
    @jax.vmap
    def back_and_forth(u: jax.Array) -> Any:
        y = model.simulate(t, u)
        found = compensator.simulate(t, y)
        return y, *found, model.simulate(t, found.value)

    y, value, status, again = map(np.asarray, back_and_forth(jnp.asarray(u)))
    du, dy = (np.abs(np.diff(x, axis=1, prepend=x[:, :1])) for x in (u, y))
    # Where the input rests the output says what the step before said.
    steep = (dy * np.ptp(u) > 1e-3 * du * np.ptp(y)) & (du > 1e-3 * np.ptp(u))
    off = np.abs(value - u) / np.ptp(u)
    fine = (status == Status.OK) & ~steep
    if "grid" in problem.tags:
        fine[:, 1:] &= steep[:, :-1]  # an input that was never known is not found by standing still
    if "flat" in problem.tags:  # what gives no output is not found, nor what comes from there
        steep[:] = fine[:] = False
    return (
        float(np.abs(again - y).max() / np.ptp(y)),
        float(off[steep & (status == Status.OK)].max(initial=0.0)),
        float(off[fine].max(initial=0.0)),
    )


def speed(quick: bool) -> list[Row]:
    """Nanoseconds a sample of compiled inverses."""
    y = {n: m.simulate(jnp.arange(20_000.0), _walk(20_000)) for n, m in models().items()}
    calls = {n: _inverse(m, y[n]) for n, m in models().items()}
    rows = []
    for name, seconds in interleaved(calls, 3 if quick else 9).items():
        nanoseconds = 1e9 * seconds / 20_000
        rows.append(noted(f"{name}: ns a sample", float(np.median(nanoseconds)), nanoseconds.min()))
    return rows


PARTS: dict[str, Callable[[bool], list[Row]]] = {
    "round": round_trips,
    "exported": exported_rows,
    "removed": removed_rows,
    "bands": band_rows,
    "default": default_rows,
    "noise": noise_rows,
    "speed": speed,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run every part and print."""
    run_parts("benchmarks.compensation", __doc__, PARTS, arguments)


def _walk(samples: int) -> np.ndarray:
    return 10 + 9 * np.sin(np.arange(samples) / 40) * np.sin(np.arange(samples) / 313)


def _inverse(model: AbstractModel, y: jax.Array):
    compensator, t = invert(model), jnp.arange(float(len(y)))
    run = jax.jit(lambda t, y: compensator.simulate(t, y).value)
    return lambda: run(t, y)


if __name__ == "__main__":
    main(sys.argv[1:])
