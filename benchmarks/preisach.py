"""The Preisach model's speed, how it grows, its peers beside it, and its exactness.

python -m benchmarks.preisach [--quick] [--json] [--picture FILE]

Times are the least of interleaved rounds; ratios are those of times from the same rounds.
"""

import math
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import Preisach
from hysteresis.preisach._everett import materialise
from hysteresis.preisach._preisach import PreisachInput

from ._measure import Row, judged, least_seconds, noted, options, report
from ._preisach import density_fits, exactness, growth
from ._preisach.growth_picture import picture
from ._preisach.inputs import (
    CELLS,
    SAMPLES,
    evaluate,
    grid_model,
    look_up,
    modulated_sine,
    random_model,
    random_weights,
    table,
)
from ._preisach.relays import (
    DENSE_LOOP,
    DENSE_SCAN,
    HAS_NUMBA,
    SWEPT_LOOP,
    byte_peers,
    compiled,
    look_up_loop,
    peers,
)

ROUNDING = 1e-12
"""Of the range: what peers may differ by, which sum 5,050 masses, or 56,708 changes, in other orders."""

LONG = 0.05
"""Seconds that calls take which are compared with shorter ones."""

SETS, BLOCK = 64, 4
NO_NUMBA = "numba is not installed: pip install numba"


@jax.jit
@jax.value_and_grad
def _value_and_gradient(model: Preisach, prepared: PreisachInput, y: jax.Array) -> jax.Array:
    return ((model.evaluate(prepared) - y) ** 2).sum()


def copy_five() -> Callable[[], None]:
    """The floor: five arrays of a record's length, copied."""
    blocks = [np.random.default_rng(k).random(SAMPLES) for k in range(5)]
    target = [np.empty_like(block) for block in blocks]

    def copy() -> None:
        for out, block in zip(target, blocks, strict=True):
            np.copyto(out, block)

    return copy


def look_ups(model: Preisach, prepared: PreisachInput) -> Callable[[], np.ndarray]:
    """The compiled loop over the samples, given the Everett table and the anchors' levels."""
    everett, pairs, tree = jax.tree.map(np.asarray, (table(model), prepared.sample, prepared.tree))
    loop = partial(
        compiled(look_up_loop, True), everett.node.ravel(), len(everett.node), everett.diagonal,
        pairs.corner, pairs.cell, pairs.cell_b, pairs.fraction, pairs.fraction_b, tree.anchor,
        np.asarray(prepared.sign),
    )  # fmt: skip
    y = np.asarray(evaluate(model, prepared))
    level = np.zeros(len(tree.node))
    level[tree.anchor] = y - loop(level)
    # One level for all samples of an anchor is what makes the loop's outputs ours.
    _assert_same(loop(level), y)
    return partial(loop, level)


def speed(quick: bool) -> list[Row]:
    """One model on one record: what evaluating, preparing and streaming it take."""
    model, u = random_model(), modulated_sine()
    white = np.random.default_rng(2).random(SAMPLES)
    prepared, noise = model.prepare(None, u), model.prepare(None, white)
    calls = {
        "evaluate": partial(evaluate, model, prepared),
        "look-ups": partial(look_up, model, table(model), prepared),
        "floor": copy_five(),
        "white": partial(evaluate, model, noise),
        "gradient": partial(_value_and_gradient, model, prepared, jnp.zeros(SAMPLES)),
    }
    calls |= {"loop": look_ups(model, prepared)} if HAS_NUMBA else {}
    others = {
        "prepare": partial(model.prepare, None, u),
        "prepare white": partial(model.prepare, None, white),
        "stream": partial(model.stream, None, jnp.asarray(u), model.init()),
    }
    seconds = least_seconds(calls, 40 if quick else 200)
    seconds |= least_seconds(others, 10 if quick else 50)

    def ns(name: str) -> float:
        return 1e9 * seconds[name] / SAMPLES

    def over_evaluate(name: str) -> float:
        return seconds[name] / seconds["evaluate"]

    return [
        noted(f"evaluate, {CELLS}x{CELLS} grid, ns a sample", ns("evaluate")),
        judged("evaluate over copying 5 arrays of its length", 1 / over_evaluate("floor"), 6),
        _if_numba(
            "evaluate, table apart, over the same look-ups in a compiled loop",
            seconds["look-ups"] / seconds.get("loop", math.nan),
            2,
        ),
        judged("white noise over modulated sine", over_evaluate("white"), 3),
        judged("value and gradient in all weights over evaluate", over_evaluate("gradient"), 5),
        judged("prepare, modulated sine, ns a sample", ns("prepare"), 80),
        judged("prepare, white noise, ns a sample", ns("prepare white"), 300),
        judged("step under lax.scan, ns a sample", ns("stream"), 40),
    ]


