"""The speed of viscoelastic models and of a composition with relays, and of their gradients.

python -m benchmarks.viscoelastic [--quick] [--json]

Times are the least of interleaved rounds; ratios are those of times from the same rounds.
"""

import sys
from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import AbstractModel, Burgers, GeneralizedMaxwell, MonotoneCurve, Series, Sum

from ._measure import Row, judged, least_seconds, noted, options, report
from ._preisach.inputs import CELLS, SAMPLES, evaluate, random_model

TIMES = (1.0, 10.0, 100.0)
"""Relaxation times of the branches, in mean sampling steps."""


@jax.jit
@jax.value_and_grad
def value_and_gradient(model: AbstractModel, prepared: Any, y: jax.Array) -> jax.Array:
    """The sum of squared errors and its gradient in every parameter of the model."""
    return ((model.evaluate(prepared) - y) ** 2).sum()


def models() -> dict[str, AbstractModel]:
    """A Burgers element, three relaxing branches, and a curve in front of relays beside such branches."""
    E1, eta1, E2, eta2 = map(jnp.asarray, (2.0, 40.0, 1.0, 5.0))
    branches = GeneralizedMaxwell(1.0, [0.5, 0.3, 0.2], TIMES)
    # From [0, 1] onto itself, where the relays are.
    increments = np.random.default_rng(5).uniform(0.5, 1.5, 8)
    curve = MonotoneCurve.even(0.0, 1.0, increments / increments.sum())
    return {
        "Burgers": Burgers(E1, eta1, E2, eta2),
        "3 branches": branches,
        "composed": Series([curve, Sum([random_model(), branches])]),
    }


def rows(quick: bool) -> list[Row]:
    """All figures: random inputs at uneven steps; `quick` has fewer rounds."""
    random = np.random.default_rng(3)
    t, u = np.cumsum(random.uniform(0.5, 1.5, SAMPLES)), random.random(SAMPLES)
    y = jnp.zeros(SAMPLES)
    calls = {}
    for name, model in models().items():
        prepared = model.prepare(jnp.asarray(t), jnp.asarray(u))
        calls[name] = partial(evaluate, model, prepared)
        calls[f"gradient, {name}"] = partial(value_and_gradient, model, prepared, y)
    seconds = least_seconds(calls, 30 if quick else 150)

    def ns(name: str) -> float:
        return 1e9 * seconds[name] / SAMPLES

    whole = f"Series(curve, Sum(Preisach {CELLS}x{CELLS}, {len(TIMES)} branches))"
    return [
        judged("Burgers evaluate, uneven steps, ns a sample", ns("Burgers"), 20),
        judged("Burgers value and gradient, ns a sample", ns("gradient, Burgers"), 50),
        noted("GeneralizedMaxwell of 3 branches, evaluate, ns a sample", ns("3 branches")),
        noted("its value and gradient, ns a sample", ns("gradient, 3 branches")),
        judged(f"{whole}, evaluate, ns a sample", ns("composed"), 60),
        noted("its value and gradient, ns a sample", ns("gradient, composed")),
        judged("the same over evaluate", ns("gradient, composed") / ns("composed"), 6),
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; the exit status."""
    chosen = options("benchmarks.viscoelastic", __doc__, arguments)
    jax.config.update("jax_enable_x64", True)
    report(rows(chosen.quick), chosen.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