def against_peers(quick: bool) -> list[Row]:
    """Evaluate beside relays that are switched one by one, which agree with it on grid nodes."""
    model, weights, u = random_model(), random_weights(), modulated_sine()
    nodes = np.round(u * CELLS) / CELLS
    expected = evaluate(model, model.prepare(None, nodes))
    for peer in (*peers(weights, nodes).values(), *byte_peers(weights, nodes).values()):
        _assert_same(peer(), expected)

    calls: dict[str, Callable[[], Any]] = {
        "evaluate": partial(evaluate, model, model.prepare(None, u)),
        **peers(weights, u),
        **{f"{name} of bytes": peer for name, peer in byte_peers(weights, u).items()},
    }
    seconds = least_seconds(calls, 5 if quick else 20, LONG)

    def ratio(peer: str) -> float:
        return seconds.get(peer, math.nan) / seconds["evaluate"]

    return [
        judged(f"{DENSE_SCAN} over evaluate", ratio(DENSE_SCAN), 400, at_least=True),
        _if_numba(f"{DENSE_LOOP} over evaluate", ratio(DENSE_LOOP), 200, at_least=True),
        _if_numba(f"{SWEPT_LOOP} over evaluate", ratio(SWEPT_LOOP), 8, at_least=True),
        noted(f"{DENSE_SCAN}, thresholds as bytes, over evaluate", ratio(f"{DENSE_SCAN} of bytes")),
        _if_numba(
            f"{DENSE_LOOP}, thresholds as bytes, over evaluate", ratio(f"{DENSE_LOOP} of bytes")
        ),
    ]


def _assert_same(y: Any, expected: Any) -> None:
    error = np.abs(np.asarray(y) - np.asarray(expected)).max() / np.ptp(expected)
    assert error <= ROUNDING, f"a peer is {error:.1e} of the range off: it computes something else"


def _if_numba(what: str, value: float, bar: float | None = None, *, at_least: bool = False) -> Row:
    if not HAS_NUMBA:
        return Row(what, math.nan, bar, reason=NO_NUMBA, at_least=at_least)
    return noted(what, value) if bar is None else judged(what, value, bar, at_least=at_least)


def _outputs(weights: jax.Array, prepared: PreisachInput) -> jax.Array:
    return grid_model(weights).evaluate(prepared)


def _sum_of_squares(weights: jax.Array, prepared: PreisachInput, y: jax.Array) -> jax.Array:
    # XLA would fuse the outputs into their sum and then gather without vectors, three times slower.
    residual = materialise(_outputs(weights, prepared) - y, prepared.tree.parent[0] == 0)
    return jnp.vdot(residual, residual)


@jax.jit
def _sums_in_blocks(weights: jax.Array, prepared: PreisachInput, y: jax.Array) -> jax.Array:
    # A block's outputs stay in the cache until they are summed; all 64 sets at once make 29 MB.
    return jax.lax.map(lambda w: _sum_of_squares(w, prepared, y), weights, batch_size=BLOCK)


def batches(quick: bool) -> list[Row]:
    """Many parameter sets on one record, as a sampler evaluates them."""
    model, u = random_model(), modulated_sine()
    prepared = model.prepare(None, u)
    y = jnp.asarray(np.random.default_rng(4).random(SAMPLES))
    first = jnp.asarray(np.random.default_rng(3).random((SETS, CELLS, CELLS)))
    last = jnp.moveaxis(first, 0, -1)
    calls = {
        "evaluate": partial(evaluate, model, prepared),
        "sets first": partial(jax.jit(jax.vmap(_outputs, (0, None))), first, prepared),
        "sets last": partial(jax.jit(jax.vmap(_outputs, (-1, None), -1)), last, prepared),
        "sums": partial(jax.jit(jax.vmap(_sum_of_squares, (0, None, None))), first, prepared, y),
        "sums in blocks": partial(_sums_in_blocks, first, prepared, y),
    }
    seconds = least_seconds(calls, 5 if quick else 20, LONG)

    def ratio(name: str) -> float:
        return seconds[name] / seconds["evaluate"]

    return [
        judged(
            f"{SETS} sets' outputs by vmap, on the last axis, over one evaluate",
            ratio("sets last"),
            40,
        ),
        noted(f"{SETS} sets' outputs, on the first axis, over one evaluate", ratio("sets first")),
        judged(
            f"{SETS} log-likelihoods by vmap in blocks of {BLOCK} over one evaluate",
            ratio("sums in blocks"),
            100,
        ),
        noted(f"{SETS} log-likelihoods by one vmap over one evaluate", ratio("sums")),
    ]


def rows(quick: bool) -> list[Row]:
    """All figures; `quick` has fewer rounds and histories, the sizes are the same."""
    return [
        *speed(quick),
        *against_peers(quick),
        *batches(quick),
        *growth.rows(quick),
        *exactness.rows(quick),
        *density_fits.rows(quick),
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; the exit status."""
    chosen = options(
        "benchmarks.preisach", __doc__, arguments, picture="draw time against samples and cells"
    )
    jax.config.update("jax_enable_x64", True)
    report(rows(chosen.quick), chosen.json)
    if chosen.picture:
        picture(chosen.picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
